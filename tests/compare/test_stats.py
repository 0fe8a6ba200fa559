"""Statistics of a comparison over rows by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from cosim.compare import Comparison, stats
from cosim.compare import rows as compare_rows
from cosim.errors import CosimError
from cosim.judge import coverage
from cosim.judge.row import FIELDS
from cosim.scenario import load_scenario


def hand_made():
    """Return rows of two detectors: 4 fault-free flights, 3 oscillations of 1, 2 and 4 mm and one engine failure."""
    out = []
    none = {"r_fault_free": np.nan, "false_alarms": 0, "delay_s": np.nan, "isolated_class": None}
    for name, level in (("iotsekf", "local"), ("lpv_smo", "aircraft")):
        local, about = level == "local", none | {"id": name, "level": level}
        free = about | {"case": None, "r_fault": np.nan, "concerned": False, "word": None, "detected": False,
                        "outcome": None}  # fmt: skip
        for i, r in enumerate((0.2, 0.4, 0.6, 0.8) if local else (0.5, 1.5, 0.5, 0.5)):
            out.append(free | {"run": f"free{i}", "r_fault_free": r, "false_alarms": int(r > 1)})
        ofc = about | {"case": "hydraulic.ofc_liquid", "concerned": True, "frequency_hz": 1.0,
                       "word": coverage.expected(name, "hydraulic.ofc_liquid")}  # fmt: skip
        seen = {"detected": True, "outcome": "named", "delay_s": 0.5, "isolated_class": "ofc_liquid"}
        for mm, r, found in ((1.0, 0.7, False), (2.0, 3.0, local), (4.0, 9.0, True)):
            said = seen if found else {"detected": False, "outcome": "missed"}
            out.append(ofc | {"run": f"ofc{mm:g}", "r_fault": r, "amplitude_mm": mm, **said})
        engine = {"run": "engine", "case": "engine", "r_fault": 0.1, "word": coverage.expected(name, "engine")}
        said = {"outcome": "quiet"} if local else {"outcome": "bonus", "delay_s": 1.0}
        out.append(about | engine | said | {"concerned": not local, "detected": not local})
    rows = pd.DataFrame(out)
    rows["hours"], rows["not_valid"], rows["target"], rows["manoeuvre_key"] = 0.01, False, "elevator.left_inner", "{}"
    rows["family"] = rows["case"].map({"hydraulic.ofc_liquid": "liquid OFC, one segment", "engine": "engine"})
    rows["fault"] = rows["case"].map(lambda c: None if c is None else 0)
    rows["time_to_right_s"] = 2.0 * rows["delay_s"].where(rows["outcome"] == "named")
    rows["class_changes"], rows["not_excited"], rows["why_not_valid"], rows["withdrawn"] = 1.0, False, None, None
    rows["masked"] = False
    rows["withdrawn_after_s"], rows["standing_s"], rows["valid_share"] = np.nan, 0.0, 1.0
    rows["first_right"], rows["ambiguous_s"] = rows["detected"], 0.0
    rows["alarm_share"] = np.where(rows["detected"], 1.0, np.nan)
    rows["class_given"] = rows["outcome"].map({"named": "right", "bonus": "wrong"}).fillna("not given")
    rows["place_given"] = rows["outcome"].map({"named": "right"}).fillna("not given")
    finest = np.where(rows["level"] == "local", "segment", "axis")
    rows["place_level"] = np.where(rows["outcome"] == "named", finest, "")
    rows["first_sure_wrong"] = rows["outcome"] == "bonus"
    rows["first_verdict"], rows["right_after_motion_s"] = rows["isolated_class"], rows["time_to_right_s"]
    rows["right"] = rows["outcome"] == "named"
    return compare_rows.with_alarms_anyway(rows)


def test_detectors_are_counted_over_what_they_were_designed_for():
    local, aircraft = stats.detectors(hand_made())
    assert (local["designed"], local["detected"], local["missed"], local["named"]) == (3, 2, 1, 2)
    assert (local["delay_s"], local["delay_s_p95"], local["delay_s_max"]) == (0.5, math.inf, 0.5)
    assert (local["fault_free_runs"], local["fault_free_alarmed"], local["false_alarms_per_hour"]) == (4, 0, 0.0)
    assert (aircraft["detected"], aircraft["fault_free_alarmed"], aircraft["false_alarms"]) == (1, 1, 1)
    assert aircraft["false_alarms_per_hour"] == pytest.approx(1 / (8 * 0.01))


def test_groups_and_the_smallest_oscillation_that_each_sees():
    rows = hand_made()
    grouped = stats.by_group(rows, stats.detectors(rows))
    assert set(grouped["group"]) == {"actuator filters", "airframe motion"}
    engine = grouped[grouped["case"] == "engine"].set_index("group")
    assert not engine.loc["actuator filters", "able"]


def test_sizes_are_by_frequency_in_octaves_where_there_are_many():
    hz = np.array([0.36, 0.7, 0.72, 1.41, 1.42, 2.0, 5.0, 6.0, 9.0, 11.0, 12.0, 13.0, 14.0, 15.0, 17.0, 20.0])
    assert len(hz) > stats.FREQUENCIES
    assert stats.bands(pd.Series(hz))[:6].tolist() == [0.5, 0.5, 1.0, 1.0, 2.0, 2.0]
    rows = hand_made()
    found = stats.sizes(stats.by_group(rows, stats.detectors(rows)))
    assert {row["frequency_hz"] for row in found} == {1.0}


def test_beside_what_was_seen_stands_how_often_the_same_manoeuvre_alarms_without_the_fault():
    rows = hand_made().drop(columns="alarms_anyway", errors="ignore")
    rows.loc[(rows["id"] == "lpv_smo") & rows["case"].isna(), "false_alarms"] = 1
    told = compare_rows.with_alarms_anyway(rows)
    own = told[told["id"] == "lpv_smo"]
    assert own["detected"].equals(told.loc[own.index, "detected"]) and set(own["alarms_anyway"]) == {1.0}
    each = {d["id"]: d for d in stats.detectors(told)}
    assert each["lpv_smo"]["alarms_anyway"] == 1.0 and each["iotsekf"]["alarms_anyway"] == 0.0
    assert each["lpv_smo"]["detected"] == 1  # designed for, and as before


def test_every_flight_stands_in_one_column_and_what_could_not_judge_stays_in_the_denominator():
    rows = hand_made()
    mine = (rows["id"] == "lpv_smo") & (rows["case"] == "hydraulic.ofc_liquid")
    unable = mine & (rows["amplitude_mm"] == 1.0)
    rows.loc[unable, ["not_valid", "outcome", "why_not_valid"]] = True, "not_valid", "outside its box (mass)"
    d = stats.detectors(rows)[1]
    assert (d["designed"], d["detected"], d["not_valid"], d["missed"]) == (3, 1, 1, 1)
    assert sum(d[word] for word in stats.WORDS) == d["designed"] and d["why_not_valid"] == "outside its box (mass)"
    assert d["detection_probability"] == pytest.approx(1 / 3)  # not 1/2: leaving it out would flatter
    assert d["right_s"] == math.inf and stats.detectors(rows)[0]["right_s"] == 1.0


def test_faults_are_counted_by_the_level_that_saw_them_and_places_by_what_a_joint_verdict_gave():
    rows = hand_made()
    joint = rows[rows["id"] == "lpv_smo"].copy()
    joint["id"], joint["level"], joint["place_level"] = "joint", "both", ""
    joint.loc[joint["run"] == "ofc1", ["detected", "place_given", "place_level"]] = True, "not given", "set"
    known = joint["run"].isin(["ofc2", "ofc4"])
    joint.loc[known, ["detected", "place_given", "place_level"]] = True, "right", "channel"
    joint.loc[joint["run"] == "ofc2", "place_level"] = "segment"
    rows = pd.concat([rows, joint], ignore_index=True)
    rows["family"] = rows["family"].replace("engine", "engine or other surface")
    found = {d["family"]: d for d in stats.by_level(rows, stats.detectors(rows))}
    ofc = found["liquid OFC, one segment"]
    assert [ofc[k] for k in ("faults", "local", "aircraft", "both", "nobody")] == [3, 1, 0, 1, 1]
    assert [ofc[k] for k in ("joint", "right", "coarse", "open", "wrong")] == [3, 1, 1, 1, 0]
    engine = found["engine or other surface"]  # lpv_smo only may see it
    assert [engine[k] for k in ("faults", "local", "aircraft", "both", "nobody")] == [1, 0, 1, 0, 0]


def test_a_fault_rate_that_is_none_is_refused_and_one_gives_each_detector_its_predictive_value():
    rows = hand_made()
    found = Comparison(rows, stats.detectors(rows), 8, 0, "by hand")
    for rate in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(CosimError, match="faults per flight hour"):
            found.predictive([rate])
    iotsekf, lpv_smo = found.predictive([0.5])
    assert (iotsekf["value"], lpv_smo["id"]) == (1.0, "lpv_smo")
    assert lpv_smo["value"] == pytest.approx(0.5 / 3 / (0.5 / 3 + 1 / 0.08))  # one of three seen, one false in 0.08 h


def lanes_of(*more, exposed=(4.0, 0.0, 7.0)):
    """Return rows per lane as a campaign has them: two faults of the left lane, none of the right one."""
    about = {"run": "a", "status": "completed", "sim_time_s": 10.0, "id": "iotsekf", "level": "local", "able": True,
             "valid_share": 1.0, "false_alarms": 0, "standing_s": 0.0}  # fmt: skip
    each = ({"lane": 0, "fault": 0, "concerned": True}, {"lane": 0, "fault": 1, "concerned": True},
            {"lane": 1, "fault": None, "concerned": False})  # fmt: skip
    given = [about | own | {"exposed_s": s} | dict(more) for own, s in zip(each, exposed)]
    return pd.DataFrame(given, columns=[f.name for f in FIELDS])


def flown(*starts):
    given = [f"faults.{i}.{k}={v}" for i, start in enumerate(starts) for k, v in
             {"target": "elevator.left_inner", "kind": "ofc_liquid", "at": "valve", "start_s": start, "end_s": 6.0,
              "frequency_hz": 2.0, "amplitude_mm": 1.0}.items()]  # fmt: skip
    return {"a": load_scenario("cruise", ["duration_s=10", *given]).expanded_toml()}


def test_hours_of_a_detector_are_the_mean_of_its_lanes_counted_once_and_stand_under_its_rate():
    found = compare_rows.tidy(lanes_of(), flown(5.0, 5.5))
    assert found["lanes"].tolist() == [2, 2]  # each fault's own row of the faulty lane, and the other lane
    assert found["hours"].tolist() == pytest.approx([5.5 / 3600.0, math.nan], nan_ok=True)
    (told,) = stats.detectors(found.assign(case=None, false_alarms=[1, 0], word=None))
    assert told["hours"] == pytest.approx(5.5 / 3600.0) and told["false_alarms_per_hour"] == pytest.approx(3600.0 / 5.5)
    never = compare_rows.tidy(lanes_of(("fault", None), ("concerned", False), exposed=(0.0, 0.0, 0.0)), flown())
    (told,) = stats.detectors(never)
    assert told["hours"] == 0.0 and math.isnan(told["false_alarms_per_hour"])
