"""Rates of `joint`: what a flight's kind and tokens are, what is counted of them, and the table of its campaign."""

import numpy as np
import pandas as pd
import pytest

from cosim.judge.detection import watch_of
from cosim.report import joint_page
from cosim.scenario import load_scenario
from cosim.training import train_joint
from fdi import registry
from fdi.common import verdict
from fdi.isolation import decide
from fdi.joint import places


@pytest.mark.parametrize("target, kind, more, found", [
    ("elevator.left_inner", "friction", "friction_pct=30", "hydraulic.surface.friction"),
    ("elevator.right_outer", "friction", "friction_pct=30", "ema.surface.friction"),
    ("elevator.left_inner", "free_float", "", "hydraulic.surface.effectiveness"),
    ("elevator.left_inner", "internal_leakage", "leakage_pct=30", "hydraulic.drive.internal_leakage"),
    ("elevator.left", "bias", "bias_deg=2", "side.command.jam_liquid"),
    ("elevator.all", "runaway", "rate_deg_s=4,at='command'", "all.command.runaway"),
    ("sensor.q", "bias", "bias_deg_s=1", "sensor.q"),
])  # fmt: skip
def test_every_fault_has_the_kind_of_a_hypothesis(target, kind, more, found):
    fault = f"target='{target}',kind='{kind}',start_s=20" + (f",{more}" if more else "")
    scenario = load_scenario("cruise", [f"faults.0={{{fault}}}", "duration_s=30"])
    assert train_joint.kind_of(scenario)[0] == found
    assert found in {h.kind for h in places.hypotheses(scenario.elevator.technology)}


def test_a_word_beyond_the_class_stands_while_the_alarm_does():
    culprits = registry.module("iotsekf").CULPRITS
    watch = watch_of("iotsekf", "local", "left_inner", culprits, {"alarm": 0, "verdict": 1, "culprit": 2})
    trace = np.zeros((100, 4))
    trace[10:, 0], trace[10:, 1] = 1.0, verdict.AMBIGUOUS
    trace[20:30, 3] = decide.OF_LOAD  # while it is ambiguous
    trace[40:, 1] = verdict.EFFECTIVENESS
    trace[50:55, 3] = decide.WEAK
    finer, dt = {"kind": 3}, 0.05
    said = ["ambiguous", "ambiguous friction", "effectiveness loss_of_effectiveness"]
    assert train_joint._tokens(watch, trace[10:], finer, dt) == [*said, said[-1]]  # phases of 5, 15, 60, 10 ticks
    trace[45, 0] = 0.0
    assert train_joint._tokens(watch, trace[40:50], finer, dt) == ["effectiveness"] * 4
    assert train_joint._tokens(watch, trace[40:], {}, dt) == ["effectiveness"] * 4


def test_voices_that_stayed_alone_and_false_ones_are_counted():
    def flight(second, wrong):
        lanes = [["kinematic", "aircraft", ["q"] * 4, 0.0], ["lpv_smo", "aircraft", *second]]
        before = {"kinematic": [wrong, wrong, 0, 0, 0.2], "lpv_smo": [0, 0, 0, 0, 0.1]}
        return {"kind": "sensor.q", "segments": [], "technology": {}, "lanes": lanes, "before": before}

    late, quiet = flight((["ambiguous"] * 4, 6.0), 0), flight(([], None), 0) | {"kind": "", "lanes": []}
    found = train_joint.counted([flight(([], None), 0), flight((["ambiguous"] * 4, 0.5), 1), late, quiet])
    assert found["alone"] == {"kinematic": [2, 3, 1, 1, 0, 0, 0.8], "lpv_smo": [0, 3, 0, 0, 0, 0, 0.4]}
    cell = found["seen"]["kinematic"]["sensor.q"]
    assert cell == {"flights": 3, "said": [{"q": 3}] * 4, "late": [3] * 9}
    assert found["seen"]["lpv_smo"]["sensor.q"]["late"] == [0, 0, 1, 1, 1, 1, 2, 2, 2]


def test_the_page_counts_every_fault_once_and_who_came_too_late():
    def row(run, who, **more):
        healthy = {"run": run, "fault": 0, "id": who, "case": "sensor.q", "family": "aircraft's sensor",
                   "concerned": True, "detected": True, "delay_s": 1.0, "place_given": "right",
                   "place_level": "channel"}  # fmt: skip
        return healthy | more

    rows = pd.DataFrame([
        row("a", "joint"), row("a", "kinematic"), row("a", "lpv_smo", delay_s=2.0),
        row("b", "joint", delay_s=3.0, place_level="set", place_given="not given"), row("b", "kinematic"),
        row("b", "lpv_smo", delay_s=2.0),
        row("c", "joint", detected=False), row("c", "kinematic", detected=False), row("c", "lpv_smo", concerned=False),
    ])  # fmt: skip
    found = joint_page.counts(rows, {"a": "aircraft sensor", "b": "pairs", "c": "kinds not in the rates: q"})
    assert list(found["all"].values()) == [3, 2, 2, 1, 1, 0, 1, 0]
    assert list(found["of pairs"].values()) == [1, 1, 1, 1, 0, 0, 1, 0]
    assert list(found["kinds that no rate has seen"].values()) == [1, 0, 0, 0, 0, 0, 0, 0]
