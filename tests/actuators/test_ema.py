"""The flying electromechanical actuator: against the matrix exponential, its limits, friction, and every fault."""

import math

import numpy as np
import pytest
from actuator_loops import COMMAND, DT, LOAD, alone, between, fly_ema

from actuators.ema import actuator as ema
from actuators.ema import jay

STATES = ("delta", "delta_d", "motor", "motor_d", "i", "comp")
FREE = {"T_c": 0.0, "T_s": 0.0, "I_max": 1e9, "V_max": 1e9, "x3_lo": -1e9, "x3_hi": 1e9}
STALL = 15.75e3


def _exact(kind, u, hm0, hmd, **symbols):
    """Return the states (ticks, 6) of the linear model by its matrix exponential."""
    m = jay.continuous(kind, hinge_stiffness=hmd, **symbols)
    Phi, Gamma = jay.discretise(m.A, np.column_stack([m.B, m.E]), DT)
    z, out = np.zeros(6), np.zeros((len(u), 6))
    for k in range(len(u)):
        z = Phi @ z + Gamma @ np.array([u[k], hm0])
        out[k] = z
    return out


def _error(log, exact):
    """Return the largest error of each state over the largest value of that state."""
    return np.array([np.abs(log[n] - exact[:, i]).max() for i, n in enumerate(STATES)]) / np.abs(exact).max(axis=0)


def _white(n=400):
    rng = np.random.default_rng(1)
    return 5 * np.sin(0.05 * np.arange(n)) + rng.normal(size=n)


@pytest.mark.parametrize("kind, hm0, hmd", [("nozzle", 0, 0), ("elevator", 100.0, 0.0), ("elevator", 100.0, -26e3)])
def test_unlimited_model_is_the_matrix_exponential(kind, hm0, hmd):
    """White demand at every tick: angles to 5e-6 of their size, motor rate and current to 5e-5, compensator exactly."""
    log = alone(ema, 2.0, p=ema.params(kind, **FREE), u=_white(), hm0=hm0, hmd=hmd)
    error = _error(log, _exact(kind, _white(), hm0, hmd))
    assert np.all(error[[0, 2]] < 5e-6), error
    assert np.all(error[3:5] < 5e-5), error
    assert error[1] < 2e-4, error  # the surface's ringing on its spring, 35 Hz
    assert error[5] < 1e-12, error


def test_published_phi_and_g_drive_the_nozzle():
    """The paper's own matrices against the flying nozzle over one tick, from each unit state and a unit input."""
    p = ema.params("nozzle")
    for j in range(6):
        x = ema.init(p)
        x[STATES[j]] = 1.0
        ema.rollout(x, np.zeros((1, 1), ema.INPUTS), p, DT, np.zeros((1, 1), ema.STATE))
        got = np.array([x[n][0] for n in STATES])
        printed = jay.PHI[:, j]
        some = printed != 0
        limit = np.where(printed[some] == -17.9, 4e-3, 3e-4)
        assert np.all(np.abs(got[some] / printed[some] - 1) < limit)
    x = ema.init(p)
    u = np.ones((1, 1), ema.INPUTS)
    for name in set(u.dtype.names) - {"u"}:
        u[name] = 0.0
    ema.rollout(x, u, p, DT, np.zeros((1, 1), ema.STATE))
    assert np.all(np.abs(np.array([x[n][0] for n in STATES]) / jay.G - 1) < 3e-4)


def test_error_falls_with_the_substep():
    errors = []
    for n in (2, 5, 10, 20):
        log = alone(ema, 2.0, p=ema.params(**FREE, substeps=n), u=_white(), hmd=-26e3)
        errors.append(_error(log, _exact("elevator", _white(), 0.0, -26e3))[2])
    slope = np.polyfit(np.log([2, 5, 10, 20]), np.log(errors), 1)[0]
    assert slope < -2.5


@pytest.mark.parametrize(
    "fault, symbols",
    [
        ({"r_add": 0.4}, {"R": 0.24 * 1.4}),
        ({"magnet_loss": 0.3}, {"K_T": 0.42, "K_B": 0.42}),
        ({"s_i": -0.25}, {"K_ic": 9.6 * 1.25}),
    ],
    ids=["resistance", "magnets", "current scale"],
)
def test_parameter_faults_are_the_exact_model_of_other_parameters(fault, symbols):
    log = alone(ema, 2.0, p=ema.params(**FREE), u=_white(), hmd=-15e3, **fault)
    error = _error(log, _exact("elevator", _white(), 0.0, -15e3, **symbols))
    assert np.all(error[[0, 2]] < 5e-6) and np.all(error[3:5] < 5e-5), error


@pytest.mark.parametrize(
    "p, u, limit_deg",
    [
        ({}, 12 * np.sin(4.4 * np.arange(1200) * DT) + 3 * np.sin(38 * np.arange(1200) * DT), 1e-3),
        ({"backlash": 1e-4}, 12 * np.sin(4.4 * np.arange(1200) * DT), 1e-3),
        ({}, 70 * np.sign(np.sin(3.1 * np.arange(1200) * DT)), 2e-2),  # into both stops, both limits active
    ],
    ids=["friction", "backlash", "bang-bang"],
)
def test_five_substeps_are_enough(p, u, limit_deg):
    fine, coarse = (
        alone(ema, 6.0, p=ema.params(**p, substeps=n), u=u, hm0=-500.0, hmd=-15e3)["delta"] for n in (160, 5)
    )
    assert np.degrees(np.abs(fine - coarse).max()) < limit_deg


def test_stall_at_one_and_a_half_times_the_hydraulic():
    p = ema.params(T_c=0.0, T_s=0.0)
    for share, moves in ((0.99, True), (1.01, False)):
        log = alone(ema, 3.0, p=p, start=(0.0, -share * STALL, 0.0), hm0=-share * STALL, u=70.0)
        assert np.abs(log["i"]).max() <= 43.75 * (1 + 1e-9)
        assert (log["motor"][-1] > log["motor"][0]) == moves


def test_no_load_speed_is_limited_by_the_voltage():
    log = alone(ema, 0.6, p=ema.params(**{**FREE, "V_max": 285.0}), u=200.0)
    assert np.degrees(log["motor_d"][-1] / 600) == pytest.approx(45.35, abs=0.2)  # 285 V / 0.6 V s/rad / 600
    assert log["mode"][-1] == 2.0
    assert abs(log["volts"][-1]) <= 285.0


def test_load_equilibrium_stays_for_a_minute():
    p = ema.params()
    x = ema.init_at(p, -0.1, -2000.0, -15e3)
    log = alone(ema, 60.0, start=(-0.1, -2000.0, -15e3), hm0=-2000.0, hmd=-15e3, u=ema.holding(p, x["i"]))
    assert np.degrees(np.abs(log["delta"] + 0.1).max()) < 1e-10


def test_a_stuck_motor_does_not_creep():
    """The friction at rest, 0.63 N m at the motor, is 378 N m at the surface; the surface only winds the spring."""
    for moment, moves in ((360.0, False), (400.0, True)):
        log = alone(ema, 5.0, hm0=moment * np.minimum(np.arange(1000) / 500, 1.0))
        assert (np.abs(log["motor"]).max() > 0.0) == moves


def test_stops_at_the_travel():
    for u, stop in ((20.0, 17.0), (-20.0, -23.0)):
        log = alone(ema, 4.0, u=u)
        assert log["motor"][-1] / 600 == pytest.approx(math.radians(stop))
        assert np.degrees(log["delta"][-1]) == pytest.approx(stop, abs=0.01)


@pytest.fixture(scope="module")
def healthy():
    return fly_ema(COMMAND, **LOAD)[0]


@pytest.mark.parametrize(
    "fault, least",
    [
        ({"jam": 1.0}, 1.0), ({"jam_screw": 1.0}, 1.0), ({"free_float": 1.0}, 1.0), ({"loss": 0.5}, 0.05),
        ({"friction_add": 8.0}, 0.05), ({"backlash_add": 0.001}, 0.02), ({"magnet_loss": 0.4}, 0.05),
        ({"f_u": 3.0}, 0.05), ({"s_u": 1.0, "f_u": 3.0}, 1.0), ({"f_i": 3.0}, 0.05), ({"s_i": 1.0}, 0.1),
    ],
    ids=lambda f: "+".join(f) if isinstance(f, dict) else "",
)  # fmt: skip
def test_every_fault_shows_and_heals(fault, least, healthy):
    log = fly_ema(COMMAND, **LOAD, faults=between(**fault))[0]
    difference = np.degrees(np.abs(log["delta"] - healthy["delta"]))
    assert difference[:600].max() == 0.0
    assert difference[600:1200].max() > least
    assert difference[1600:].max() < 0.05
    assert np.all(log["status"] == 0.0)


def test_resistance_rise_shows_in_the_current_and_heals(healthy):
    """R is 2.4 per cent of the current loop's resistance: twice the winding takes 2.4 per cent of the current."""
    log = fly_ema(COMMAND, **LOAD, faults=between(r_add=1.0))[0]
    difference = np.abs(log["i"] - healthy["i"])
    assert difference[:600].max() == 0.0
    assert 0.02 < difference[600:1200].max() < 5.0
    hold = alone(ema, 1.0, p=ema.params(**FREE), u=10.0, r_add=1.0, jam_screw=1.0)["i"][-1]
    assert hold == pytest.approx(10.0 * 9.6 / (9.6 + 0.48), rel=1e-9)


def test_jam_stops_the_surface_where_it_is():
    log = fly_ema(COMMAND, **LOAD, faults=between(jam=1.0))[0]
    held = np.degrees(log["delta"][620:1199])
    assert np.ptp(held) == 0.0
    assert abs(held[0] - np.degrees(log["delta"][600])) < 0.1
    screw = fly_ema(COMMAND, **LOAD, faults=between(jam_screw=1.0))[0]
    assert np.ptp(screw["motor"][620:1199]) == 0.0


def test_free_float_trails_on_the_hinge_moment():
    """Amplifier off: the surface goes to hm0 + hmd delta = 0 within the friction, 378 N m over hmd."""
    log = alone(ema, 15.0, start=(0.2, 0.0, 0.0), hm0=-1500.0, hmd=-15e3, u=30.0, free_float=1.0)
    assert log["delta"][-1] == pytest.approx(-0.1, abs=378 / 15e3)
    assert np.ptp(log["motor"][-200:]) == 0.0


def test_magnet_loss_lowers_the_stall_and_raises_the_speed():
    for loss, share, moves in ((0.3, 0.69, True), (0.3, 0.71, False)):
        p = ema.params(T_c=0.0, T_s=0.0)
        log = alone(ema, 3.0, p=p, start=(0.0, -share * STALL, 0.0), hm0=-share * STALL, u=90.0, magnet_loss=loss)
        assert (log["motor"][-1] > log["motor"][0]) == moves
    log = alone(ema, 0.6, p=ema.params(**{**FREE, "V_max": 285.0}), u=300.0, magnet_loss=0.3)
    assert np.degrees(log["motor_d"][-1] / 600) == pytest.approx(45.35 / 0.7, abs=0.5)


def test_bad_inputs_are_taken_as_zero_and_reported():
    hm, u = np.full(400, -500.0), np.zeros(400)
    hm[100:110], u[200:210] = np.nan, np.inf
    log = alone(ema, 2.0, hm0=hm, u=u)
    assert all(np.all(np.isfinite(log[n])) for n in STATES)
    assert np.flatnonzero(log["status"] == 1.0).tolist() == [*range(100, 110), *range(200, 210)]
