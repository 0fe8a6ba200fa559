"""Climb, descent and turn as starting conditions: trimmed by the equations of steady flight, held, or refused."""

import math

import numpy as np
import pytest

import cosim
from actuators.constants import G0, M_PER_FT
from cosim.errors import ScenarioError, TrimError
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint

FPM = M_PER_FT / 60.0
ENVELOPE = [  # aircraft, t, % MAC, ft, kt CAS
    ("transport", 210.0, 26.0, 3000.0, 220.0), ("transport", 250.0, 33.0, 15000.0, 300.0),
    ("transport", 300.0, 29.0, 25000.0, 280.0), ("transport", 340.0, 34.0, 10000.0, 330.0),
    ("transport", 390.0, 27.0, 8000.0, 280.0), ("transport", 230.0, 35.0, 36000.0, 260.0),
    ("narrowbody", 62.0, 25.0, 12000.0, 270.0), ("narrowbody", 70.0, 22.0, 30000.0, 260.0),
]  # fmt: skip
STARTS = [
    {"climb_fpm": 700.0}, {"climb_fpm": -600.0}, {"gamma_deg": 1.2}, {"bank_deg": 25.0}, {"bank_deg": -33.0},
    {"turn_deg_s": 1.2}, {"climb_fpm": 400.0, "bank_deg": -15.0}, {"gamma_deg": -1.0, "turn_deg_s": -0.9},
]  # fmt: skip


def scenario(where, start, *more):
    name, mass, cg, h, cas = where
    keys = {"aircraft": f"'{name}'", "mass_t": mass, "cg_pct": cg, "altitude_ft": h, "cas_kt": cas, **start}
    fixed = ["flight.turbulence=none", "detectors.enabled=[]", *more]
    return cosim.load_scenario("cruise", [*(f"flight.{k}={v}" for k, v in keys.items()), *fixed])


def in_earth_axes(t, f):
    """Return a vector of body axes (x forward, y right, z down) in axes north, east, down of attitude t."""
    cf, sf, ct, st = math.cos(t.phi), math.sin(t.phi), math.cos(t.theta), math.sin(t.theta)
    return np.array([[ct, sf * st, cf * st], [0.0, cf, -sf], [-st, sf * ct, cf * ct]]) @ f


@pytest.mark.parametrize("where", ENVELOPE, ids=lambda w: f"{w[0]}-{w[1]:g}t")
def test_the_trim_fulfils_the_equations_of_steady_flight(where):
    """n = 1/cos(bank), turn = g tan(bank)/V, sin(gamma) = climb/TAS, thrust less drag = weight times sin(gamma)."""
    level = Plant(FlightPoint.of(scenario(where, {})))
    level.trim()
    rest = level.truth()[0]
    thrust = lambda t: sum(t[n] for n in t.dtype.names if n.startswith("thrust_"))  # noqa: E731
    for start in STARTS:
        plant = Plant(FlightPoint.of(scenario(where, start)))
        trim, t = plant.trim(), plant.truth()[0]
        assert trim.residual < 1e-8 and abs(t.beta) < 1e-9, start
        climb = start.get("climb_fpm", 0.0) * FPM or trim.tas * math.sin(math.radians(start.get("gamma_deg", 0.0)))
        assert t.hdot == pytest.approx(climb, abs=1e-6) and math.sin(t.gamma) == pytest.approx(climb / t.tas, abs=1e-9)
        if "bank_deg" in start:
            assert t.phi == pytest.approx(math.radians(start["bank_deg"]), abs=1e-12)
        if "turn_deg_s" in start:
            assert trim.turn == pytest.approx(math.radians(start["turn_deg_s"]), abs=1e-12)
        ground = t.tas * math.cos(t.gamma)
        assert trim.turn == pytest.approx(G0 * math.tan(t.phi) / ground, rel=0.05, abs=2e-5), start
        going, force = (in_earth_axes(t, np.array(v)) for v in ((t.u, t.v, t.w), (t.nx, t.ny, -t.nz)))
        north, east = going[:2] / ground
        ahead, aside = north * force[0] + east * force[1], north * force[1] - east * force[0]
        assert -force[2] == pytest.approx(1.0, abs=0.01) and abs(ahead) < 0.001, start  # held up, not accelerated
        assert aside == pytest.approx(ground * trim.turn / G0, abs=0.005), start  # and drawn into the turn
        assert math.hypot(aside, force[2]) == pytest.approx(1.0 / math.cos(t.phi), rel=0.02), start
        if trim.turn == 0.0:
            more = rest.mass * G0 * math.sin(t.gamma)
            assert thrust(t) - thrust(rest) == pytest.approx(more, rel=0.06), start


HELD = [({"climb_fpm": 1000.0}, ENVELOPE[0]), ({"climb_fpm": -900.0}, ENVELOPE[3]), ({"bank_deg": 28.0}, ENVELOPE[1]),
        ({"turn_deg_s": -1.1, "climb_fpm": 300.0}, ENVELOPE[2]), ({"bank_deg": -20.0}, ENVELOPE[6]),
        ({"gamma_deg": -1.5}, ENVELOPE[7])]  # fmt: skip


@pytest.mark.parametrize(("start", "where"), HELD, ids=lambda v: next(iter(v)) if isinstance(v, dict) else v[0])
def test_the_law_holds_bank_path_and_speed_from_the_first_tick(start, where):
    names = {n: f"truth.aircraft.{n}" for n in ("hdot", "phi", "cas", "nz", "beta")}
    f = cosim.fly(scenario(where, start, "duration_s=40"), list(names.values()))
    seen = {n: f[path].to_numpy() for n, path in names.items()}
    assert f.attrs["status"] == "completed"
    assert np.ptp(seen["hdot"]) < 0.3 and np.ptp(seen["cas"]) < 0.5
    assert np.degrees(np.ptp(seen["phi"])) < 0.6 and np.degrees(np.abs(seen["beta"]).max()) < 0.1
    assert np.ptp(seen["nz"]) < 0.015
    assert abs(f.to_numpy()[-1, 0] - f.to_numpy()[0, 0]) < 0.2


def test_a_manoeuvre_from_a_turn_ends_as_it_says_and_a_table_of_inputs_holds_the_bank():
    roll_out = ["manoeuvre.kind=coordinated_turn", "manoeuvre.start_s=2", "manoeuvre.duration_s=10"]
    path = ["truth.aircraft.phi", "pilot.pilot.phi_dem"]
    f = cosim.fly(scenario(ENVELOPE[1], {"bank_deg": 20.0}, *roll_out, "manoeuvre.bank_deg=30", "duration_s=30"), path)
    phi = np.degrees(f[path[0]].to_numpy())
    assert abs(phi[200] - 20.0) < 0.5 and abs(phi[2200] - 30.0) < 1.0 and abs(phi[-1]) < 1.0
    table = ["manoeuvre.kind=inputs", "manoeuvre.time_s=[0, 3, 4]", "manoeuvre.nz_g=[0, 0, 0.1]", "duration_s=6"]
    f = cosim.fly(scenario(ENVELOPE[1], {"bank_deg": 20.0}, *table), path)
    assert np.abs(np.degrees(f[path[0]].to_numpy()) - 20.0).max() < 1.0


LOW = ("transport", 260.0, 28.0, 12500.0, 212.0)


@pytest.mark.parametrize(("where", "start", "said"), [
    (ENVELOPE[2], {"climb_fpm": 5000.0}, r"thrust: the engines cannot hold a climb at \+\d"),
    (ENVELOPE[2], {"climb_fpm": -5500.0}, r"thrust: even idle thrust is too much for a descent at -\d"),
    (("transport", 375.0, 28.0, 27500.0, 215.0), {"bank_deg": 60.0}, "stall: a bank of 60 deg needs a lift"),
    (LOW, {"bank_deg": 57.0}, "aileron: -2.* deg needed"),
    (LOW, {"bank_deg": 50.0}, r"bank: 50.0 deg, beyond .*allowed: -\d\d to \d\d"),
])  # fmt: skip
def test_what_cannot_be_flown_is_refused_with_its_reason(where, start, said):
    with pytest.raises(TrimError, match=said):
        cosim.fly(scenario(where, start))


@pytest.mark.parametrize(("keys", "said"), [
    (["flight.climb_fpm=7000"], r"flight\.climb_fpm = 7000: is out of range; allowed: -6000 to 6000"),
    (["flight.bank_deg=61"], r"flight\.bank_deg = 61: is out of range; allowed: -60 to 60"),
    (["flight.gamma_deg=nan"], r"flight\.gamma_deg"),
])  # fmt: skip
def test_starts_out_of_range_are_refused(keys, said):
    with pytest.raises(ScenarioError, match=said):
        cosim.load_scenario("cruise", keys)
