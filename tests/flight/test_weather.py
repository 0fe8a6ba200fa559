"""Wind, shear, discrete gusts, turbulence that changes: forms of the specifications, and what the aircraft meets."""

import math

import numpy as np
import pytest
from test_gusts import AIRCRAFT, air

from actuators.constants import M_PER_FT, M_S_PER_KT
from cosim.errors import ScenarioError
from cosim.flight.build import build
from cosim.flight.fly import record
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import POINTS, FlightPoint, Plant
from cosim.scenario import load_scenario

DOWN = 2
WINDS = {"ahead": (-25.0, 0.0), "behind": (25.0, 0.0), "right": (0.0, -25.0), "left": (5.0, 25.0)}
STARTS = ({}, {"bank": 0.4}, {"climb": 3.0, "bank": -0.3})
RAISED = {"longitudinal": "tas", "lateral": "beta", "vertical": "alpha"}


def point(**changed):
    return FlightPoint(**{**vars(POINTS["E"]), **changed})


def flown(flight, seconds):
    """Return the truth of every tick of a flight with the surfaces of its trim."""
    plant = Plant(flight)
    trim, rows = plant.trim(), []
    rows.append(plant.truth()[0])
    for _ in range(round(seconds / plant.dt)):
        plant.write(np.asarray(trim.surfaces))
        plant.run()
        rows.append(plant.truth()[0])
    return np.array(rows).view(np.recarray)


def cruise(*keys, names=("t",)):
    """Return {name: (ticks,)} of the truth of a flight of `cruise` in still air but for `keys`, without detectors."""
    scenario = load_scenario("cruise", ["flight.turbulence=none", "detectors.enabled=[]", *keys])
    rows, status, _ = record(build(scenario), [f"truth.aircraft.{n}" for n in names])
    assert status == "completed"
    return dict(zip(names, rows.T))


@pytest.mark.parametrize("start", STARTS, ids=str)
@pytest.mark.parametrize("wind", WINDS.values(), ids=WINDS)
def test_a_steady_wind_changes_nothing_but_the_way_over_the_ground(start, wind):
    still, blown = (flown(point(**start, **how), 4.0) for how in ({}, {"wind": wind}))
    a, b = still[0], blown[0]
    for name in ("alpha", "beta", "tas", "cas", "theta", "phi"):
        assert b[name] == pytest.approx(a[name], abs=1e-9), name
    assert [b.wind_n, b.wind_e, b.wind_d] == pytest.approx([*wind, 0.0], abs=1e-9)
    for k, tolerance in ((0, 1e-9), (-1, 0.03)):
        shift = over_the_ground(blown[k]) - over_the_ground(still[k])
        assert shift == pytest.approx([*wind, 0.0], abs=tolerance)
    for name, most in (("nx", 1e-5), ("ny", 1e-5), ("nz", 1e-5), ("pdot", 1e-5), ("qdot", 1e-5), ("rdot", 1e-5)):
        assert abs(b[name] - a[name]) < most, name  # what is left: rates of the curved earth below
    assert np.abs(blown.alpha - still.alpha).max() < math.radians(0.01)
    assert np.abs(blown.cas - still.cas).max() < 0.02


def over_the_ground(t):
    """Return the velocity of a record of truth to north, east and down [m/s]."""
    cf, sf, ct, st = math.cos(t.phi), math.sin(t.phi), math.cos(t.theta), math.sin(t.theta)
    cp, sp = math.cos(t.psi), math.sin(t.psi)
    level = np.array([[ct, sf * st, cf * st], [0.0, cf, -sf], [-st, sf * ct, cf * ct]]) @ [t.u, t.v, t.w]
    return np.array([[cp, -sp, 0.0], [sp, cp, 0.0], [0.0, 0.0, 1.0]]) @ level


def test_a_wind_that_carries_the_aircraft_backwards_is_refused():
    with pytest.raises(ScenarioError, match=r"wind_kt: the wind is 240 kt, the aircraft flies at .* kt; allowed"):
        build(load_scenario("cruise", ["flight.wind_kt=240", "flight.altitude_ft=1000", "flight.cas_kt=240"]))


def test_wind_comes_from_where_it_is_said_and_grows_with_altitude():
    f = load_scenario("cruise", ["flight.wind_kt=30", "flight.wind_from_deg=270", "flight.shear_kt_1000ft=4"]).flight
    assert f.wind == pytest.approx([0.0, 30.0 * M_S_PER_KT], abs=1e-12)  # from the west it blows to the east
    rate = 4.0 * M_S_PER_KT / (1000.0 * M_PER_FT)
    assert f.shear == pytest.approx([0.0, rate], abs=1e-12)
    weather = {"wind": f.wind, "shear": f.shear, "altitude": 3000.0}
    for h in (2000.0, 3000.0, 4000.0):
        got = air("none", 1, seconds=0.1, h=h, weather=weather)[-1]
        assert got == pytest.approx([0.0, f.wind[1] + rate * (h - 3000.0), 0.0, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("sign", (1.0, -1.0))
@pytest.mark.parametrize("axis", RAISED)
def test_a_positive_gust_raises_airspeed_sideslip_or_angle_of_attack(axis, sign):
    still, gust = (flown(point(gusts=g), 2.0) for g in ((), ((0.5, axis, sign * 6.0, 30.0, "1-cosine"),)))
    tas = still.tas[0]
    moved = {
        "longitudinal": gust.tas - still.tas, "lateral": gust.beta - still.beta, "vertical": gust.alpha - still.alpha,
    }  # fmt: skip
    met = sign * moved[axis]
    assert np.abs(met[:100]).max() < 1e-9  # before it
    most = 6.0 if axis == "longitudinal" else 6.0 / tas
    assert 0.6 * most < met.max() < 1.05 * most
    at = 100 + 30.0 / tas / 0.005
    assert met.argmax() == pytest.approx(at, abs=12)
    level = {"longitudinal": -gust.wind_n, "lateral": -gust.wind_e, "vertical": -gust.wind_d}
    assert (sign * level[axis]).max() == pytest.approx(6.0, abs=0.01)
    others = [np.abs(v).max() for k, v in level.items() if k != axis]
    assert max(others) < 0.05


@pytest.mark.parametrize(("dt", "tas"), [(0.005, 130.0), (0.02, 250.0), (0.0005, 200.0)])
def test_a_one_minus_cosine_gust_is_that_of_cs_25_341(dt, tas):
    gradient, speed, start = 107.0, 17.0, 0.3
    told = (start, "vertical", speed, gradient, "1-cosine")
    got = air("none", 1, seconds=3.0, dt=dt, tas=tas, weather={"gusts": [told]})
    t = dt * np.arange(1, len(got) + 1)
    s = np.clip((t - start) * tas, 0.0, 2.0 * gradient)
    expected = 0.5 * speed * (1.0 - np.cos(math.pi * s / gradient))
    assert -got[:, DOWN] == pytest.approx(expected, abs=speed * 1e-6)
    assert np.abs(got[:, :2]).max() == 0.0
    assert -got[:, DOWN].min() == pytest.approx(speed, rel=0.01)


@pytest.mark.parametrize(("phi", "theta", "psi"), [(0.0, 0.0, 0.0), (0.5, 0.1, 2.0), (-0.3, -0.1, 4.0)])
def test_the_tail_meets_a_gust_later_and_axes_are_those_of_the_level_about_the_nose(phi, theta, psi):
    tas, arm, dt = 200.0, AIRCRAFT["tail_arm"], 0.005
    three = [(0.2, a, v, 60.0, "1-cosine") for a, v in (("longitudinal", 4.0), ("lateral", -3.0), ("vertical", 6.0))]
    got = air("none", 1, seconds=2.0, tas=tas, phi=phi, theta=theta, psi=psi, weather={"gusts": three})
    peak = got[np.abs(got[:, DOWN]).argmax()]
    ahead = np.array([math.cos(psi), math.sin(psi), 0.0])
    right = np.array([-math.sin(psi), math.cos(psi), 0.0])
    assert peak[:3] == pytest.approx(-4.0 * ahead + 3.0 * right - [0.0, 0.0, 6.0], abs=0.01)
    cf, sf, ct, st = math.cos(phi), math.sin(phi), math.cos(theta), math.sin(theta)
    body = np.array([[ct, 0.0, -st], [sf * st, cf, sf * ct], [cf * st, -sf, cf * ct]])
    v, w = (body @ np.stack([got[:, :3] @ ahead, got[:, :3] @ right, got[:, 2]]))[1:]
    late = round(arm / tas / dt)
    assert got[late:, 4] == pytest.approx((1.0 - AIRCRAFT["downwash"]) * (w[late:] - w[:-late]) / arm, abs=2e-3)
    assert got[late:, 5] == pytest.approx(-(v[late:] - v[:-late]) / arm, abs=2e-3)
    assert np.abs(got[:, 3]).max() == 0.0 and np.abs(got[:, 4]).max() > 0.02


def test_turbulence_changes_its_rms_and_nothing_else():
    changes = [(2.0, "severe", 1.0), (6.0, "none", 0.0)]
    base, got = (air("light", 5, seconds=8.0, weather={"changes": c}) for c in ((), changes))
    t = 0.005 * np.arange(1, len(got) + 1)
    share = np.interp(t, [2.0, 3.0], [1.0, 21.0 / 5.0]) * (t < 6.0 - 1e-9)
    assert got[:, :3] == pytest.approx(base[:, :3] * share[:, None], abs=1e-12)
    assert np.abs(got[t > 7.5, 3:]).max() < 1e-3 * np.abs(got[t < 6.0, 3:]).max()  # the tail's way is flown


def test_no_weather_changes_trim_law_or_linear_model():
    gust = (1.0, "vertical", 9.0, 30.0, "ramp")
    stormy = point(wind=(20.0, -9.0), shear=(0.01, 0.0), gusts=(gust,), turbulence="light")
    assert stormy.calm == point(seed=0)
    a, b = linearize(point()), linearize(stormy)
    assert np.array_equal(a.A, b.A) and np.array_equal(a.B, b.B)
    calm, blown = (
        build(load_scenario("cruise", ["flight.turbulence=none", "detectors.enabled=[]", *keys]))
        for keys in ([], ["flight.wind_kt=50", "flight.gusts.0.start_s=1", "flight.gusts.0.speed_fps=20"])
    )
    assert calm.loop.law.p.tobytes() == blown.loop.law.p.tobytes()
    for name in calm.loop.hinge.p.dtype.names:
        assert blown.loop.hinge.p[name] == pytest.approx(calm.loop.hinge.p[name], rel=1e-4), name


LOST = ("flight.gusts.0.axis=longitudinal", "flight.gusts.0.shape=ramp", "flight.gusts.0.speed_fps=-30",
        "flight.gusts.0.gradient_ft=1000", "flight.gusts.0.start_s=2")  # fmt: skip


@pytest.mark.parametrize("held", (False, True))
def test_the_speed_hold_brings_back_what_the_wind_took(held):
    """The wind from ahead falls by 30 ft/s: without the throttles most of the airspeed stays lost for a minute."""
    cas = cruise("duration_s=60", *LOST, f"manoeuvre.hold_speed={str(held).lower()}", names=("cas",))["cas"]
    lost = (cas - cas[0]) / M_S_PER_KT
    assert lost.min() < -8.0
    assert abs(lost[-1]) < 1.5 if held else lost[-1] < -5.0
