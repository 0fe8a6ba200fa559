"""The plant: signs in flight, steadiness, timing, determinism, refusals."""

import math

import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim.errors import TrimError
from cosim.flight.plant.jsbsim_signals import border
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import POINTS, FlightPoint, Plant, Port
from cosim.scenario.aircraft import load_aircraft

BORDER = border(load_aircraft())
TRUTH, SURFACES = BORDER.truth, BORDER.inputs
COLUMN = {name: i for i, name in enumerate(SURFACES)}


def _flown(seconds, move=None, flight=POINTS["sun13"], dt=0.005):
    """Trim, add `move` = {input: value} from the first step on, fly; return (truth before, truth after)."""
    plant = Plant(flight, dt)
    trim = plant.trim()
    before = plant.truth()[0].copy()
    surfaces = trim.surfaces.copy()
    for name, value in (move or {}).items():
        surfaces[COLUMN[name]] += value
    for _ in range(round(seconds / dt)):
        plant.write(surfaces)
        plant.run()
    return before, plant.truth()[0]


ELEVATORS = ("de_lo", "de_li", "de_ri", "de_ro")


@pytest.mark.parametrize(
    ("move", "field", "sign"),
    [
        ({n: RAD_PER_DEG for n in ELEVATORS}, "q", -1),         # trailing edge down pitches down
        ({n: RAD_PER_DEG for n in ELEVATORS}, "alpha", -1),
        ({n: RAD_PER_DEG for n in ELEVATORS}, "nz", -1),
        ({"stab": RAD_PER_DEG}, "theta", -1),                   # stabiliser trailing edge down pitches down
        ({"da_l": RAD_PER_DEG}, "p", +1),                       # each aileron + rolls right
        ({"da_r": RAD_PER_DEG}, "phi", +1),
        ({"dr": RAD_PER_DEG}, "r", -1),                         # rudder + yaws left
        ({"de_lo": RAD_PER_DEG, "de_ro": -RAD_PER_DEG}, "p", +1),       # more lift on the left tail rolls right
        ({"thrust_loss_4": 1.0}, "r", +1),              # right outer engine lost: yaws right
        ({"thrust_loss_1": 1.0, "thrust_loss_4": 1.0}, "tas", -1),
        ({f"throttle_{i}": 0.1 for i in (1, 2, 3, 4)}, "nx", +1),
    ],
)  # fmt: skip
def test_sign_in_flight(move, field, sign):
    before, after = _flown(1.0, move)
    assert sign * (after[field] - before[field]) > 1e-4


def test_load_factor_is_one_in_level_flight_and_pitch_attitude_is_alpha():
    before, _ = _flown(0.005)
    lift_axis = before.nz * math.cos(before.alpha) + before.nx * math.sin(before.alpha)
    assert lift_axis == pytest.approx(1.0, abs=0.006)  # local gravity and the rotating earth, against standard gravity
    assert before.theta == pytest.approx(before.alpha, abs=1e-12)
    assert before.gamma == pytest.approx(0.0, abs=1e-9)


def test_hinge_moment_opposes_the_segment_and_its_angle_of_attack():
    """A segment held down is driven up (slope negative); a tail at positive angle of attack drives it up too."""
    plant = Plant(POINTS["sun13"])
    trim = plant.trim()
    t = plant.truth()[0].copy()
    assert t.hmd_lo < 0.0
    # C_h_delta q S c = -0.17 x q x 8 m2 x 1.4 m
    assert t.hmd_lo == pytest.approx(-0.17 * t.qbar * 8.0 * 1.4, rel=1e-4)
    plant.place(tas=trim.tas, alpha=t.alpha + 0.05, theta=t.theta, altitude=trim.altitude, surfaces=trim.surfaces)
    assert plant.truth()[0].hm0_lo < t.hm0_lo
    plant.place(tas=trim.tas, alpha=t.alpha, theta=t.theta, altitude=trim.altitude, q=0.1, surfaces=trim.surfaces)
    assert plant.truth()[0].hm0_lo < t.hm0_lo  # nose up the tail goes down
    plant.place(tas=trim.tas, alpha=t.alpha, theta=t.theta, altitude=trim.altitude, p=0.1, surfaces=trim.surfaces)
    rolling = plant.truth()[0]
    assert rolling.hm0_ro < rolling.hm0_ri < rolling.hm0_li < rolling.hm0_lo  # the right tail goes down


def test_linear_model_predicts_a_small_doublet():
    """B and A against the flight itself: 0.2 deg of elevator for 2 s, errors below 3 % of each peak."""
    flight = POINTS["E"]
    model = linearize(flight)
    names = ["tas", "alpha", "q", "theta", "h"]
    A, B, C, D = model.block(names, outputs=["nz", "q"])
    b, d = B[:, :4].sum(axis=1), D[:, :4].sum(axis=1)
    plant = Plant(flight)
    trim = plant.trim()
    dt, x, got, want = 0.005, np.zeros(5), [], []
    zero = plant.truth()[0].copy()
    surfaces = trim.surfaces.copy()
    for k in range(800):
        u = 0.2 * RAD_PER_DEG * (1 if k < 200 else -1 if k < 400 else 0)
        surfaces[:4] = u
        plant.write(surfaces)
        plant.run()
        t = plant.truth()[0]
        for _ in range(5):
            x = x + dt / 5 * (A @ x + b * u)
        got.append([t.alpha - zero.alpha, t.q - zero.q, t.theta - zero.theta, t.nz - zero.nz])
        want.append([x[1], x[2], x[3], (C @ x + d * u)[0]])
    got, want = np.array(got), np.array(want)
    error = np.abs(got - want).max(axis=0) / np.abs(want).max(axis=0)
    assert error.max() < 0.03, error


def test_export_keeps_names_and_numbers(tmp_path):
    from scipy.io import loadmat

    model = linearize(POINTS["sun13"])
    model.save(tmp_path / "m.npz")
    model.save(tmp_path / "m.mat")
    data = np.load(tmp_path / "m.npz")
    np.testing.assert_array_equal(data["A"], model.A)
    assert list(data["states"]) == list(model.states)
    mat = loadmat(tmp_path / "m.mat", squeeze_me=True)
    np.testing.assert_allclose(mat["B"], model.B)
    assert list(mat["outputs"]) == list(model.outputs)
    with pytest.raises(ValueError, match="npz"):
        model.save(tmp_path / "m.txt")


def test_unknown_property_is_refused():
    plant = Plant(POINTS["sun13"])
    with pytest.raises(KeyError, match="no property"):
        plant.port.get("fcs/elevator-lo-pos-rda")
    assert isinstance(plant.port, Port)


@pytest.mark.parametrize(
    ("flight", "reason"),
    [
        (FlightPoint.at(405, 28, 27500, cas_kt=150), "stall"),
        (FlightPoint.at(405, 28, 42000, mach=0.85), "thrust|stall"),
        (FlightPoint.at(390, 30, 35000, mach=0.60), "thrust"),
        (FlightPoint.at(200, 30, 2000, mach=0.15), "Mach 0.15 is beyond the aerodynamic data.*Fly faster"),
        (FlightPoint.at(405, 30, 0, mach=0.2), "stall"),
    ],
)
def test_infeasible_points_say_why(flight, reason):
    with pytest.raises(TrimError, match=reason):
        Plant(flight).trim()


def test_console_is_silent(capfd):
    _flown(0.1)
    with pytest.raises(TrimError):
        Plant(FlightPoint.at(405, 28, 27500, cas_kt=150)).trim()
    out, err = capfd.readouterr()
    assert out == "" and err == ""
