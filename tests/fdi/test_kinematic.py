"""Sensors named from kinematics alone: each kind once in moderate turbulence, quiet without, silent with a reason."""

import math

import numpy as np
import pytest

import cosim
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.scenario import load_scenario
from fdi.common import why
from fdi.common.verdict import SENSOR
from fdi.kinematic import kinematic

DEG, START = math.pi / 180, 12.0
WIRES = sources("kinematic")
STEPS = {
    "theta": 1 * DEG, "tas": 5.0, "p": 1 * DEG, "phi": 2 * DEG, "q": 1 * DEG, "r": 1 * DEG, "psi": 2 * DEG, "n_z": 0.2,
    "n_x": 0.1, "cas": 5.0, "mach": 0.02, "h_baro": 50.0, "h_inertial": 10.0, "alpha_ground": 1 * DEG, "hdot": 5.0,
}  # fmt: skip

PAIRED = {"p": "p or phi", "r": "r or psi", "n_x": "n_x or v_ground"}  # gusts may hide which of the two it is
SLOW = {
    **dict.fromkeys(("phi", "theta", "psi", "alpha_ground"), 0.3 * DEG), "h_inertial": 1.0, "h_baro": 10.0, "tas": 1.0,
    **dict.fromkeys(("p", "q", "r"), 0.3 * DEG), "cas": 1.0, "mach": 0.005, "n_x": 0.02, "n_z": 0.05, "hdot": 1.0,
    "v_ground": 0.5, **dict.fromkeys(("alpha", "beta"), 0.3 * DEG), "n_y": 0.02,
}  # fmt: skip
KINDS = {
    "drift": lambda y, t, rate: y + rate * t, "scale": lambda y, t, rate: y * 1.05,
    "freeze": lambda y, t, rate: np.full(len(y), y[0]),
    "slow oscillation": lambda y, t, rate: y + 4.0 * rate * np.sin(0.6 * t),
    "oscillation": lambda y, t, rate: y + rate * np.sin(6.0 * t), "step": lambda y, t, rate: y + 5.0 * rate,
    "noise": lambda y, t, rate: y + rate * np.random.default_rng(3).standard_normal(len(y)),
}  # fmt: skip


@pytest.fixture(scope="module")
def flown():
    given = ["duration_s=18", "flight.turbulence=moderate", "detectors.enabled=[]", "manoeuvre.kind=nz_doublet"]
    return fly(load_scenario("cruise", given), WIRES.values())


def watched(flown, sensor="", change=None, p=None, start=START):
    frame = flown.copy()
    if sensor:
        late = frame.index >= start
        frame.loc[late, WIRES[sensor]] = change(frame[WIRES[sensor]][late].to_numpy())
    return detect(frame, kinematic, WIRES, p)


def said(log):
    last = log[-1]
    return kinematic.ISOLABLE_PARTS[int(last["isolated_part"])] if last["alarm"] and last["verdict"] == SENSOR else ""


def test_quiet_without_a_fault_and_not_ready_before_it_has_learned(flown):
    log = watched(flown)
    assert not log["alarm"].any() and log["r"].max() < 1.0
    t = flown.index.to_numpy()
    assert (log["why"][t < 7.9] == why.NOT_READY).all()
    assert (log["valid"][t > 8.1] == 1.0).all()


@pytest.mark.parametrize("sensor", STEPS)
def test_a_step_of_each_sensor_is_named_and_nothing_else_first(flown, sensor):
    log = watched(flown, sensor, lambda y: y + STEPS[sensor])
    assert said(log) in (sensor, PAIRED.get(sensor))
    first = np.flatnonzero(log["isolated_part"] > 0)[0]
    assert sensor in kinematic.ISOLABLE_PARTS[int(log["isolated_part"][first])].split(" or ")
    assert flown.index[first] - START < 3.0


@pytest.mark.parametrize("sensor, sigma", [("alpha", 0.3 * DEG), ("n_z", 0.07), ("beta", 0.3 * DEG), ("q", 0.2 * DEG)])
def test_noise_ten_times_larger_is_named(flown, sensor, sigma):
    rng = np.random.default_rng(1)
    assert said(watched(flown, sensor, lambda y: y + sigma * rng.standard_normal(len(y)))) == sensor


def test_a_reading_that_repeats_is_named(flown):
    assert said(watched(flown, "alpha", lambda y: np.full(len(y), y[0]))) == "alpha"


def test_an_actuator_fault_is_nothing_to_it():
    given = ["duration_s=16", "faults.0.target=elevator.all", "faults.0.kind=bias", "faults.0.bias_deg=3",
             "faults.0.start_s=10", "detectors.enabled=[]"]  # fmt: skip
    flown = fly(load_scenario("cruise", given), WIRES.values())
    assert not detect(flown, kinematic, WIRES)["alarm"].any()


def test_without_inertial_sensors_it_says_that_they_are_lost(flown):
    frame = flown.copy()
    for name in kinematic.SENSORS:
        frame.loc[START:, f"sensors.{name}.valid_obs"] = 0.0
    log = detect(frame, kinematic, WIRES)
    assert (log["why"][frame.index > START + 0.01] == why.LOST_SENSOR).all() and not log["alarm"].any()


def test_severe_gusts_in_a_turn_are_no_sensor_and_hide_none():
    given = ["duration_s=24", "flight.turbulence=severe", "detectors.enabled=[]", "manoeuvre.kind=coordinated_turn",
             "manoeuvre.duration_s=20", "seed=5"]  # fmt: skip
    flown = fly(load_scenario("cruise", given), WIRES.values())
    assert not watched(flown)["alarm"].any()
    log = watched(flown, "theta", lambda y: y + DEG, start=18.0)
    assert {kinematic.ISOLABLE_PARTS[int(c)] for c in log["isolated_part"][log["alarm"] > 0]} == {"theta"}


@pytest.mark.parametrize(("sensor", "rate"), [("phi", "p"), ("psi", "r")])
def test_a_drift_of_roll_or_heading_is_not_called_its_gyro(flown, sensor, rate):
    t = flown.index.to_numpy()[flown.index >= START] - START
    assert said(watched(flown, sensor, lambda y: y + 0.2 * DEG * t)) == f"{rate} or {sensor}"


@pytest.fixture(scope="module")
def calm():
    given = ["duration_s=24", "flight.turbulence=none", "detectors.enabled=[]"]
    return fly(load_scenario("cruise", given), WIRES.values())


@pytest.mark.parametrize(("sensor", "rate"), [
    ("p", 0.0), ("r", 0.0), ("n_x", 0.0), ("phi", 0.3 * DEG), ("psi", 0.5 * DEG), ("v_ground", 0.5),
])  # fmt: skip
def test_the_velocity_through_calm_air_tells_a_rate_from_what_it_is_the_rate_of(calm, sensor, rate):
    t = calm.index.to_numpy()[calm.index >= START] - START
    assert said(watched(calm, sensor, lambda y: y + rate * t + (0.0 if rate else STEPS[sensor]))) == sensor


def test_another_sensor_is_named_beside_the_first_by_rows_that_do_not_read_it(calm):
    both = calm.copy()
    both.loc[18.0:, WIRES["tas"]] += 10.0
    log = watched(both, "theta", lambda y: y + 2 * DEG)
    named = log["isolated_part"][(log["alarm"] > 0) & (log["verdict"] == SENSOR)]
    assert [kinematic.ISOLABLE_PARTS[int(c)] for c in dict.fromkeys(named)] == ["theta", "tas"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sensor", SLOW)
def test_no_kind_of_fault_of_a_sensor_is_surely_another_sensors(flown, sensor, kind):
    t = flown.index.to_numpy()[flown.index >= START] - START
    log = watched(flown, sensor, lambda y: KINDS[kind](y, t, SLOW[sensor]))
    named = log["isolated_part"][(log["alarm"] > 0) & (log["verdict"] == SENSOR)]
    sure = {kinematic.ISOLABLE_PARTS[int(c)] for c in named}
    assert all(sensor in name.split(" or ") for name in sure)


@pytest.mark.parametrize("seed", range(2))
def test_sensors_twice_as_noisy_as_specified_are_no_fault(seed):
    given = ["duration_s=40", "detectors.enabled=[]", f"seed={910100000 + seed}", "sensors.noise_scale=2"]
    log = detect(fly(load_scenario("cruise", given), WIRES.values()), kinematic, WIRES)
    assert not log["alarm"].any() and log["r"].max() < 0.9


@pytest.fixture(scope="module")
def turned():
    given = ["duration_s=40", "flight.turbulence=light", "flight.wind_kt=57", "flight.wind_from_deg=270",
             "detectors.enabled=[]", "manoeuvre.kind=coordinated_turn", "manoeuvre.start_s=14"]  # fmt: skip
    return fly(load_scenario("cruise", given), [*WIRES.values(), "truth.aircraft.v"])


def test_a_turn_in_a_cross_wind_is_quiet_and_teaches_the_lateral_velocity(turned):
    log, v = watched(turned), turned["truth.aircraft.v"].to_numpy()
    assert not log["alarm"].any() and log["r"].max() < 0.8
    error = (log["lateral_ground"] - v)[turned.index > 20.0]
    assert np.sqrt(np.mean(v**2)) > 15.0 and np.sqrt(np.mean(error**2)) < 3.0
    level = int(np.searchsorted(turned.index, 13.0))
    assert math.sqrt(log["cov"][-1, 1, 1]) < 2.0 < 4.0 < math.sqrt(log["cov"][level, 1, 1])  # only the bank told it


def test_what_is_learned_in_a_bank_is_uncertain_and_no_wind():
    given = ["duration_s=22", "flight.turbulence=severe", "flight.mass_t=370", "flight.cg_pct=26.1", "seed=1300178",
             "flight.altitude_ft=10880", "flight.cas_kt=201", "detectors.enabled=[]"]  # fmt: skip
    frame = fly(load_scenario("cruise", given), WIRES.values())
    assert np.abs(frame[WIRES["phi"]][2.0:8.0]).max() > 10 * DEG  # while it learns gusts bank the aircraft
    log = watched(frame)
    assert not log["alarm"].any() and np.abs(log["wind"][:, 1]).max() < 20.0  # there is none; it said up to 100 m/s


@pytest.mark.parametrize("sensor", ["hdot", "theta", "n_x", "alpha_ground"])
def test_a_fault_in_a_turn_in_a_cross_wind_is_named_and_not_taken_for_wind(turned, sensor):
    log = watched(turned, sensor, lambda y: y + STEPS[sensor], start=25.0)
    assert said(log) == sensor


ENDS = {
    "theta, bias": ("theta", "kind='bias',bias_deg=2"), "n_z, bias": ("n_z", "kind='bias',bias_g=0.15"),
    "n_x, noise": ("n_x", "kind='noise',sigma_g=0.08"), "theta, drift": ("theta", "kind='drift',drift_deg_s=0.2"),
    "r, oscillation": ("r", "kind='oscillation',amplitude_deg_s=2,frequency_hz=0.1"),
    "hdot, bias": ("hdot", "kind='bias',bias_m_s=8"), "psi, frozen": ("psi", "kind='freeze'"),
}  # fmt: skip


@pytest.mark.parametrize(("sensor", "fault"), ENDS.values(), ids=ENDS)
def test_an_alarm_stands_as_long_as_the_error_and_ends_with_it(sensor, fault):
    fault = f"target='sensor.{sensor}',path='observers',{fault},start_s=14,end_s=74"
    told = ["duration_s=90", "flight.turbulence=light", "manoeuvre.kind=nz_doublet", f"faults=[{{{fault}}}]"]
    found = cosim.simulate(load_scenario("cruise", [*told, "detectors.enabled=['kinematic']"])).to_dict()
    lane = found["detectors"][0]
    assert lane["alarm_share"] > 0.95 and lane["withdrawn_after_s"] < 10.0 and lane["false_alarms"] == 0
    assert lane["isolated"]["target"] in (sensor, PAIRED.get(sensor))
