"""The plain actuator: limits and faults."""

import math

import numpy as np
import pytest
from actuator_loops import DT

from actuators.simple import actuator as simple


def _fly(command, p=None, **signals):
    p = simple.params() if p is None else p
    n = len(command)
    u = np.zeros((1, n), simple.INPUTS)
    u["command"] = command
    for name, value in signals.items():
        u[name] = value
    x, log = simple.init(p), np.zeros((1, n), simple.STATE)
    simple.rollout(x, u, p, DT, log)
    return log[0]


def test_settles_on_the_command_within_its_limits():
    log = _fly(np.full(600, math.radians(-30)))
    assert log["delta"][-1] == pytest.approx(math.radians(-23.0), abs=1e-6)
    assert np.abs(log["delta_d"]).max() <= math.radians(45) * (1 + 1e-9)


@pytest.mark.parametrize("hi_deg, rate_deg_s", [(17.0, 45.0), (4.0, 0.5)])
def test_it_stops_at_its_stop(hi_deg, rate_deg_s):
    p = simple.params(hi=math.radians(hi_deg), rate=math.radians(rate_deg_s))
    log = _fly(np.full(12000, 1.0), p)
    assert log["delta"].max() == pytest.approx(p["hi"][0], rel=1e-3)


def test_low_frequency_delay_is_that_of_the_second_order():
    """A ramp lags by 2 zeta / omega: 60 ms for the elevator, within half a tick of the sampled form."""
    t = np.arange(400) * DT
    log = _fly(0.05 * t)
    lag = t[-1] + DT - log["delta"][-1] / 0.05
    assert lag == pytest.approx(2 * 0.9 / 30.0, abs=1.1 * DT)


def test_faults_do_what_they_say_and_heal():
    n = 1200
    on = np.zeros(n)
    on[300:600] = 1.0
    command = math.radians(3) * np.sin(4 * np.arange(n) * DT)
    good = _fly(command)["delta"]
    rate = math.radians(10.0)
    cases = {
        "jam": ({"jam": on}, lambda d: np.ptp(d[300:600]) == 0.0),
        "runaway": ({"s_rate": on, "f_rate": rate * on}, lambda d: abs((d[400] - d[350]) / 0.25 - rate) < 1e-3 * rate),
        "liquid": ({"f_cmd": 0.02 * on}, lambda d: abs((d - good)[590] - 0.02) < 1e-3),
        "solid": ({"s_cmd": on, "f_cmd": 0.02 * on}, lambda d: abs(d[590] - 0.02) < 1e-3),
        "loss": ({"loss": 0.5 * on}, lambda d: abs(d[590] - 0.5 * good[590]) < 2e-3),
        "free": (
            {"free_float": on, "hm0": np.full(n, -1000.0), "hmd": np.full(n, -15e3)},
            lambda d: abs(d[590] + 1 / 15) < 1e-3,
        ),
    }
    for name, (signals, holds) in cases.items():
        d = _fly(command, **signals)["delta"]
        assert np.array_equal(d[:300], good[:300]), name
        assert holds(d), name
        assert np.abs(d[-100:] - good[-100:]).max() < 1e-4, name


def test_a_bad_command_is_held_and_reported():
    command = np.full(400, 0.1)
    command[200:] = np.nan
    log = _fly(command)
    assert log["delta"][-1] == pytest.approx(0.1, abs=1e-4)
    assert np.all(log["status"][200:] == 1.0) and np.all(log["status"][:200] == 0.0)
