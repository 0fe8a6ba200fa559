"""Hydraulic faults in flight: one seed of some cases, and what the stored thresholds say about how they were found."""

import json

import numpy as np
import pytest

from cosim.flight.loop.signals import fly
from cosim.flight.simulate import simulate
from cosim.scenario import load_scenario
from cosim.scenario.catalog import SEGMENTS
from cosim.training import train_hydraulic, trainer
from cosim.training.flights import DT, POINTS, draw, fly_hydraulic, scenario, watch
from fdi.common.verdict import OFC_SOLID
from fdi.hydraulic import iotsekf, rtsekf_flight
from fdi.monitors import ofc_monitor, position_monitor


def found(name, *changes, detector="iotsekf"):
    """Return what a detector makes of the fault of the built-in scenario `name` on the left inner segment."""
    said = simulate(load_scenario(name, [*changes, f'detectors.enabled=["{detector}"]'])).detectors
    return next(d for d in said if d["target"] == "elevator.left_inner")


@pytest.mark.parametrize(
    ("name", "changes", "given", "within_s"),
    [
        ("liquid-ofc", ["amplitude_mm=0.6", "frequency_hz=1"], "ofc_liquid", 3.0),
        ("liquid-ofc", ["amplitude_mm=4", "frequency_hz=1"], "ofc_liquid", 3.0),
        ("solid-ofc", ["amplitude_mm=0.6", "frequency_hz=5"], "ofc_solid", 0.6),
        ("solid-ofc", ["amplitude_mm=1", "frequency_hz=1"], "ofc_solid", 3.0),
        ("runaway", ["rate_deg_s=20"], "runaway", 0.2),
        ("solid-jam", [], "jam_solid", 3.5),
        ("liquid-jam", ["bias_mm=1"], "sensor", 0.3),
        ("pressure-bias", ["kind=drift", "drift_pct_s=5"], "sensor", 3.0),
        ("pressure-bias", ["kind=freeze"], "sensor", 0.2),
        ("pressure-bias", ["kind=oscillation", "amplitude_pct=8", "frequency_hz=1.9"], "sensor", 1.5),
        ("internal-leakage", [], "effectiveness", 3.0),
        ("free-float", ["kind=air_in_oil", "loss_pct=80"], "effectiveness", 3.0),
        ("free-float", [], "effectiveness", 3.0),
        ("free-float", ["kind=ofc_solid", "at=valve", "amplitude_mm=0.3", "frequency_hz=0.6"], "ofc_solid", 5.0),
    ],
)
def test_in_flight_each_fault_has_its_name_in_time(name, changes, given, within_s):
    own = found(name, *(f"faults.0.{c}" for c in changes))
    assert own["isolated"]["class"] == given and own["detection_delay_s"] <= within_s, own


@pytest.mark.parametrize("start_s", [1, 3])
@pytest.mark.parametrize(
    ("name", "changes", "given"),
    [
        ("liquid-ofc", ["amplitude_mm=0.5", "frequency_hz=1"], "ofc_liquid"),
        ("solid-ofc", ["amplitude_mm=1", "frequency_hz=1"], "ofc_solid"),
        ("pressure-bias", ["kind=oscillation", "amplitude_pct=8", "frequency_hz=1.9"], "sensor"),
    ],
)
def test_a_fault_that_begins_before_the_flight_has_taught_has_its_name(name, changes, given, start_s):
    own = found(name, *(f"faults.0.{c}" for c in (*changes, f"start_s={start_s}")), "duration_s=14")
    assert own["isolated"]["class"] == given, own


def test_the_name_of_a_large_oscillation_in_place_does_not_flicker():
    changes = ["faults.0.amplitude_mm=3", "faults.0.frequency_hz=1", "duration_s=24"]
    made = load_scenario("solid-ofc", [*changes, "seed=1", 'detectors.enabled=["iotsekf"]'])
    said = fly(made, ["iotsekf.left_inner.verdict"]).iloc[:, 0]
    assert (said[said.index >= made.faults[0].start_s + 2.5] == OFC_SOLID).all()


def test_a_healthy_flight_is_quiet_and_every_segment_is_watched():
    flight = draw(5, point=POINTS[1], manoeuvre="pitch_protection", turbulence="light")
    recorded = fly_hydraulic(**{**flight, "duration": 20.0})
    assert len(recorded) == 4000
    quiet = [(m, m.params()) for m in (iotsekf, rtsekf_flight, ofc_monitor, position_monitor)]
    for module, p in [*quiet, *((iotsekf, iotsekf.params(load=k)) for k in (0, 1))]:
        alarm = watch(recorded, module, p, ("alarm",))["alarm"]
        assert alarm.shape == (4, 4000) and not alarm.any(), module.__name__


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


def test_every_hypothesis_has_its_share_of_the_probability():
    rng = np.random.default_rng(1)
    tall = rng.exponential(1.0, (400, 3)) * [1.0, 2.0, 0.0]
    limit = train_hydraulic.each(tall, 3e-3)
    assert limit[:2] == pytest.approx([np.log(1e3), 2.0 * np.log(1e3)], rel=0.25)
    assert limit[2] == 0.0
    seen = {"run_threshold": 1.0, "limit": np.array([0.0, 20.0])}
    out = train_hydraulic.limits([{"iotsekf flight_load2": seen}] * 20)["iotsekf"][0]["flight_load2"]
    assert out["limit"] == pytest.approx([0.0, train_hydraulic.MARGIN * 20.0])
    assert out["run_threshold"] == train_hydraulic.PEAK


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
