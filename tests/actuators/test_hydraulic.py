"""The flying hydraulic actuator: accuracy, friction, stops, and every fault doing what its name says."""

import math

import numpy as np
import pytest
from actuator_loops import COMMAND, DT, LOAD, alone, between, fly_hydraulic

from actuators.common import linkage
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import lu17

FREE = {"F_c": 0.0, "F_s": 0.0}
T = np.arange(1200) * DT


def test_published_figures_of_the_flying_actuator():
    A, _ = lu17.linear(lu17.params()[0])
    poles = np.sort_complex(np.linalg.eigvals(A))
    assert poles[-1] == 0
    assert poles[1].real == pytest.approx(-2.09, abs=0.005)
    assert abs(poles[1].imag) == pytest.approx(56.2, abs=0.05)


def test_no_load_speed_is_one_metre_per_second_of_valve():
    """At 0.1 of u the rod runs at 0.1 m/s, less what damping and leakage take (52.3 N s/m on 35 kN: 1e-5 of it)."""
    log = alone(hydraulic, 4.0, p=hydraulic.params(**FREE, q_lo=-1.0, q_hi=1.0), u=0.1)
    assert log["qd_rod"][-20:].mean() == pytest.approx(0.1, rel=1e-3)


def test_stall_at_35_kn():
    """One per cent of load below the stall the rod still extends, one above it does not; leakage left out."""
    p = hydraulic.params(**FREE, L=0.0)
    stall = 35e3 * linkage.ARM
    assert stall == pytest.approx(10.5e3)
    for share, moves in ((0.99, True), (1.01, False)):
        log = alone(hydraulic, 2.0, p=p, start=(0.0, -share * stall, 0.0), hm0=-share * stall, u=p["u_max"][0])
        assert (log["q_rod"][-1] > 0.005) == moves


def test_load_equilibrium_stays_for_a_minute():
    p = hydraulic.params()
    x = hydraulic.init_at(p, -0.1, -2000.0, -15e3)
    log = alone(hydraulic, 60.0, start=(-0.1, -2000.0, -15e3), hm0=-2000.0, hmd=-15e3, u=x["u_eff"][0])
    assert np.abs(log["delta"] + 0.1).max() == 0.0


@pytest.mark.parametrize(
    "u, limit_deg",
    [
        (0.15 * np.sin(4.4 * T) + 0.01 * np.sin(38 * T), 1e-4),  # manoeuvre with ripple
        (0.02 * np.sin(1.9 * T), 1e-4),  # slow reversals, stick and slip
        (0.236 * np.sign(np.sin(1.6 * T)), 1e-3),  # bang-bang into both stops
    ],
)
def test_five_substeps_are_enough(u, limit_deg):
    """Refinement: against 160 sub-steps the surface agrees to a hundredth of what its sensor resolves."""
    fine, coarse = (
        alone(hydraulic, 6.0, p=hydraulic.params(substeps=n), u=u, hm0=-500.0, hmd=-15e3)["delta"] for n in (160, 5)
    )
    assert np.degrees(np.abs(fine - coarse).max()) < limit_deg


def test_a_stuck_rod_does_not_creep():
    """Below the static friction nothing moves at all; above it the rod breaks away."""
    for force, moves in ((430.0, False), (470.0, True)):
        log = alone(hydraulic, 5.0, p=hydraulic.params(L_bypass=1.0), hm0=force * linkage.ARM, free_float=1.0)
        assert (np.abs(log["q_rod"]).max() > 0.0) == moves


def test_coulomb_friction_takes_its_force():
    """At constant speed the pressure carries F_c, 350 N; derived from the steady state of the rod's equation."""
    log = alone(hydraulic, 4.0, u=0.1, p=hydraulic.params(q_lo=-1.0, q_hi=1.0))
    v = log["qd_rod"][-1]
    expected = 350.0 + 100.0 / (1 + (v / 0.01) ** 2) + 52.3 * v
    assert log["x3"][-1] * 35e3 == pytest.approx(expected, rel=1e-3)


def test_stops_at_the_travel():
    for u, stop in ((0.2, 17.0), (-0.2, -23.0)):
        log = alone(hydraulic, 3.0, u=u)
        assert np.degrees(log["delta"][-1]) == pytest.approx(stop, abs=1e-9)
        assert np.all(np.degrees(u / 0.2 * log["delta"]) <= abs(stop) + 1e-9)
        ratio = (0.023 / 0.2) ** 2  # the valve feeds the leakage: u sqrt(1 - x3) = L x3
        assert abs(log["x3"][-1]) == pytest.approx((math.sqrt(1 + 4 * ratio) - 1) / (2 * ratio), rel=1e-6)


def test_spool_stops_at_45_degrees_per_second():
    log = alone(hydraulic, 0.3, p=hydraulic.params(**FREE), u=5.0)
    assert log["u_eff"][-1] == pytest.approx(math.radians(45) * 0.30)


def test_runaway_and_solid_ofc_replace_liquid_adds():
    rate = math.radians(5.0)
    log = alone(hydraulic, 2.0, u=0.2, s_u=1.0, f_u=-rate * 0.30)
    assert (log["delta"][-1] - log["delta"][100]) / (299 * DT) == pytest.approx(-rate, rel=0.02)
    log = alone(hydraulic, 0.05, u=0.05, f_u=0.02)
    assert log["u_eff"][-1] == pytest.approx(0.07)


@pytest.fixture(scope="module")
def healthy():
    return fly_hydraulic(COMMAND, **LOAD)[0]


@pytest.mark.parametrize(
    "fault",
    [
        {"jam": 1.0}, {"free_float": 1.0}, {"loss": 0.6}, {"supply_drop": 0.7}, {"leak_add": 0.3}, {"air": 0.9},
        {"f_u": 0.02}, {"s_u": 1.0, "f_u": 0.01},
    ],
    ids=lambda f: "+".join(f),
)  # fmt: skip
def test_every_fault_shows_and_heals(fault, healthy):
    log = fly_hydraulic(COMMAND, **LOAD, faults=between(**fault))[0]
    difference = np.degrees(np.abs(log["delta"] - healthy["delta"]))
    assert difference[:600].max() == 0.0
    assert difference[600:1200].max() > 0.1
    assert difference[1600:].max() < 0.05  # 2 s after healing; what remains is another phase of stick and slip
    assert np.all(log["status"] == 0.0)


def test_jam_stops_the_surface_where_it_is():
    log = fly_hydraulic(COMMAND, **LOAD, faults=between(jam=1.0))[0]
    held = np.degrees(log["delta"][620:1199])
    assert np.ptp(held) == 0.0
    assert abs(held[0] - np.degrees(log["delta"][600])) < 0.1
    assert np.abs(log["x3"][620:1199]).max() > 0.5  # the servo pushes against it


def test_free_float_trails_on_the_hinge_moment():
    """With the bypass open the surface goes to hm0 + hmd delta = 0 within friction, 450 N on the arm over hmd."""
    p = hydraulic.params()
    log = alone(hydraulic, 8.0, p=p, start=(0.2, 0.0, 0.0), hm0=-1500.0, hmd=-15e3, u=0.2, free_float=1.0)
    assert log["delta"][-1] == pytest.approx(-0.1, abs=450 * 0.3 / 15e3)
    assert np.ptp(log["delta"][-200:]) == 0.0


def test_loss_of_effectiveness_slows_and_does_not_weaken():
    for loss in (0.0, 0.5):
        log = alone(hydraulic, 4.0, p=hydraulic.params(**FREE, q_lo=-1.0, q_hi=1.0), u=0.1, loss=loss)
        assert log["qd_rod"][-20:].mean() == pytest.approx(0.1 * (1 - loss), rel=1e-3)
    log = alone(hydraulic, 3.0, u=0.2, loss=0.5, jam=1.0)
    assert log["x3"][-1] == pytest.approx(1.0, abs=0.08)  # leakage takes (L / (0.5 u))^2 of it


def test_supply_drop_lowers_stall_and_speed():
    """Stall in proportion, no-load speed by the root: derived from the orifice equation."""
    log = alone(hydraulic, 4.0, u=0.2, supply_drop=0.5, jam=1.0)
    assert log["x3"][-1] == pytest.approx(0.5, abs=0.02)
    log = alone(hydraulic, 4.0, p=hydraulic.params(**FREE, q_lo=-1.0, q_hi=1.0), u=0.1, supply_drop=0.5)
    assert log["qd_rod"][-20:].mean() == pytest.approx(0.1 * math.sqrt(0.5), rel=2e-3)


def test_leakage_lets_the_surface_sag():
    """A closed valve under load sags at (L + leak) x3 metres per second of rod."""
    p = hydraulic.params(**FREE)
    log = alone(hydraulic, 1.0, p=p, start=(0.0, -3000.0, 0.0), hm0=-3000.0, leak_add=0.05)
    x3 = 10e3 / 35e3
    assert log["qd_rod"][-50:].mean() == pytest.approx(-(0.023 + 0.05) * x3, rel=0.01)


def test_air_in_the_oil_lowers_the_oil_mode():
    """The oil mode goes with the root of the bulk modulus: 56.3 rad/s becomes 28.1 at a quarter."""
    for air, expected in ((0.0, 56.3), (0.75, 28.15)):
        p = hydraulic.params(**FREE, L=1e-4)
        log = alone(hydraulic, 2.0, p=p, hm0=-300.0, air=air)
        v = log["qd_rod"] - log["qd_rod"][-100:].mean()
        crossings = np.flatnonzero(np.diff(np.sign(v)))
        assert math.pi / (np.diff(crossings[:12]).mean() * DT) == pytest.approx(expected, rel=0.03)


def test_backlash_separates_surface_from_rod():
    """Behind a gap of 0.5 degrees the surface leans where the load pushes, and crosses when the load turns."""
    gap = math.radians(0.5)
    hm = np.where(np.arange(400) < 200, 500.0, -500.0)
    log = alone(hydraulic, 2.0, p=hydraulic.params(backlash=gap), hm0=hm, jam=1.0)
    offset = log["delta"] - log["q_rod"] / linkage.ARM
    assert offset[150] == pytest.approx(gap / 2)
    assert offset[-1] == pytest.approx(-gap / 2)


def test_bad_inputs_are_taken_as_zero_and_reported():
    hm = np.full(400, -500.0)
    hm[100:110] = np.nan
    u = np.zeros(400)
    u[200:210] = np.inf
    log = alone(hydraulic, 2.0, hm0=hm, u=u)
    assert np.all(np.isfinite(log["delta"]))
    assert np.flatnonzero(log["status"] == 1.0).tolist() == [*range(100, 110), *range(200, 210)]


def test_truth_without_extras_is_equation_four():
    """Without friction and load the flying actuator is `lu17.rk4` in five sub-steps, but for a split at reversals."""
    p = hydraulic.params(**FREE)
    u = 0.1 * np.sin(7 * T[:400])
    log = alone(hydraulic, 2.0, p=p, u=u)
    x = (0.0, 0.0, 0.0)
    for k in range(400):
        for _ in range(5):
            x = lu17.rk4(*x, u[k], u[k], 0.0, 0.0, p[0], DT / 5)
        assert log["q_rod"][k] == pytest.approx(x[0], abs=1e-8)
