"""`ema_kalman`: the published filter is a Kalman filter, and what that means for its use. [Jay]"""

import numpy as np
import pytest
from scipy.stats import chi2

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


def simulate(rng, n, p):
    """Return (states, inputs) of the linear plant with the filter's own model: matched noise."""
    Phi, G = p["Phi"][0], p["G"][0]
    x = np.zeros((n, 6))
    x[0] = rng.standard_normal(6) * np.sqrt(p["P0"][0])
    demand = 0.3 * np.sin(3.0 * DT * np.arange(n))
    for k in range(1, n):
        x[k] = Phi @ x[k - 1] + G * demand[k]
    C = jay.continuous("nozzle").C
    y = x @ C.T
    u = inputs(n, u=demand, y_position=y[:, 0], y_current=y[:, 1])
    u["y_velocity"] = y[:, 2] + rng.standard_normal(n) * np.sqrt(p["R"][0]) / jay.K_V
    return x, u


def test_consistent_with_matched_noise():
    """NIS and NEES over 50 seeds inside their 95 % chi-square bounds at the ends of the run; innovations white."""
    p = ema_kalman.params("nozzle")
    n, seeds = 200, 50
    nis, nees, lag = [], [], []
    for seed in range(seeds):
        x, u = simulate(np.random.default_rng(seed), n, p)
        log = run(u, p)
        eta = log["eta"]
        nis.append(np.sum(eta**2))
        lag.append(np.sum(eta[1:] * eta[:-1]) / (n - 1))
        e = (log["x_hat"][9] - x[9])[:5]  # x6 is known from the second tick on: its covariance is at rounding
        nees.append(e @ np.linalg.solve(log["P"][9][:5, :5], e))
    low, high = chi2.ppf([0.025, 0.975], seeds * n)
    assert low < np.sum(nis) < high
    low, high = chi2.ppf([0.025, 0.975], seeds * 5)
    assert low < np.sum(nees) < high
    assert abs(np.mean(lag)) < 1.96 / np.sqrt(seeds * (n - 1))


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


def test_elevator_engages_at_the_measured_position_and_nozzle_at_zero():
    u = inputs(3, y_position=4e-3)
    elevator = run(u, ema_kalman.params("elevator"))
    assert elevator["pos_hat"][-1] == pytest.approx(4e-3, abs=1e-9)
    assert run(u, ema_kalman.params("nozzle"))["pos_hat"][-1] == 0.0
