"""lpv_smo in still air: its own noise is predicted, and raises no alarm."""

import math

import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario import load_scenario
from fdi.lpv_smo import lpv_smo, noise

WIRES = sources("lpv_smo")
FIELDS = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha", "f_sigma", "sigma", "alarm", "valid")
FAST_LIGHT = ("flight.mass_t=207.4", "flight.cg_pct=26.94", "flight.altitude_ft=20430", "flight.cas_kt=320.6")
AT_AN_EDGE = ("flight.mass_t=404.7", "flight.cg_pct=34.3", "flight.altitude_ft=30120", "flight.cas_kt=300.2")
SLOW_HEAVY = ("flight.mass_t=399.6", "flight.cg_pct=29.08", "flight.altitude_ft=10860", "flight.cas_kt=240.3")


@pytest.fixture(scope="module")
def flown():
    given = ["flight.turbulence=none", "duration_s=60", *SLOW_HEAVY, "seed=88020006", "detectors.enabled=[]"]
    return fly(load_scenario("cruise", given), WIRES.values())


def watched(flown, **changes):
    p = lpv_smo.fitted(site(flown.attrs["dt"]))
    for name, value in changes.items():
        p[name] = value
    return detect(flown, lpv_smo, WIRES, p, FIELDS), p


def test_no_alarm_in_a_still_flight_without_a_fault_where_the_elevator_is_weak(flown):
    log, _ = watched(flown)
    assert not (log["alarm"] > 0.5).any() and (log["valid"][flown.index > 9.0] > 0.5).all()
    counted_from_one_sample, _ = watched(flown, floor=0.0, least=0.0, t_elevator=math.radians(0.15), g_elevator=0.88)
    assert (counted_from_one_sample["alarm"] > 0.5).any()  # it raised one: the flight tells


def test_fast_flight_in_still_air_needs_no_long_confirmation():
    """Where dynamic pressure is high, noise of the gust's angle is a load factor of 0.007 g: no limit goes below it."""
    given = ["flight.turbulence=none", "duration_s=75", *FAST_LIGHT, "seed=63000301", "detectors.enabled=[]"]
    fast = fly(load_scenario("cruise", given), WIRES.values())
    assert not watched(fast, t_confirm=0.15)[0]["alarm"].any()
    assert watched(fast, least=0.0, t_n_z=0.0013, t_confirm=0.25)[0]["alarm"].any()


def test_the_predicted_standard_deviations_are_those_of_a_still_flight(flown):
    given = ["flight.turbulence=none", "duration_s=60", *AT_AN_EDGE, "detectors.enabled=[]"]
    for frame, most in ((flown, 0.1), (fly(load_scenario("cruise", given), WIRES.values()), 0.12)):
        log, _ = watched(frame)
        late = frame.index > 20.0
        predicted = [log["f_sigma"][late].mean(), *log["sigma"][late].mean(axis=0)]
        measured = [log[n][late].std() for n in FIELDS[:3]]
        np.testing.assert_allclose(predicted, measured, rtol=most)


def test_the_noise_that_is_predicted_from_is_that_of_the_sensors():
    words = {"theta": RAD_PER_DEG, "v_ground": 1.0, "q": RAD_PER_DEG, "alpha_ground": RAD_PER_DEG}
    assert [TRANSPORT[word][1] / unit for word, unit in words.items()] == pytest.approx(list(noise.SIGMA.values()))


def test_half_periods_on_either_side_of_a_pause_are_not_counted_together():
    x = lpv_smo.init(lpv_smo.fitted(site(0.005)))[0]
    x.half, x.sign, x.since = 2.0, 1.0, 0.1
    lpv_smo._silent(x, 3.0)
    assert x.half == 0.0
