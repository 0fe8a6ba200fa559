"""The aircraft against its reference: trims, modes, inertia, stall margin, provenance."""

import math
from pathlib import Path

import numpy as np
import pytest
from transport_data import FLIGHT_CONDITIONS
from transport_fit import build

from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import POINTS, FlightPoint, Plant
from cosim.scenario.aircraft import load_aircraft

ROOT = Path(__file__).resolve().parents[2]
CRUISE_T = 636636.0 * 0.45359237e-3  # mass of every condition [t]

# Modes recomputed from table IX-4 of NASA CR-2144: phugoid wn, zeta, short period wn, zeta
REFERENCE = {
    3: (0.0753, 0.0310, 1.3641, 0.5754), 4: (0.0368, 0.1100, 1.6359, 0.6370), 6: (0.0652, 0.0260, 1.2565, 0.4722),
    8: (0.0781, 0.0633, 0.8798, 0.3565), 9: (0.0673, 0.0485, 0.9616, 0.3866),
}  # fmt: skip


@pytest.fixture(scope="module")
def models():
    return {
        key: linearize(FlightPoint.at(CRUISE_T, 25.0, c.altitude_ft, mach=c.mach))
        for key, c in FLIGHT_CONDITIONS.items()
    }


def _mode(model, name):
    return next(m for m in model.modes if m.name == name)


@pytest.mark.parametrize("key", REFERENCE)
def test_longitudinal_modes_at_the_reference_conditions(models, key):
    phugoid, short = _mode(models[key], "phugoid"), _mode(models[key], "short_period")
    ph_wn, ph_zeta, sp_wn, sp_zeta = REFERENCE[key]
    assert phugoid.wn == pytest.approx(ph_wn, rel=0.05)
    assert phugoid.zeta == pytest.approx(ph_zeta, abs=0.015)
    assert short.wn == pytest.approx(sp_wn, rel=0.05)
    assert short.zeta == pytest.approx(sp_zeta, abs=0.03)


@pytest.mark.parametrize("key", FLIGHT_CONDITIONS)
def test_trim_angle_of_attack(models, key):
    assert math.degrees(models[key].trim.alpha) == pytest.approx(FLIGHT_CONDITIONS[key].alpha_deg, abs=0.5)


def test_lateral_modes_at_condition_9_printed_in_the_report(models):
    m = models[9]
    assert _mode(m, "dutch_roll").wn == pytest.approx(0.947, rel=0.05)
    assert _mode(m, "dutch_roll").zeta == pytest.approx(0.0349, abs=0.01)
    assert _mode(m, "roll").wn == pytest.approx(0.562, rel=0.10)
    assert _mode(m, "spiral").eigenvalue.real == pytest.approx(-0.0073, abs=0.002)


def test_elevator_effect_at_condition_9(models):
    """[CR-2144] table IX-4: M_de -1.16 1/s2, Z_de -17.9 ft/s2, to the 3 % of the fit and the alpha-dot share of M."""
    m = models[9]
    i, j = list(m.states), slice(0, 4)
    V = m.trim.tas
    Z = m.B[i.index("alpha"), j].sum() * V / 0.3048
    assert Z == pytest.approx(-17.9, rel=0.05)
    assert m.B[i.index("q"), j].sum() == pytest.approx(-1.16 + 0.000116 * 17.9, rel=0.05)


@pytest.mark.parametrize("name", POINTS)
def test_six_points_have_more_than_1_3_g(name):
    """Pull to 15 degrees with the pitching moment balanced by the elevators: lift of at least 1.3 weights."""
    plant = Plant(POINTS[name])
    trim = plant.trim()
    best = 0.0
    for alpha in np.radians(np.arange(8.0, 19.0, 1.0)):
        elevator = 0.0
        for _ in range(6):
            nz, moment = _pulled(plant, trim, alpha, elevator)
            slope = (_pulled(plant, trim, alpha, elevator + 0.01)[1] - moment) / 0.01
            elevator -= moment / slope
        assert abs(math.degrees(elevator)) < 23.0
        best = max(best, nz)
    assert best > 1.3


def _pulled(plant, trim, alpha, elevator):
    surfaces = trim.surfaces.copy()
    surfaces[plant.border.column(plant.border.elevators)] = elevator
    plant.place(
        tas=trim.tas, alpha=alpha, theta=alpha, altitude=trim.altitude, q=0.3 * 9.81 / trim.tas, surfaces=surfaces
    )
    t = plant.truth()[0]
    return t.nz * math.cos(alpha) + t.nx * math.sin(alpha), t.qdot


@pytest.mark.parametrize(("mass_t", "cg_pct"), [(CRUISE_T, 25.0), (200.0, 30.0), (260.0, 36.0), (405.0, 25.0)])
def test_mass_cg_and_radii_of_gyration(mass_t, cg_pct):
    """At 288.8 t and 25 % the inertia of CR-2144, table IX-1; elsewhere mass times the same radii squared."""
    gyration2 = dict(load_aircraft().mass.gyration2_m2)
    printed = {"xx": 18.2e6, "yy": 33.1e6, "zz": 49.7e6, "xz": 0.970056e6}  # slug ft2
    plant = Plant(FlightPoint.at(mass_t, cg_pct, 20000.0, cas_kt=280.0))
    t = plant.truth()[0]
    assert t.mass == pytest.approx(mass_t * 1e3, rel=1e-7)  # JSBSim converts pounds to slugs with nine digits
    assert t.cg == pytest.approx(cg_pct / 100.0, abs=1e-9)
    for axis in ("xx", "yy", "zz"):
        inertia = plant.port.get(f"inertia/i{axis}-slugs_ft2") * 1.3558179483314
        assert inertia == pytest.approx(gyration2[axis] * t.mass, rel=2e-5)
        assert gyration2[axis] * 1e3 * CRUISE_T == pytest.approx(1.3558179 * printed[axis], rel=1e-2)
    # JSBSim shows the element of the inertia matrix, minus the integral of x z
    assert plant.port.get("inertia/ixz-slugs_ft2") * -1.3558179483314 == pytest.approx(
        gyration2["xz"] * t.mass, rel=2e-3
    )


def test_files_on_disk_are_what_the_fit_makes():
    assert all(path.read_text() == text for path, text in build().items())


def test_flies_alone_in_plain_jsbsim():
    """Without our Python: trim on JSBSim's own commands, 10 s hands off, elevator command down pitches down."""
    import jsbsim

    fdm = jsbsim.FGFDMExec(None)
    fdm.set_aircraft_path(str(ROOT / "aircraft"))
    assert fdm.load_model("transport")
    fdm["ic/h-sl-ft"], fdm["ic/vc-kts"], fdm["ic/gamma-deg"] = 20000.0, 290.0, 0.0
    fdm["propulsion/set-running"] = -1
    assert fdm.run_ic()
    fdm.do_trim(0)
    theta = fdm["attitude/theta-rad"]
    for _ in range(1200):
        fdm.run()
    assert fdm["attitude/theta-rad"] == pytest.approx(theta, abs=0.002)
    fdm["fcs/elevator-cmd-norm"] = 0.1
    for _ in range(120):
        fdm.run()
    assert fdm["velocities/q-rad_sec"] < -0.005
