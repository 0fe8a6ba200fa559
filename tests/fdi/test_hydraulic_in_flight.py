"""Hydraulic faults in flight: one seed of some cases, and what the stored thresholds say about how they were found."""

import json
from dataclasses import asdict

import hydraulic_cases
import hydraulic_loop
import numpy as np
import pytest

from cosim.flight.loop.signals import fly
from cosim.flight.simulate import simulate
from cosim.scenario import load_scenario
from cosim.scenario.catalog import SEGMENTS
from cosim.training import train_hydraulic, trainer
from cosim.training.flights import DT, POINTS, draw, scenario
from fdi.common.verdict import OFC_LIQUID, OFC_SOLID

CASES = {c.name: c for c in (*hydraulic_cases.oscillations(), *hydraulic_cases.others())}


@pytest.mark.parametrize(
    "name",
    [
        "ofc_liquid 1 Hz 0.6 mm",
        "ofc_solid 5 Hz 0.6 mm",
        "runaway 20 deg/s",
        "jam_solid, step 1 deg",
        "rod bias 1 mm",
        "pressure drift 5 pct/s",
        "pressure freeze",
    ],
)
def test_in_flight_each_fault_has_its_name_in_time(name):
    case = CASES[name]
    found = hydraulic_cases.fly_case(asdict(case), 17001)
    row, sensor = ([hydraulic_cases.Outcome(**found[d])] for d in ("iotsekf", "rtsekf_flight"))
    row, sensor = hydraulic_cases.summary(case, row), hydraulic_cases.summary(case, sensor)
    in_time = row["detected"] if row["in_time"] is None else row["in_time"]
    assert (row["early"], in_time, row["right"]) == (0, 1, 1), row
    assert sensor["detected"] == (1 if name.startswith("rod") else 0), sensor


@pytest.mark.parametrize(
    ("start_s", "amplitude_mm", "frequency_hz", "share"),
    [(12, 4, 1, 0.88), (12, 8, 1, 0.88), (12, 3, 5, 0.95), (12, 4, 5, 0.95), (1, 8, 1, 0.88), (2, 8, 1, 0.88)],
)
def test_a_large_oscillation_in_still_air_has_its_name_and_keeps_it(start_s, amplitude_mm, frequency_hz, share):
    keys = {"start_s": start_s, "amplitude_mm": amplitude_mm, "frequency_hz": frequency_hz}
    changes = [*(f"faults.0.{k}={v}" for k, v in keys.items()), "duration_s=24", 'detectors.enabled=["iotsekf"]']
    said = fly(load_scenario("liquid-ofc", changes), ["iotsekf.left_inner.verdict"]).iloc[:, 0]
    named = (said[said.index >= start_s] == OFC_LIQUID).to_numpy()
    assert named[-1] and named.mean() >= share, named.mean()


@pytest.mark.parametrize(("amplitude_mm", "frequency_hz", "air"), [(5, 5, "none"), (8, 5, "none"), (10, 10, "light")])
def test_the_name_of_a_large_oscillation_in_place_does_not_flicker(amplitude_mm, frequency_hz, air):
    changes = [f"faults.0.amplitude_mm={amplitude_mm}", f"faults.0.frequency_hz={frequency_hz}", "duration_s=24"]
    own = [f"flight.turbulence={air}", "seed=1", 'detectors.enabled=["iotsekf"]']
    scenario = load_scenario("solid-ofc", [*changes, *own])
    said = fly(scenario, ["iotsekf.left_inner.verdict"]).iloc[:, 0]
    said = said[said.index >= scenario.faults[0].start_s + 2.0]
    assert (said == OFC_SOLID).all()


@pytest.mark.parametrize("start_s", [1, 2, 3])
@pytest.mark.parametrize(
    ("name", "changes", "given"),
    [
        ("liquid-ofc", ["amplitude_mm=0.5", "frequency_hz=1"], "ofc_liquid"),
        ("solid-ofc", ["amplitude_mm=1", "frequency_hz=1"], "ofc_solid"),
        ("pressure-bias", ["kind=oscillation", "amplitude_pct=8", "frequency_hz=1.9"], "sensor"),
    ],
)
def test_a_fault_that_begins_before_the_flight_has_taught_has_its_name(name, changes, given, start_s):
    keys = [f"faults.0.{c}" for c in (*changes, f"start_s={start_s}")]
    flown = simulate(load_scenario(name, [*keys, "duration_s=14", 'detectors.enabled=["iotsekf"]'])).detectors
    own = next(d for d in flown if d["target"] == "elevator.left_inner")
    assert own["isolated"]["class"] == given and not own["first_sure_wrong"], own


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        (["faults.0.kind=air_in_oil", "faults.0.loss_pct=80"], "effectiveness"),
        (["faults.0.kind=air_in_oil", "faults.0.loss_pct=90"], "effectiveness"),
        (["faults.0.kind=free_float"], "effectiveness"),
        (["faults.0.kind=free_float", "faults.0.start_s=8"], "effectiveness"),
        (
            ["faults.0.kind=ofc_solid", "faults.0.at=valve", "faults.0.amplitude_mm=0.3", "faults.0.frequency_hz=0.6"],
            "ofc_solid",
        ),
    ],
)
def test_soft_oil_and_joined_chambers_are_told_from_a_valve_in_place_of_its_command(changes, name):
    own = named_in_flight(changes)
    assert own["isolated"]["class"] == name and not own["first_sure_wrong"], own


def named_in_flight(changes):
    """Return what `iotsekf` makes of the fault of `free-float` with `changes`."""
    keys = [c for c in changes if not c.startswith("faults.0.kind")]
    kind = next(c for c in changes if c.startswith("faults.0.kind"))
    flown = simulate(load_scenario("free-float", [kind, *keys, 'detectors.enabled=["iotsekf"]'])).detectors
    return next(d for d in flown if d["target"] == "elevator.left_inner")


def test_a_slow_solid_oscillation_without_motion_is_found_and_not_misnamed():
    case = CASES["ofc_solid 0.5 Hz 0.6 mm, still air, hands off"]
    found = [hydraulic_cases.fly_case(asdict(case), seed)["iotsekf"] for seed in (17001, 17002, 17003)]
    row = hydraulic_cases.summary(case, [hydraulic_cases.Outcome(**each) for each in found])
    assert row["early"] == 0 and row["in_time"] == 3 and row["right"] >= 1, row


def test_a_healthy_flight_is_quiet_and_every_segment_is_watched():
    flight = draw(5, point=POINTS[1], manoeuvre="pitch_protection", turbulence="light")
    recorded = hydraulic_cases.fly_hydraulic(**{**flight, "duration": 20.0})
    assert len(recorded) == 4000
    for name, (module, p) in hydraulic_cases.detectors().items():
        assert not (hydraulic_cases.watch(recorded, module, p, ("alarm",))["alarm"] > 0.5).any(), name


@pytest.mark.parametrize("detector", ["iotsekf", "rtsekf"])
def test_stored_thresholds_are_beyond_what_training_saw(detector):
    data = json.loads((trainer.FOLDER / f"{detector}.json").read_text(encoding="utf-8"))
    how = data.pop("training")
    for name, largest in how["largest"].items():
        stored = data[name]
        evidence = {"limit"} if f"{detector} {name}" == train_hydraulic.EVIDENCE else set()
        assert set(largest) == evidence | set(train_hydraulic.TESTS[detector])
        for key, value in largest.items():
            assert np.all(np.array(stored[key]) >= 0.999 * np.array(value)), (name, key)


def test_every_frequency_has_its_share_of_the_probability_and_one_that_no_flight_shows_the_noise():
    rng = np.random.default_rng(1)
    tall = rng.exponential(1.0, (400, 3)) * [1.0, 2.0, 0.0]
    limit = train_hydraulic.each(tall, 3e-3)
    assert limit[:2] == pytest.approx([np.log(1e3), 2.0 * np.log(1e3)], rel=0.25)
    assert limit[2] == 0.0
    found = {"bank_threshold": np.zeros(14), "slow_threshold": np.zeros(7), "run_threshold": 1.0,
             "limit": np.array([0.0, 20.0])}  # fmt: skip
    out = train_hydraulic.limits([{"iotsekf flight_load2": found}] * 20)[0].fields
    assert out["limit"] == pytest.approx([0.0, train_hydraulic.MARGIN * 20.0])
    assert out["bank_threshold"] == pytest.approx(train_hydraulic.quiet_floor(2)["bank_threshold"])
    assert out["run_threshold"] == train_hydraulic.PEAK


@pytest.mark.parametrize(("feedback", "late"), [("measured", 0.95), ("rtsekf_flight", 0.0)])
def test_feedback_flights_tell_a_loop_that_believes_the_rod_sensor(feedback, late):
    found = hydraulic_loop.feedback_flight(feedback, False, 3)
    assert found["late_deg"] == pytest.approx(late, abs=0.15)
    assert found["rtsekf_flight"] and found["nz_free_g"] < 0.02


def test_long_flights_show_what_drifts(monkeypatch):
    monkeypatch.setattr(hydraulic_loop, "LONG_S", 60.0)
    rows = hydraulic_loop.long_flight(3)["rows"]
    worst = {name: values[-1] for name, values in rows.items()}
    assert worst["rtsekf, load ignored, as published: |f_hat| [mm]"] > 20.0
    assert worst["rtsekf_flight: |rod estimate - rod| [mm]"] < 1.0
    assert worst["ema_kalman: |R1| [mm], threshold 0.5"] > 50.0
    assert worst["ema_kalman_flight: largest test over its threshold"] < 1.0


@pytest.mark.parametrize("seed", [1, 2])
def test_alarms_of_healed_runaways_end_with_the_servo_on_the_estimate(seed):
    """They end on a stop: the rod is driven off it by the whole supply, which is no jump of the pressure sensor."""
    faults = [{"target": f"elevator.{s}", "kind": "runaway", "start_s": 5.0, "end_s": 7.0, "rate_deg_s": rate}
              for s, rate in zip(SEGMENTS, (22.0, 33.0, -22.0, -33.0))]  # fmt: skip
    flight = scenario(duration=12.0, seed=seed, manoeuvre="nz_doublet", faults=faults,
                      detectors={"enabled": ["iotsekf"]},
                      elevator={**dict.fromkeys(SEGMENTS, "hydraulic"), "feedback": "iotsekf"})  # fmt: skip
    alarm = fly(flight, [f"iotsekf.{s}.alarm" for s in SEGMENTS]).to_numpy().T
    assert alarm[:, round(5.3 / DT) : round(7.0 / DT)].all()
    assert not alarm[:, round(10.0 / DT) :].any()
