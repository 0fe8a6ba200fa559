"""What becomes of a fault's numbers inside an actuator: millimetres at a drive, a bias under each feedback."""

import functools
import math

import numpy as np
import pytest
from flown import achieved, deg, fault, fly, scenario

from cosim.errors import ScenarioError
from cosim.flight.build import build

RIGHT = "elevator.right_inner"


def oscillation(hz, mm, kind="ofc_liquid", **more):
    keys = fault(0, RIGHT, kind, 2.0, None, at="valve", amplitude_mm=mm, frequency_hz=hz)
    return scenario("sun13", duration_s=4.0 + 4.0 / hz, **keys, **more)


@pytest.mark.parametrize(("hz", "mm"), [(0.3, 0.6), (0.5, 0.6), (1.0, 2.0), (1.5, 2.5), (3.0, 2.0), (8.0, 0.6)])
def test_liquid_oscillation_at_the_drive_moves_the_screw_as_far_as_asked(hz, mm):
    """Friction and load make the difference: up to 20 % at the least amplitude and frequency."""
    assert achieved(oscillation(hz, mm))["right_inner"]["amplitude_mm"] == pytest.approx(mm, rel=0.2)


@pytest.mark.parametrize("shape", ["square", "triangle", "chirp"])
def test_a_shape_reaches_the_drive_and_a_chirp_has_no_amplitude_at_one_frequency(shape):
    more = {"shape": shape} | ({"chirp_hz_s": -0.5} if shape == "chirp" else {})
    keys = fault(0, RIGHT, "ofc_liquid", 2.0, None, at="valve", amplitude_mm=0.6, frequency_hz=2.0, **more)
    there = achieved(scenario("sun13", duration_s=5.0, **keys))["right_inner"]
    assert 0.2 < there["rod_mm"] < 1.5
    fundamental = {"square": 4.0 / math.pi, "triangle": 8.0 / math.pi**2}
    if shape in fundamental:
        assert there["amplitude_mm"] == pytest.approx(0.6 * fundamental[shape], rel=0.2)
    else:
        assert there["amplitude_mm"] is None


# -- a bias of the rod sensor that closes the loop ---------------------------------------------------------------------


@functools.cache
def jammed(feedback, reconfigure=False):
    """Return (t, what 5 mm on the rod sensor from 4 s on add to left inner minus left outer [deg])."""
    bias = fault(0, "elevator.left_inner", "jam_liquid", 4.0, None, bias_mm=5.0)
    f, sound = (
        fly(scenario("sun13", "nz_doublet", duration_s=14.0, manoeuvre__start_s=6.0, manoeuvre__amplitude_g=0.15,
                     elevator__feedback=feedback, elevator__reconfigure=str(reconfigure).lower(), **what),
            "truth.aircraft.de_lo")
        for what in (bias, {})
    )  # fmt: skip
    return f.t, deg((f.de_li - f.aircraft_de_lo) - (sound.de_li - sound.aircraft_de_lo))


def test_a_measured_loop_switches_to_the_healthy_estimate_where_the_scenario_says_so():
    t, off = jammed("measured", reconfigure=True)
    # until the verdict the loop follows the sensor: 0.72 of the 0.95 deg
    assert np.abs(off).max() < 0.8 and np.median(np.abs(off[t > 5.0])) < 0.05


@pytest.mark.parametrize(
    ("feedback", "most", "later"),
    [("measured", 1.10, 0.95), ("iotsekf", 0.25, 0.0), ("rtsekf", 0.4, 0.0), ("rtsekf_flight", 0.4, 0.0)],
)
def test_liquid_jam_moves_the_surface_only_where_the_servo_believes_the_rod_sensor(feedback, most, later):
    """5 mm are 0.95 deg: all of it with `measured`; a filter sets the sensor aside within its confirmation time."""
    t, off = jammed(feedback)
    settled = np.abs(off[t > 5.0])
    assert np.abs(off).max() < most
    assert np.median(settled) == pytest.approx(later, abs=0.05)
    print(f"{feedback:14s} peak {np.abs(off).max():.2f} deg, then {np.median(settled):.2f} deg")


def test_a_surface_runs_away_no_faster_than_its_actuator_moves():
    with pytest.raises(ScenarioError, match=r"rate_deg_s = 5: .*0.5 deg/s at most; allowed: -0.5 to 0.5"):
        build(scenario(**fault(0, "stabiliser", "runaway", 1.0, None, rate_deg_s=5.0)))
    build(scenario(**fault(0, "stabiliser", "runaway", 1.0, None, rate_deg_s=-0.5)))
