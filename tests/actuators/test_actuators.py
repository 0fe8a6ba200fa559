"""The flying actuators: what both technologies do alike, accuracy, stall, stops, friction and every fault; then what
is one's own.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from actuator_loops import COMMAND, DT, LOAD, alone, between, fly_ema, fly_hydraulic

from actuators.common import linkage
from actuators.ema import actuator as ema
from actuators.ema import jay
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import lu17

T = np.arange(1200) * DT
FREE = {"F_c": 0.0, "F_s": 0.0}
UNLIMITED = {"T_c": 0.0, "T_s": 0.0, "I_max": 1e9, "V_max": 1e9, "x3_lo": -1e9, "x3_hi": 1e9}
STALL = 15.75e3  # of the EMA [N m]
STATES = ("delta", "delta_d", "motor", "motor_d", "i", "comp")
HYDRAULIC = SimpleNamespace(
    module=hydraulic, fly=fly_hydraulic, moved="q_rod", per_rad=linkage.ARM, least=0.005,
    stall=10.5e3, full=math.radians(45.0) * 0.3, smooth={**FREE, "L": 0.0},
    holding=lambda p, x: x["u_eff"][0], rest=135.0, float_error=450 * 0.3 / 15e3,
    # u and the error [deg]: manoeuvre with ripple; slow reversals, stick and slip; bang-bang into both stops
    refined=[({}, 0.15 * np.sin(4.4 * T) + 0.01 * np.sin(38 * T), 1e-4), ({}, 0.02 * np.sin(1.9 * T), 1e-4),
             ({}, 0.236 * np.sign(np.sin(1.6 * T)), 1e-3)],
    faults=[({"jam": 1.0}, 0.1), ({"free_float": 1.0}, 0.1), ({"loss": 0.6}, 0.1), ({"supply_drop": 0.7}, 0.1),
            ({"leak_add": 0.3}, 0.1), ({"air": 0.9}, 0.1), ({"f_u": 0.02}, 0.1), ({"s_u": 1.0, "f_u": 0.01}, 0.1)],
)  # fmt: skip
EMA = SimpleNamespace(
    module=ema, fly=fly_ema, moved="motor", per_rad=600.0, least=0.0,
    stall=STALL, full=70.0, smooth={"T_c": 0.0, "T_s": 0.0},
    holding=lambda p, x: ema.holding(p, x["i"]), rest=378.0, float_error=378 / 15e3,
    refined=[({}, 12 * np.sin(4.4 * T) + 3 * np.sin(38 * T), 1e-3), ({"backlash": 1e-4}, 12 * np.sin(4.4 * T), 1e-3),
             ({}, 70 * np.sign(np.sin(3.1 * T)), 2e-2)],
    faults=[({"jam": 1.0}, 1.0), ({"jam_screw": 1.0}, 1.0), ({"free_float": 1.0}, 1.0), ({"loss": 0.5}, 0.05),
            ({"friction_add": 8.0}, 0.05), ({"backlash_add": 0.001}, 0.02), ({"magnet_loss": 0.4}, 0.05),
            ({"f_u": 3.0}, 0.05), ({"s_u": 1.0, "f_u": 3.0}, 1.0), ({"f_i": 3.0}, 0.05), ({"s_i": 1.0}, 0.1)],
)  # fmt: skip
both = pytest.mark.parametrize("own", [HYDRAULIC, EMA], ids=["hydraulic", "ema"])


@both
def test_stall_where_it_is_said_to_be(own):
    """One per cent of load below the stall it still extends, one above it does not; leakage and friction left out."""
    for share, moves in ((0.99, True), (1.01, False)):
        p, load = own.module.params(**own.smooth), -share * own.stall
        log = alone(own.module, 3.0, p=p, start=(0.0, load, 0.0), hm0=load, u=own.full)
        assert (log[own.moved][-1] > log[own.moved][0] + own.least) == moves


@both
def test_load_equilibrium_stays_for_a_minute(own):
    p, load = own.module.params(), (-0.1, -2000.0, -15e3)
    u = own.holding(p, own.module.init_at(p, *load))
    log = alone(own.module, 60.0, start=load, hm0=load[1], hmd=load[2], u=u)
    assert np.degrees(np.abs(log["delta"] + 0.1).max()) < 1e-10


@both
def test_five_substeps_are_enough(own):
    """Refinement: against 160 sub-steps the surface agrees to a fraction of what its sensor resolves."""
    for values, u, limit_deg in own.refined:
        fine, coarse = (alone(own.module, 6.0, p=own.module.params(**values, substeps=n), u=u, hm0=-500.0, hmd=-15e3)
                        for n in (160, 5))  # fmt: skip
        assert np.degrees(np.abs(fine["delta"] - coarse["delta"]).max()) < limit_deg


@both
def test_what_is_stuck_does_not_creep(own):
    """Below the friction at rest nothing moves at all, above it it breaks away; the EMA's surface winds its spring."""
    free = 1.0 if own is HYDRAULIC else 0.0
    for share, moves in ((0.95, False), (1.05, True)):
        moment = share * own.rest * np.minimum(np.arange(1000) / 500, 1.0)
        log = alone(own.module, 5.0, hm0=moment, free_float=free)
        assert (np.abs(log[own.moved]).max() > 0.0) == moves


@both
def test_stops_at_the_travel(own):
    for sign, stop in ((1.0, 17.0), (-1.0, -23.0)):
        log = alone(own.module, 4.0, u=sign * (0.2 if own is HYDRAULIC else 20.0))
        assert log[own.moved][-1] / own.per_rad == pytest.approx(math.radians(stop), abs=1e-9)
        assert np.degrees(log["delta"][-1]) == pytest.approx(stop, abs=0.01)


@both
def test_every_fault_shows_and_heals(own):
    healthy = own.fly(COMMAND, **LOAD)[0]
    for fault, least in own.faults:
        log = own.fly(COMMAND, **LOAD, faults=between(**fault))[0]
        off = np.degrees(np.abs(log["delta"] - healthy["delta"]))
        assert off[:600].max() == 0.0 and off[600:1200].max() > least, fault
        assert off[1600:].max() < 0.05, fault  # 2 s after healing; what remains is another phase of stick and slip
        assert np.all(log["status"] == 0.0), fault


@both
def test_jam_stops_the_surface_where_it_is(own):
    log = own.fly(COMMAND, **LOAD, faults=between(jam=1.0))[0]
    held = np.degrees(log["delta"][620:1199])
    assert np.ptp(held) == 0.0 and abs(held[0] - np.degrees(log["delta"][600])) < 0.1


@both
def test_free_float_trails_on_the_hinge_moment(own):
    """Let go, the surface goes to hm0 + hmd delta = 0 within the friction over hmd, and stays there."""
    log = alone(own.module, 15.0, start=(0.2, 0.0, 0.0), hm0=-1500.0, hmd=-15e3, u=0.2, free_float=1.0)
    assert log["delta"][-1] == pytest.approx(-0.1, abs=own.float_error)
    assert np.ptp(log[own.moved][-200:]) == 0.0


@both
def test_bad_inputs_are_taken_as_zero_and_reported(own):
    hm, u = np.full(400, -500.0), np.zeros(400)
    hm[100:110], u[200:210] = np.nan, np.inf
    log = alone(own.module, 2.0, hm0=hm, u=u)
    assert np.isfinite(log["delta"]).all() and np.isfinite(log[own.moved]).all()
    assert np.flatnonzero(log["status"] == 1.0).tolist() == [*range(100, 110), *range(200, 210)]


# -- the hydraulic one


def running(u=0.1, seconds=4.0, friction=FREE, **faults):
    """Return the log of a rod far from its stops that runs at a constant valve."""
    return alone(hydraulic, seconds, p=hydraulic.params(**friction, q_lo=-1.0, q_hi=1.0), u=u, **faults)


@pytest.mark.parametrize(("fault", "share"), [({}, 1.0), ({"loss": 0.5}, 0.5), ({"supply_drop": 0.5}, math.sqrt(0.5))])
def test_no_load_speed_is_one_metre_per_second_of_valve_and_falls_with_flow_and_supply(fault, share):
    """Less what damping and leakage take (52.3 N s/m on 35 kN: 1e-5 of it); by the orifice equation."""
    assert running(**fault)["qd_rod"][-20:].mean() == pytest.approx(0.1 * share, rel=2e-3)


def test_lost_effectiveness_does_not_weaken_lost_supply_does():
    for fault, x3 in (({"loss": 0.5}, 1.0), ({"supply_drop": 0.5}, 0.5)):
        log = alone(hydraulic, 4.0, u=0.2, jam=1.0, **fault)
        assert log["x3"][-1] == pytest.approx(x3, abs=0.08)  # leakage takes (L / (0.5 u))^2 of it


def test_coulomb_friction_takes_its_force():
    """At constant speed the pressure carries F_c, 350 N; derived from the steady state of the rod's equation."""
    log = running(friction={})
    v = log["qd_rod"][-1]
    assert log["x3"][-1] * 35e3 == pytest.approx(350.0 + 100.0 / (1 + (v / 0.01) ** 2) + 52.3 * v, rel=1e-3)


def test_the_spool_stops_and_a_fault_adds_to_the_command_or_replaces_it():
    assert running(5.0, 0.3)["u_eff"][-1] == pytest.approx(math.radians(45) * 0.30)
    assert running(0.05, 0.05, f_u=0.02)["u_eff"][-1] == pytest.approx(0.07)
    log = alone(hydraulic, 2.0, u=0.2, s_u=1.0, f_u=-math.radians(5.0) * 0.30)
    assert (log["delta"][-1] - log["delta"][100]) / (299 * DT) == pytest.approx(-math.radians(5.0), rel=0.02)


def test_a_rod_at_its_stop_pushes_with_what_the_leakage_leaves():
    log, ratio = alone(hydraulic, 3.0, u=0.2), (0.023 / 0.2) ** 2  # u sqrt(1 - x3) = L x3
    assert log["x3"][-1] == pytest.approx((math.sqrt(1 + 4 * ratio) - 1) / (2 * ratio), rel=1e-6)


def test_leakage_lets_the_surface_sag():
    """A closed valve under load sags at (L + leak) x3 metres per second of rod."""
    p = hydraulic.params(**FREE)
    log = alone(hydraulic, 1.0, p=p, start=(0.0, -3000.0, 0.0), hm0=-3000.0, leak_add=0.05)
    assert log["qd_rod"][-50:].mean() == pytest.approx(-(0.023 + 0.05) * 10e3 / 35e3, rel=0.01)


def test_air_in_the_oil_lowers_the_oil_mode():
    """The oil mode goes with the root of the bulk modulus: 56.3 rad/s becomes 28.1 at a quarter."""
    for air, expected in ((0.0, 56.3), (0.75, 28.15)):
        log = alone(hydraulic, 2.0, p=hydraulic.params(**FREE, L=1e-4), hm0=-300.0, air=air)
        v = log["qd_rod"] - log["qd_rod"][-100:].mean()
        crossings = np.flatnonzero(np.diff(np.sign(v)))
        assert math.pi / (np.diff(crossings[:12]).mean() * DT) == pytest.approx(expected, rel=0.03)


def test_backlash_separates_surface_from_rod():
    """Behind a gap of 0.5 degrees the surface leans where the load pushes, and crosses when the load turns."""
    gap = math.radians(0.5)
    hm = np.where(np.arange(400) < 200, 500.0, -500.0)
    log = alone(hydraulic, 2.0, p=hydraulic.params(backlash=gap), hm0=hm, jam=1.0)
    offset = log["delta"] - log["q_rod"] / linkage.ARM
    assert offset[[150, -1]] == pytest.approx([gap / 2, -gap / 2])


def test_truth_without_extras_is_equation_four():
    """Without friction and load the flying actuator is `lu17.rk4` in five sub-steps, but for a split at reversals."""
    p, u, x = hydraulic.params(**FREE), 0.1 * np.sin(7 * T[:400]), (0.0, 0.0, 0.0)
    log = alone(hydraulic, 2.0, p=p, u=u)
    for k in range(400):
        for _ in range(5):
            x = lu17.rk4(*x, u[k], u[k], 0.0, 0.0, p[0], DT / 5)
        assert log["q_rod"][k] == pytest.approx(x[0], abs=1e-8)


# -- the electromechanical one

WHITE = 5 * np.sin(0.05 * np.arange(400)) + np.random.default_rng(1).normal(size=400)


def error(kind, hm0, hmd, params, faults=None, **symbols):
    """Return the largest error of each state over its largest value, against the linear model's matrix exponential."""
    log = alone(ema, 2.0, p=params, u=WHITE, hm0=hm0, hmd=hmd, **(faults or {}))
    m = jay.continuous(kind, hinge_stiffness=hmd, **symbols)
    Phi, Gamma = jay.discretise(m.A, np.column_stack([m.B, m.E]), DT)
    z, exact = np.zeros(6), np.zeros((len(WHITE), 6))
    for k, u in enumerate(WHITE):
        exact[k] = z = Phi @ z + Gamma @ np.array([u, hm0])
    return np.array([np.abs(log[n] - exact[:, i]).max() for i, n in enumerate(STATES)]) / np.abs(exact).max(axis=0)


@pytest.mark.parametrize("kind, hm0, hmd", [("nozzle", 0, 0), ("elevator", 100.0, 0.0), ("elevator", 100.0, -26e3)])
def test_unlimited_model_is_the_matrix_exponential(kind, hm0, hmd):
    """White demand at every tick: angles to 5e-6 of their size, motor rate and current to 5e-5, compensator exactly."""
    off = error(kind, hm0, hmd, ema.params(kind, **UNLIMITED))
    assert np.all(off < [5e-6, 2e-4, 5e-6, 5e-5, 5e-5, 1e-12]), off  # the surface rings on its spring, 35 Hz


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
    off = error("elevator", 0.0, -15e3, ema.params(**UNLIMITED), fault, **symbols)
    assert np.all(off[[0, 2]] < 5e-6) and np.all(off[3:5] < 5e-5), off


def test_error_falls_with_the_substep():
    steps = [2, 5, 10, 20]
    errors = [error("elevator", 0.0, -26e3, ema.params(**UNLIMITED, substeps=n))[2] for n in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] < -2.5


def test_published_phi_and_g_drive_the_nozzle():
    """The paper's own matrices against the flying nozzle over one tick, from each unit state and a unit input."""
    p = ema.params("nozzle")
    for j, printed in enumerate([*jay.PHI.T, jay.G]):
        x, u = ema.init_at(p), np.zeros((1, 1), ema.INPUTS)
        (x if j < 6 else u)[[*STATES, "u"][j]] = 1.0
        ema.rollout(x, u, p, DT)
        got, some = np.array([x[n][0] for n in STATES]), printed != 0
        limit = np.where(printed[some] == -17.9, 4e-3, 3e-4)  # the one entry of three digits
        assert np.all(np.abs(got[some] / printed[some] - 1) < limit)


def test_no_load_speed_is_limited_by_the_voltage_and_rises_as_magnets_fade():
    for loss, u, expected in ((0.0, 200.0, 45.35), (0.3, 300.0, 45.35 / 0.7)):  # 285 V / 0.6 V s/rad / 600
        log = alone(ema, 0.6, p=ema.params(**{**UNLIMITED, "V_max": 285.0}), u=u, magnet_loss=loss)
        assert np.degrees(log["motor_d"][-1] / 600) == pytest.approx(expected, abs=0.5)
        assert log["mode"][-1] == 2.0 and abs(log["volts"][-1]) <= 285.0


def test_magnet_loss_lowers_the_stall_and_the_current_stays_in_its_limit():
    for share, moves in ((0.69, True), (0.71, False)):
        p, load = ema.params(**EMA.smooth), -share * STALL
        log = alone(ema, 3.0, p=p, start=(0.0, load, 0.0), hm0=load, u=90.0, magnet_loss=0.3)
        assert (log["motor"][-1] > log["motor"][0]) == moves
        assert np.abs(log["i"]).max() <= 43.75 * (1 + 1e-9)


def test_resistance_rise_takes_its_share_of_the_current():
    """R is 2.4 per cent of the current loop's resistance: twice the winding takes 2.4 per cent of the current."""
    log = alone(ema, 1.0, p=ema.params(**UNLIMITED), u=10.0, r_add=1.0, jam_screw=1.0)
    assert log["i"][-1] == pytest.approx(10.0 * 9.6 / (9.6 + 0.48), rel=1e-9)
