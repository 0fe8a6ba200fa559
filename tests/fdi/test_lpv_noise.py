"""lpv_smo in still air: its own noise is predicted, and raises no alarm."""

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


def watched(place, **fields):
    """Return the log in a minute or more of still air at this place, and the time [s]."""
    given = ["flight.turbulence=none", "duration_s=75", *place, "detectors.enabled=[]"]
    frame = fly(load_scenario("cruise", given), WIRES.values())
    p = lpv_smo.fitted(site(frame.attrs["dt"]))
    for name, value in fields.items():
        p[name] = value
    return detect(frame, lpv_smo, WIRES, p, FIELDS), frame.index


@pytest.mark.parametrize("place, most", [((*SLOW_HEAVY, "seed=88020006"), 0.1), (AT_AN_EDGE, 0.12)])
def test_the_predicted_standard_deviations_are_those_of_a_still_flight_and_raise_no_alarm(place, most):
    """At the first place the elevator is weak."""
    log, t = watched(place)
    assert not log["alarm"].any() and (log["valid"][t > 9.0] > 0.5).all()
    late = t > 20.0
    predicted = [log["f_sigma"][late].mean(), *log["sigma"][late].mean(axis=0)]
    np.testing.assert_allclose(predicted, [log[n][late].std() for n in FIELDS[:3]], rtol=most)


def test_fast_flight_in_still_air_needs_no_long_confirmation():
    """Where dynamic pressure is high, noise of the gust's angle is a load factor of 0.007 g: no limit goes below it."""
    assert not watched((*FAST_LIGHT, "seed=63000301"), t_confirm=0.15)[0]["alarm"].any()


def test_the_noise_that_is_predicted_from_is_that_of_the_sensors():
    words = {"theta": RAD_PER_DEG, "v_ground": 1.0, "q": RAD_PER_DEG, "alpha_ground": RAD_PER_DEG}
    assert [TRANSPORT[word][1] / unit for word, unit in words.items()] == pytest.approx(list(noise.SIGMA.values()))


def test_half_periods_on_either_side_of_a_pause_are_not_counted_together():
    x = lpv_smo.init(lpv_smo.fitted(site(0.005)))[0]
    x.half, x.sign, x.since = 2.0, 1.0, 0.1
    lpv_smo._silent(x, 3.0)
    assert x.half == 0.0
