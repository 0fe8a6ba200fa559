"""The control law: margins and what proves them, steps, limits, lost signals, commands that are always numbers."""

import functools
import math

import law_margins
import numpy as np
import pytest
from flown import deg, fly, scenario

from actuators.constants import M_PER_FT
from cosim.flight.blocks import law
from cosim.flight.blocks.law import design as law_design
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import POINTS, FlightPoint, Plant
from cosim.scenario.aircraft import load_aircraft

FREQUENCY = np.geomspace(0.02, 300.0, 2000)
MIXES = {
    "hydraulic": ["hydraulic"] * 4,
    "ema": ["ema"] * 4,
    "mixed": ["hydraulic", "hydraulic", "ema", "ema"],
}
SLOW = {  # 1.2 to 1.4 times the stall speed: full back-stick ends at alpha_max
    "sun13 at 150 kt": FlightPoint.at(200, 30, 20000, cas_kt=150),
    "A at 170 kt": FlightPoint.at(260, 28, 12500, cas_kt=170),
    "B at 175 kt": FlightPoint.at(260, 36, 12500, cas_kt=175),
    "C at 210 kt": POINTS["C"],
    "D at 235 kt": FlightPoint.at(405, 36, 27500, cas_kt=235),
    "E at 190 kt": FlightPoint.at(320, 28, 20000, cas_kt=190),
}
FLIGHTS = POINTS | {  # the last three: none of the papers' points, no corner of their table
    "250 t, 15,000 ft, 310 kt": FlightPoint.at(250, 33, 15000, cas_kt=310),
    "350 t, 33,000 ft, M 0.80": FlightPoint.at(350, 27, 33000, mach=0.80),
    "190 t, 3,000 ft, 170 kt": FlightPoint.at(190, 35, 3000, cas_kt=170),
}


@functools.cache
def designed(name):
    """Return (model, PARAMS, hinge load of a segment at trim)."""
    flight = (FLIGHTS | SLOW)[name]
    plant = Plant(flight)
    trim = plant.trim()
    truth = plant.truth()[0]
    model = linearize(flight)
    p = law_design.design(model, law_design.alpha_limit(Plant(flight), trim), load_aircraft())
    return model, p, (float(truth.hm0_li), float(truth.hmd_li))


def return_ratio(name, mix="mixed", gains_of=None):
    model, p, hinge = designed(name)
    return law_margins.return_ratio(model, designed(gains_of)[1] if gains_of else p, MIXES[mix], hinge, FREQUENCY)


@pytest.mark.parametrize("mix", MIXES)
@pytest.mark.parametrize("name", FLIGHTS)
def test_pitch_loop_has_6_db_and_45_degrees(name, mix):
    gain, phase, _ = law_margins.margins(return_ratio(name, mix), FREQUENCY)
    assert gain > 6.0 and phase > 45.0


@pytest.mark.parametrize("name", SLOW)
def test_alpha_protection_has_6_db_and_45_degrees_at_the_speeds_where_it_binds(name):
    """Above 0.5 rad/s; below, alpha held constant leaves the path a phugoid that the pilot's stick has to end."""
    fast = np.geomspace(0.5, 300.0, 2000)
    model, p, hinge = designed(name)
    for mix in MIXES.values():
        L = law_margins.return_ratio(model, p, mix, hinge, fast, protected=True)
        gain, phase, crossover = law_margins.margins(L, fast)
        assert gain > 6.0 and phase > 45.0
        assert 1.5 < crossover < 5.0


@pytest.mark.parametrize("point", ["sun13", "C", "D"])
def test_load_factor_follows_its_demand(point):
    """A step of 0.15 g: no more than 15 % beyond it, 90 % within 3 s, within 5 % after 6 s."""
    s = scenario(point, "nose_up", duration_s=12.0, manoeuvre__start_s=1.0, manoeuvre__duration_s=10.0,
                 manoeuvre__amplitude_g=0.15, sensors__noise_scale=0.0)  # fmt: skip
    f = fly(s)
    rise = (f.nz - np.cos(f.theta) * f.nz[0] / math.cos(f.theta[0])) / 0.15
    assert f.protection.max() == 0.0
    assert rise.max() < 1.15
    assert f.t[np.argmax(rise > 0.9)] - 1.0 < 3.0
    assert np.abs(rise[1400:2100] - 1.0).max() < 0.05


def test_path_is_held_without_a_bump_when_the_stick_comes_free():
    f = fly(scenario("B", "nose_up", duration_s=25.0, sensors__noise_scale=0.0))
    after = f.t > 8.0
    assert abs(f.nz[f.t > 7.0].min() - f.nz[0]) < 0.12
    assert np.ptp(f.hdot[f.t > 12.0]) < 0.6
    assert np.abs(np.diff(f.de_cmd[after])).max() < math.radians(0.1)


# -- lost signals ------------------------------------------------------------------------------------------------------


def dropouts(*times, signals):
    """Return the keys of dropouts of `signals` at (start, end) `times`, end None for good."""
    keys, i = {}, 0
    for name in signals:
        for start, end in times:
            keys |= {f"faults__{i}__target": f"sensor.{name}", f"faults__{i}__kind": "dropout"}
            keys[f"faults__{i}__start_s"] = start
            if end is not None:
                keys[f"faults__{i}__end_s"] = end
            i += 1
    return keys


LOST_IN = {"manoeuvre__start_s": 3.0, "flight__turbulence": "light", "duration_s": 35.0}


@functools.cache
def whole_flight(manoeuvre):
    """Fly at point E with every signal; the same flight for every signal that is lost in it."""
    return fly(scenario("E", manoeuvre, **LOST_IN))


@pytest.mark.parametrize("name", law.SENSORS)
def test_signal_lost_for_a_tenth_of_a_second_for_a_second_and_for_good(name):
    times = ((4.0, 4.1), (8.0, 9.0), (15.0, None))
    held = "coordinated_turn" if name in ("phi", "p", "r", "psi", "h_inertial", "cas", "tas", "beta") else "nz_doublet"
    lost = fly(scenario("E", held, **LOST_IN, **dropouts(*times, signals=[name])))
    whole = whole_flight(held)
    assert lost.status == "completed"
    for command, limit in (("de_cmd", 23), ("da_cmd", 20), ("dr_cmd", 25), ("throttle_cmd", 57.3)):
        series = getattr(lost, command)
        assert np.isfinite(series).all() and np.abs(deg(series)).max() <= limit + 1e-9
    brief = lost.t < 8.0
    assert np.abs(lost.alpha - whole.alpha)[brief].max() < math.radians(0.15)
    assert np.abs(lost.phi - whole.phi)[brief].max() < math.radians(0.3)
    assert np.abs(lost.theta - whole.theta)[lost.t < 15.0].max() < math.radians(1.0)
    assert np.abs(lost.phi - whole.phi)[lost.t < 15.0].max() < math.radians(2.0)
    assert np.abs(lost.phi - whole.phi).max() < math.radians(8.0)
    assert np.abs(lost.h - whole.h).max() < 300 * M_PER_FT


def test_without_alpha_full_back_stick_stays_below_the_stall_by_speed():
    f = fly(scenario("C", "aoa_protection", duration_s=25.0, **dropouts((2.0, None), signals=["alpha"])))
    assert f.status == "completed"
    assert f.alpha.max() < f.setup.loop.law.p["alpha_max"][0] + math.radians(2.0)


def test_command_is_a_number_whatever_is_measured():
    _, p, _ = designed("sun13")
    p = np.repeat(p, 8)
    rng = np.random.default_rng(5)
    u = np.zeros((8, 2000), law.INPUTS)
    u["y"] = rng.standard_normal(u["y"].shape) * 10.0 ** rng.uniform(-3, 4, (8, 1, len(law.SENSORS)))
    u["valid"] = rng.random(u["valid"].shape) < 0.7
    bad = rng.random(u["y"].shape)
    u["y"][bad < 0.05], u["y"][bad > 0.95] = np.nan, np.inf  # flags may lie
    u["nz_dem"], u["phi_dem"] = rng.uniform(-2, 2, (8, 2000)), rng.uniform(-1, 1, (8, 2000))
    u["hold_h"], u["hold_v"], u["hold_psi"] = rng.random((3, 8, 2000)) < 0.5
    log = np.zeros(u.shape, law.STATE)
    law.rollout(law.init(p), u, p, 0.005, log)
    for name in law.STATE.names:
        assert np.isfinite(log[name]).all(), name
    assert (log["de_cmd"] <= p["de_max"][0]).all() and (log["de_cmd"] >= p["de_min"][0]).all()
    assert (np.abs(log["da_cmd"]) <= p["da_max"][0]).all() and (np.abs(log["dr_cmd"]) <= p["dr_max"][0]).all()
    assert ((log["throttle_cmd"] >= 0) & (log["throttle_cmd"] <= 1)).all()
