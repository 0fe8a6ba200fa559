"""The last position sensor of an actuator jumps: it is held to have jumped until there are two again to compare."""

import numpy as np
import pytest

from fdi.common import decision
from fdi.hydraulic import iotsekf, plain_tests

SIGMA = 1e-4  # of a position sensor [m]


def listen(innovations, rod=1.0, surface=0.0, **at):
    """Return the record after these innovations of the one position that is left [m]."""
    x = np.zeros(1, iotsekf.STATE)[0]
    x["pair_time"] = 1.0
    for name, value in at.items():
        x[name] = value
    for e in innovations:
        x["gamma_rod"] = e
        plain_tests.jumped(x, rod, surface, 0.005)
    return x


@pytest.mark.parametrize(("rod", "surface", "which"), [(1.0, 0.0, 1.0), (0.0, 1.0, 2.0)])
def test_a_jump_that_stays_for_three_samples_is_the_sensors(rod, surface, which):
    x = listen([0.0, 10 * SIGMA, 10 * SIGMA, 10 * SIGMA], rod, surface)
    assert x["jump_of"] == which and x["t_settling"] >= decision.T_DISTURBED
    plain_tests.jumped(x, 1.0, 1.0, 0.005)
    assert x["jump_of"] == 0.0


@pytest.mark.parametrize(
    "innovations",
    [[0.0, 5e-4, 5e-4, 5e-4], [0.0, 1e-3, 1e-3], [5e-4, 1e-3, 1e-3, 1e-3], [0.0, 1e-3, 1e-3, -1e-3, 1e-3]],
    ids=["small", "two samples", "rises", "changes sign"],
)
def test_noise_an_outlier_and_an_oscillation_are_no_jump(innovations):
    assert listen(innovations)["jump_of"] == 0.0


@pytest.mark.parametrize("at", [{"sensor": 1.0}, {"age": 0.1}, {"pair_time": 0.0}, {"alarm": 1.0}])
def test_where_a_name_stands_or_two_never_agreed_nothing_is_said(at):
    assert listen([0.0, 1e-3, 1e-3, 1e-3], **at)["jump_of"] == 0.0
