"""The share of the command that an oscillation takes out: a regression over the bank's windows, with its variance."""

import numpy as np
import pytest
from scipy import stats

from fdi.common import bank
from fdi.rfafe import decision, rfafe


@pytest.mark.parametrize("hz", [1.0, 3.0, 8.0])
def test_the_share_and_its_variance_are_those_of_least_squares(hz):
    """f = -share u + noise: the slope of f over u with a constant, and the square of its standard error."""
    p, x = rfafe.params()[0], np.zeros(1, rfafe.STATE)[0]
    k = int(np.argmin(np.abs(p["bank_hz"] - hz)))
    fast = p["bank_hz"][k] > decision.FAST
    n, j = (decision.FAST_N, bank.LEVELS - 1) if fast else (int(p["bank_n"][k]), int(p["bank_level"][k]))
    rng = np.random.default_rng(7)
    u = rng.standard_normal(n)
    f = 0.3 - 0.8 * u + 0.5 * rng.standard_normal(n)
    head = 5  # of a ring: the window runs over its end
    x["bank_ring"][0, j, np.arange(head - n, head)] = f
    x["bank_ring"][1, j, np.arange(head - n, head)] = u
    x["bank_head"][j], x["bank_seen"][j] = head, bank.N
    share, weight = decision.missing(x, p, k, 10.0)
    told = stats.linregress(u, f)
    assert (share, weight) == pytest.approx((-told.slope, told.stderr**-2), rel=1e-9)


def test_a_window_that_is_not_full_tells_no_share():
    p, x = rfafe.params()[0], np.zeros(1, rfafe.STATE)[0]
    k = int(np.argmin(np.abs(p["bank_hz"] - 1.0)))
    x["bank_seen"][int(p["bank_level"][k])] = p["bank_n"][k]
    assert decision.missing(x, p, k, 10.0) == (0.0, 0.0)
    fast = int(np.argmax(p["bank_hz"]))
    x["bank_seen"][:] = bank.N
    assert decision.missing(x, p, fast, 0.2) == (0.0, 0.0)  # two of its samples since it was found
