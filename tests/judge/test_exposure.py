"""Hours in which a false alarm would count, by hand: a rate's denominator, from one lane to a table."""

import math

import numpy as np
import pandas as pd
import pytest

from cosim.compare import stats
from cosim.compare.rows import tidy
from cosim.judge import row
from cosim.judge.alarms import GRACE_S, exposure_s
from cosim.judge.detection import watch_of
from cosim.judge.result import judge
from cosim.scenario import load_scenario

DT = 0.1
FIELDS = ("alarm", "verdict", "culprit", "r", "valid", "why")
LEFT, RIGHT = (
    watch_of("iotsekf", "local", f"elevator.{s}", ("", "rod"), {n: i for i, n in enumerate(FIELDS)})
    for s in ("left_inner", "right_inner")
)
FAULT = {"fault": 0, "case": "hydraulic.ofc_liquid", "kind": "ofc_liquid", "targets": ("elevator.left_inner",),
         "start_s": 5.0, "end_s": 6.0, "period_s": 0.5}  # fmt: skip


def flown(first_valid):
    """Return 10 s of a lane that is valid from a tick on, without an alarm."""
    trace = np.zeros((100, len(FIELDS)))
    trace[first_valid:, 4] = 1.0
    return trace


def test_an_alarm_counts_where_the_lane_is_valid_and_no_fault_is_there_or_has_just_ended():
    assert GRACE_S == 2.0
    valid = flown(30)[:, 4]
    assert exposure_s(valid, (), DT) == pytest.approx(7.0)  # from 3 s
    assert exposure_s(valid, [FAULT], DT) == pytest.approx(2.0 + 2.0)  # 3 to 5 s, and from 6 + 2 s to the end
    assert exposure_s(valid, [FAULT | {"end_s": math.inf}], DT) == pytest.approx(2.0)
    assert exposure_s(0.0 * valid, (), DT) == 0.0


def test_a_lane_is_exposed_where_no_fault_concerns_it():
    assert judge(LEFT, flown(30), DT, [FAULT])["exposed_s"] == pytest.approx(4.0)
    assert judge(RIGHT, flown(30), DT, [FAULT])["exposed_s"] == pytest.approx(7.0)
    always = watch_of("iotsekf", "local", "elevator.left_inner", ("", "rod"), {n: i for i, n in enumerate(FIELDS[:4])})
    assert judge(always, flown(30), DT, [])["exposed_s"] == pytest.approx(10.0)


def test_hours_of_a_detector_are_the_mean_of_its_lanes_counted_once_and_stand_under_its_rate():
    entries = [judge(w, flown(30), DT, [FAULT, FAULT | {"fault": 1, "start_s": 5.5}]) for w in (LEFT, RIGHT)]
    result = {"status": "completed", "reason": "", "sim_time_s": 10.0, "achieved": {}, "detectors": entries}
    lanes = row.rows("a", result)
    assert [one["exposed_s"] for one in lanes] == pytest.approx([4.0, 0.0, 7.0])  # two rows of the faulty lane
    given = [f"faults.{i}.{k}={v}" for i, start in enumerate((5.0, 5.5)) for k, v in
             {"target": "elevator.left_inner", "kind": "ofc_liquid", "at": "valve", "start_s": start, "end_s": 6.0,
              "frequency_hz": 2.0, "amplitude_mm": 1.0}.items()]  # fmt: skip
    toml = load_scenario("cruise", ["duration_s=10", *given]).expanded_toml()
    found = tidy(pd.DataFrame(lanes), {"a": toml})
    assert found["lanes"].tolist() == [2, 2]  # each fault's own row of the faulty lane, and the other lane
    assert found["hours"].tolist() == pytest.approx([5.5 / 3600.0, math.nan], nan_ok=True)
    free = found.assign(case=None, false_alarms=[1, 0], word=None)
    (told,) = stats.detectors(free)
    assert told["hours"] == pytest.approx(5.5 / 3600.0) and told["false_alarms_per_hour"] == pytest.approx(3600.0 / 5.5)


def test_a_detector_that_is_never_valid_has_no_rate():
    entry = judge(LEFT, flown(100), DT, [])
    result = {"status": "completed", "reason": "", "sim_time_s": 10.0, "achieved": {}, "detectors": [entry]}
    toml = load_scenario("cruise", ["duration_s=10"]).expanded_toml()
    (told,) = stats.detectors(tidy(pd.DataFrame(row.rows("a", result)), {"a": toml}))
    assert told["hours"] == 0.0 and math.isnan(told["false_alarms_per_hour"])


def test_a_cell_of_a_row_that_holds_nothing_is_no_error():
    """A folder may be damaged in any cell that is not asked for."""
    entry = judge(LEFT, flown(0), DT, [FAULT])
    result = {"status": "completed", "reason": "", "sim_time_s": 10.0, "achieved": {}, "detectors": [entry]}
    given = [f"faults.0.{k}={v}" for k, v in {"target": "elevator.left_inner", "kind": "ofc_liquid", "at": "valve",
             "start_s": 5.0, "frequency_hz": 2.0, "amplitude_mm": 1.0}.items()]  # fmt: skip
    toml = load_scenario("cruise", ["duration_s=10", *given]).expanded_toml()
    (lane,) = row.rows("a", result)
    for nothing in (None, math.nan):
        changed = lane | {"delay_s": 0.5, "detected_at_s": nothing, "lane": nothing}
        (found,) = tidy(pd.DataFrame([changed]), {"a": toml}).to_dict("records")
        assert found["detected"] and found["hours"] > 0.0
