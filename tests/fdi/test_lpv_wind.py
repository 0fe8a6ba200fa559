"""lpv_smo in a steady wind: it is no gust, and no fault of the vane while the aircraft rolls."""

import math

import numpy as np
import pytest

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario import load_scenario
from fdi.lpv_smo import lpv_smo

WIRES = sources("lpv_smo")
FIELDS = ("f_hat_alpha", "gust_hat", "ahead", "across", "rms", "gust", "alarm", "valid")


def flown(kind, from_deg):
    given = ["duration_s=45", "flight.turbulence=none", "flight.wind_kt=50", f"flight.wind_from_deg={from_deg}",
             f"manoeuvre.kind={kind}", "seed=63000200", "detectors.enabled=[]"]  # fmt: skip
    given += ["manoeuvre.start_s=15"] if kind != "cruise" else []
    return fly(load_scenario("cruise", given), WIRES.values())


def watched(frame):
    return detect(frame, lpv_smo, WIRES, lpv_smo.fitted(site(frame.attrs["dt"])), FIELDS)


@pytest.mark.parametrize("from_deg", [0.0, 180.0])
def test_a_wind_along_the_flight_is_no_gust(from_deg):
    log = watched(flown("cruise", from_deg))
    late = slice(2000, None)
    assert log["ahead"][-1] == pytest.approx(math.cos(math.radians(from_deg)) * 50 * 0.5144, rel=0.03)
    assert np.abs(log["gust_hat"][late]).max() < math.radians(0.4) and (log["valid"][late] > 0.5).all()


def test_a_wind_across_is_learned_in_a_bank_and_no_fault_of_the_vane():
    log = watched(flown("coordinated_turn", 90.0))
    assert np.abs(log["f_hat_alpha"][2000:]).max() < math.radians(0.25)
    assert not log["alarm"].any() and (log["valid"][2000:] > 0.5).all()
    assert log["rms"][2000:].max() > 2.0 * math.sqrt(log["gust"][3600])  # until the bank has told, limits are wider
