"""The plain actuator: limits and faults."""

import math

import numpy as np
import pytest
from actuator_loops import DT, alone

from actuators.simple import actuator as simple


def fly(command, p=None, **signals):
    return alone(simple, len(command) * DT, p=p, start=(0.0,), command=command, **signals)


@pytest.mark.parametrize("hi_deg, rate_deg_s", [(17.0, 45.0), (4.0, 0.5)])
def test_it_stops_at_its_stops_within_its_rate(hi_deg, rate_deg_s):
    p = simple.params(hi=math.radians(hi_deg), rate=math.radians(rate_deg_s))
    for sign, stop in ((1.0, p["hi"][0]), (-1.0, p["lo"][0])):
        log = fly(np.full(12000, sign), p)
        assert log["delta"][-1] == pytest.approx(stop, rel=1e-3)
        assert np.abs(log["delta_d"]).max() <= p["v_max"][0] * (1 + 1e-9)


def test_low_frequency_delay_is_that_of_the_second_order():
    """A ramp lags by 2 zeta / omega: 60 ms for the elevator, within half a tick of the sampled form."""
    t = np.arange(400) * DT
    lag = t[-1] + DT - fly(0.05 * t)["delta"][-1] / 0.05
    assert lag == pytest.approx(2 * 0.9 / 30.0, abs=1.1 * DT)


ON = np.where(np.arange(1200) // 300 == 1, 1.0, 0.0)
RATE, COMMAND = math.radians(10.0), math.radians(3) * np.sin(4 * np.arange(1200) * DT)
FAULTS = {  # the faults, and what is near zero of the angle d against that without them
    "jam": ({"jam": ON}, lambda d, good: np.ptp(d[301:600])),
    "runaway": ({"s_rate": ON, "f_rate": RATE * ON}, lambda d, good: (d[400] - d[350]) / 0.25 - RATE),
    "liquid": ({"f_cmd": 0.02 * ON}, lambda d, good: (d - good)[590] - 0.02),
    "solid": ({"s_cmd": ON, "f_cmd": 0.02 * ON}, lambda d, good: d[590] - 0.02),
    "loss": ({"loss": 0.5 * ON}, lambda d, good: d[590] - 0.5 * good[590]),
    "free": ({"free_float": ON, "hm0": -1000.0, "hmd": -15e3}, lambda d, good: d[590] + 1 / 15),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_do_what_they_say_and_heal(name):
    signals, off = FAULTS[name]
    good, d = fly(COMMAND)["delta"], fly(COMMAND, **signals)["delta"]
    assert np.array_equal(d[:300], good[:300]) and abs(off(d, good)) < 2e-3
    assert np.abs(d[-100:] - good[-100:]).max() < 1e-4


def test_a_bad_command_is_held_and_reported():
    log = fly(np.where(np.arange(400) < 200, 0.1, np.nan))
    assert log["delta"][-1] == pytest.approx(0.1, abs=1e-4)
    assert log["status"].tolist() == [0.0] * 200 + [1.0] * 200
