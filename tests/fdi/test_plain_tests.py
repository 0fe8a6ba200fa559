"""Four plain tests of a hydraulic actuator: a valve that stands open, a sensor that repeats itself, a jam."""

import numpy as np
import pytest
from lu17_bench import DT, doublets, fly, inputs, roll

from fdi.common import verdict
from fdi.hydraulic import iotsekf, plain_tests

P = iotsekf.params()[0]
T = np.arange(400) * DT
ONSET = 1.0
PRESSURE = iotsekf.ISOLABLE_PARTS.index("pressure")


def opens(w):
    """Return whether a valve opening of w (ticks,), against a servo that fights it, is ever taken for a runaway."""
    x = iotsekf.init(iotsekf.params())[0]
    for value in w:
        x.u_slow = -0.5 * value
        x.f_slow = value - x.u_slow
        x.r_run = abs(x.f_slow) / P.run_threshold
        x.run = max(x.run, float(x.r_run >= 1.0))
        x.run_s = x.run_s + DT if x.run > 0.5 else 0.0
        plain_tests.runaway(x, 1.0, P, DT)
        if x.stands_open != 0.0:
            return True
    return False


def test_a_valve_that_opens_and_stays_has_run_away_and_one_that_swings_has_not():
    late = np.maximum(T - ONSET, 0.0)
    assert opens(0.08 * (1.0 - np.exp(-late / 0.02)))
    assert not opens(np.minimum(0.1 * late, 0.05))  # creeps
    for hz in (0.2, 0.5, 0.7, 1.0, 1.4, 2.0):
        assert not opens(0.05 * np.sin(2.0 * np.pi * hz * late)), hz


@pytest.fixture(scope="module")
def flown():
    return inputs(iotsekf, [fly(doublets(16.0), seed=s) for s in range(4)])


def test_a_sensor_that_freezes_is_named_and_used_again_when_it_moves(flown):
    u, at, thaws = flown.copy(), round(8.0 / DT), round(12.0 / DT)
    u["y_dp"][:, at:thaws] = u["y_dp"][:, at - 1 : at]
    log = roll(iotsekf, np.repeat(iotsekf.params(), 4), u)
    on = log["alarm"] > 0.5
    assert not on[:, :at].any() and on[:, at + round(0.2 / DT) : thaws].all()
    named = (log["verdict"] == verdict.SENSOR) & (log["isolated_part"] == PRESSURE)
    assert (named | (log["verdict"] == verdict.AMBIGUOUS))[on].all() and named[:, thaws - 1].all()
    assert not on[:, thaws + 2 :].any()


def test_a_coarse_sensor_is_not_frozen(flown):
    u = flown.copy()
    u["y_dp"] = 0.02 * np.round(u["y_dp"] / 0.02)
    assert not roll(iotsekf, np.repeat(iotsekf.params(), 4), u)["frozen"].any()


@pytest.mark.parametrize("rate", [0.05, 0.2, -0.1])
def test_a_pressure_that_drifts_is_no_jam(flown, rate):
    u, at = flown.copy(), round(8.0 / DT)
    u["y_dp"][:, at:] += rate * DT * np.arange(u.shape[1] - at)
    log = roll(iotsekf, np.repeat(iotsekf.params(), 4), u)
    assert (log["verdict"][:, -1] == verdict.SENSOR).all() and (log["isolated_part"][:, -1] == PRESSURE).all()
    assert not (log["verdict"] == verdict.JAM_SOLID).any()


H = 8e-4
TIME = np.arange(0.0, 4.0, DT)


@pytest.mark.parametrize(
    ("d", "loose", "suspected"),
    [
        (H * np.sign(np.sin(np.pi * TIME + 1e-9)) + 1.5e-4 * np.random.default_rng(1).standard_normal(800), 1.0, 1.0),
        (H * np.ones(800), 0.0, 1.0),
        (H * np.sin(2.6 * np.pi * TIME), 0.0, 0.0),
        (5.0 * H * np.random.default_rng(2).standard_normal(800), 0.0, 0.0),
        (H * np.where(TIME < 3.95, 1.0, -1.0), 0.0, 1.0),
    ],
    ids=("gap", "bias", "oscillation", "noise", "has only just changed its side"),
)
def test_rod_less_surface_with_two_levels_is_a_gap_and_what_a_sensor_does_is_none(d, loose, suspected):
    x = iotsekf.init(iotsekf.params())[0]
    x.sensor = x.backlash_suspected = 1.0
    for k in range(len(d)):
        x.pair_age = k * DT
        x.pair_d += (1.0 - np.exp(-DT / 0.03)) * (d[k] - x.pair_d)
        plain_tests.gap(x, DT)
    assert (x.loose, x.backlash_suspected) == (loose, suspected)
    x.sensor = 0.0
    plain_tests.gap(x, DT)
    assert x.loose == 0.0 and x.gap_dd == 0.0 and not x.gap_s.any()
