"""`ema_kalman`: the published filter is a Kalman filter, and what that means for its use. [Jay]"""

import numpy as np
import pytest

from actuators.ema import jay
from fdi.common.verdict import SENSOR
from fdi.ema import ema_kalman

DT = jay.PERIOD


def inputs(n, **values):
    u = np.zeros((1, n), ema_kalman.INPUTS)
    for name in ("velocity_valid", "position_valid", "current_valid"):
        u[name] = 1.0
    for name, value in values.items():
        u[name] = value
    return u


def run(u, p):
    x, log = ema_kalman.init(p), np.zeros(u.shape, ema_kalman.STATE)
    ema_kalman.rollout(x, u, p, DT, log)
    return log[0]


def test_gain_vanishes_so_that_a_velocity_bias_stays_in_the_innovation_and_out_of_the_position():
    p = ema_kalman.params("nozzle")
    n = 2000
    u = inputs(n, y_velocity=5.0)
    u["y_velocity"][0, :400] = 0.0
    log = run(u, p)
    share = jay.K_V**2 * log["P"][:, 3, 3] / p["R"][0]  # of an innovation that x4 takes
    assert share[:20].max() > 0.1 and share[100] < 5e-3 and share[400] < 1e-5
    assert log["eta_bar"][-1] == pytest.approx(5.0 * jay.K_V / np.sqrt(p["R"][0]), rel=0.05)
    assert abs(log["pos_hat"][-1]) < 0.05e-3
    assert log["isolated_part"][-1] == 1.0 and log["verdict"][-1] == SENSOR and log["valid"][-1] == 0.0


@pytest.mark.parametrize("name", ["u", "y_velocity", "y_position", "y_current"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_bad_sample_does_not_stick(name, value):
    p = ema_kalman.params("nozzle")
    u = inputs(100)
    u[name][0, 40:45] = value
    log = run(u, p)
    for field in ema_kalman.STATE.names:
        assert np.all(np.isfinite(log[field])), field
    assert not log["alarm"].any()
    assert log["valid"][-1] == 1.0
