"""Comparison of levels: expectations against the detectors, rows and statistics by hand, logs and matrix end to end."""

import fnmatch
import inspect
import json
import math

import numpy as np
import pandas as pd
import pytest
from report_browser import CHROMIUM, use

from cosim.campaign import EVALUATION_SEED, run_many
from cosim.campaign.inventory import builtin_names
from cosim.cli.commands import app
from cosim.compare import CompareError, compare, metrics, stats
from cosim.compare import rows as compare_rows
from cosim.compare.matrix import POINT, matrix
from cosim.flight.simulate import simulate
from cosim.judge import coverage
from cosim.report.compare_page import render, write_comparison
from cosim.scenario import catalog as c
from cosim.scenario import load_scenario
from fdi import registry
from fdi.common import verdict
from fdi.common.verdict import NAMES

CHOSEN = "detectors.enabled=['iotsekf','position_monitor','rfafe']"


def all_cases():
    """Return every case that a scenario can make."""
    out = {"aileron", "rudder", "stabiliser", "engine"} | {f"sensor.{s}" for s in c.SENSORS}
    for tech in c.TECHNOLOGIES:
        own = {seg: tech for seg in c.SEGMENTS}
        for kind, spec in c.ELEVATOR_KINDS.items():
            if tech in spec.technologies:
                out |= {coverage.case_of(kind, "elevator.left_inner", own, at) for at in spec.at or ("",)}
        out |= {coverage.case_of("bias", f"elevator.left_inner.{s}", own) for s in c.SENSORS_OF[tech]}
    return out


# -- expectations ------------------------------------------------------------------------------------------------------


def says(module):
    """Return the verdict classes that a detector's kernel can give: those that its step, or what it calls, names."""
    found, seen, todo = set(), set(), [module.step]
    while todo:
        function = getattr(todo.pop(), "py_func", None)
        if function is None or function in seen:
            continue
        seen.add(function)
        known = dict(inspect.getclosurevars(function).globals)
        known |= {n: getattr(m, n) for m in [*known.values()] if inspect.ismodule(m)
                  for n in function.__code__.co_names if hasattr(m, n)}  # fmt: skip
        codes = {name: value for name, value in known.items() if isinstance(value, float) and name.isupper()}
        found |= {name.lower() for name in codes if getattr(verdict, name, None) == codes[name]}
        todo += [value for value in known.values() if hasattr(value, "py_func")]
    return found & set(NAMES)


def test_every_detector_has_an_expectation_and_every_pattern_a_case():
    cases = all_cases()
    for detector, own in registry.records().items():
        assert own.group and own.blind and own.designed_for and own.summary and own.id == detector
        can = says(registry.module(detector)) - {"none"}
        assert can, detector
        for pattern, classes in {**own.designed_for, **own.may_see}.items():
            assert any(fnmatch.fnmatchcase(case, pattern) for case in cases), (detector, pattern)
            assert set(classes) <= can, (detector, pattern)  # what its kernel cannot say is not right either


def test_every_builtin_fault_makes_a_case_that_some_detector_or_none_is_said_to_see():
    known = all_cases()
    for name in builtin_names():
        for case in coverage.cases(load_scenario(name)):
            assert case in known, (name, case)
            assert coverage.label(case)


@pytest.mark.parametrize(
    "detector, case, word",
    [
        ("iotsekf", "hydraulic.ofc_liquid", "designed"),
        ("iotsekf", "hydraulic.ofc_liquid@command", "blind"),  # enters before the valve command that the filter takes
        (
            "rtsekf_flight",
            "hydraulic.runaway",
            "blind",
        ),  # it must stay quiet
        ("rtsekf_flight", "hydraulic.rod", "designed"),
        ("rfafe", "sensor.alpha", "blind"),  # no airframe output contributes
        ("lpv_smo", "sensor.alpha", "designed"),
        ("control_redundancy", "aileron", "blind"),  # invisible to forces on a transport
        ("control_redundancy", "engine", "designed"),
        ("ema_kalman_flight", "ema.runaway@command", "blind"),
        ("position_monitor", "hydraulic.ofc_liquid@command", "may"),
        ("ofc_monitor", "ema.ofc_liquid", "blind"),
        ("another", "engine", "undeclared"),
    ],
)
def test_expectations_follow_from_what_a_detector_reads(detector, case, word):
    assert coverage.expected(detector, case).word == word


def test_local_detectors_expect_nothing_of_another_technology():
    hydraulic, ema = ("iotsekf", "rtsekf", "rtsekf_flight", "ofc_monitor"), ("ema_kalman", "ema_kalman_flight")
    for detector in (*hydraulic, *ema):
        own = "hydraulic." if detector in hydraulic else "ema."
        others = [case for case in all_cases() if not case.startswith(own)]
        assert {coverage.expected(detector, case).word for case in others} == {"blind"}


def test_case_tells_places_of_entry_apart():
    tech = c.DEFAULT_TECHNOLOGY
    assert coverage.case_of("ofc_liquid", "elevator.left", tech, "valve") == "hydraulic.ofc_liquid"
    assert coverage.case_of("ofc_liquid", "elevator.right", tech, "command") == "ema.ofc_liquid@command"
    assert coverage.case_of("runaway", "elevator.left_inner", tech, "valve", limit=True) == "hydraulic.runaway@command"
    assert coverage.case_of("runaway", "elevator.right_inner", tech, "valve") == "ema.runaway@command"
    assert coverage.case_of("bias", "elevator.left_inner.rod", tech) == "hydraulic.rod"
    assert coverage.case_of("bias", "sensor.alpha", tech) == "sensor.alpha"
    assert coverage.case_of("thrust_loss", "engine.2", tech) == "engine"


# -- statistics, by hand -----------------------------------------------------------------------------------------------


def test_bounds_of_nothing_in_n_are_those_of_the_textbook():
    assert metrics.proportion(0, 24)[1:] == pytest.approx((0.0, 1.0 - 0.025 ** (1 / 24)))
    assert metrics.proportion(0, 0)[1:] == (0.0, 1.0)
    assert metrics.proportion(3, 4)[1:] == pytest.approx((0.1941, 0.9937), abs=1e-4)  # Clopper and Pearson's table


def hand_made():
    """Return rows of two detectors: 4 fault-free flights, 3 oscillations of 1, 2 and 4 mm and one engine failure."""
    out = []
    for name, level in (("iotsekf", "local"), ("lpv_smo", "aircraft")):
        peaks = (0.2, 0.4, 0.6, 0.8) if level == "local" else (0.5, 1.5, 0.5, 0.5)
        for i, r in enumerate(peaks):
            out.append(
                {
                    "run": f"free{i}",
                    "case": None,
                    "r_fault_free": r,
                    "r_fault": np.nan,
                    "false_alarms": int(r > 1),
                    "concerned": False,
                    "word": None,
                    "detected": False,
                    "outcome": None,
                    "delay_s": np.nan,
                    "class": None,
                    "id": name,
                    "level": level,
                }
            )
        for mm, r, seen in ((1.0, 0.7, False), (2.0, 3.0, level == "local"), (4.0, 9.0, True)):
            word = coverage.expected(name, "hydraulic.ofc_liquid").word
            out.append(
                {
                    "run": f"ofc{mm:g}",
                    "case": "hydraulic.ofc_liquid",
                    "r_fault_free": np.nan,
                    "r_fault": r,
                    "false_alarms": 0,
                    "concerned": True,
                    "word": word,
                    "detected": seen,
                    "outcome": "named" if seen else "missed",
                    "delay_s": 0.5 if seen else np.nan,
                    "class": "ofc_liquid" if seen else None,
                    "id": name,
                    "level": level,
                    "frequency_hz": 1.0,
                    "amplitude_mm": mm,
                }
            )
        out.append(
            {
                "run": "engine",
                "case": "engine",
                "r_fault_free": np.nan,
                "r_fault": 0.1,
                "false_alarms": 0,
                "concerned": level == "aircraft",
                "word": coverage.expected(name, "engine").word,
                "detected": level == "aircraft",
                "outcome": "bonus" if level == "aircraft" else "quiet",
                "delay_s": 1.0 if level == "aircraft" else np.nan,
                "class": None,
                "id": name,
                "level": level,
            }
        )
    rows = pd.DataFrame(out)
    rows["hours"], rows["idle"], rows["target"], rows["manoeuvre_key"] = 0.01, False, "elevator.left_inner", "{}"
    rows["family"] = rows["case"].map({"hydraulic.ofc_liquid": "liquid OFC, one segment", "engine": "engine"})
    rows["fault"] = rows["case"].map(lambda c: None if c is None else 0)
    rows["time_to_right_s"] = 2.0 * rows["delay_s"].where(rows["outcome"] == "named")
    rows["class_changes"], rows["not_excited"], rows["why_not_valid"], rows["withdrawn"] = 1.0, False, None, None
    rows["withdrawn_after_s"], rows["standing_s"], rows["valid_share"] = np.nan, 0.0, 1.0
    rows["bound_mm"], rows["first_right"], rows["alarm_share"], rows["ambiguous_s"] = np.nan, rows["detected"], 1.0, 0.0
    rows["first_verdict"], rows["right_after_motion_s"] = rows["class"], np.nan
    return rows


def test_detectors_are_counted_over_what_they_were_designed_for():
    local, aircraft = stats.detectors(hand_made())
    assert (local["designed"], local["detected"], local["missed"], local["named"]) == (3, 2, 1, 2)
    assert (local["delay_s"], local["delay_s_p95"], local["delay_s_max"]) == (0.5, math.inf, 0.5)
    assert (local["fault_free_runs"], local["fault_free_alarmed"], local["false_alarms_per_hour"]) == (4, 0, 0.0)
    assert (aircraft["detected"], aircraft["fault_free_alarmed"], aircraft["false_alarms"]) == (1, 1, 1)
    assert aircraft["false_alarms_per_hour"] == pytest.approx(1 / (8 * 0.01))


def test_equal_thresholds_leave_the_same_number_of_crossings():
    rows = hand_made()
    for alpha, allowed in ((0.0, 0), (0.25, 1)):
        for name, (c_, k, n, _) in stats.equal_thresholds(rows, alpha).items():
            own = rows[(rows["id"] == name) & rows["case"].isna()]["r_fault_free"]
            assert (k, n) == (allowed, 4) and (own >= c_).sum() <= k
    assert stats.equal_thresholds(rows, 0.0)["iotsekf"][0] == pytest.approx(0.8)
    assert stats.equal_thresholds(rows, 0.25)["lpv_smo"][0] == pytest.approx(0.5)


def test_shares_of_maxima_beyond_a_threshold():
    free, hit = stats.maxima(hand_made())["iotsekf"]
    assert sorted(free) == [0.2, 0.4, 0.6, 0.8] and sorted(hit) == [0.7, 3.0, 9.0]
    assert metrics.beyond(hit, np.array([0.1, 1.0, 10.0])) == pytest.approx([1.0, 2 / 3, 0.0])
    assert np.isnan(metrics.beyond(np.array([]), np.ones(2))).all()


def test_groups_and_the_smallest_oscillation_that_each_sees():
    rows = hand_made()
    grouped = stats.by_group(rows, stats.detectors(rows))
    assert set(grouped["group"]) == {"actuator filters", "airframe motion"}
    engine = grouped[grouped["case"] == "engine"].set_index("group")
    assert not engine.loc["actuator filters", "able"]


def test_confusion_has_none_and_false_alarms_as_columns():
    rows = hand_made()
    counts = stats.confusion(rows, "lpv_smo")
    assert counts.loc["hydraulic.ofc_liquid", "none"] == 2 and counts.loc["hydraulic.ofc_liquid", "ofc_liquid"] == 1
    assert counts.loc["no fault", "false alarm"] == 1 and counts.loc["no fault", "none"] == 3


def test_alarm_that_the_manoeuvre_raises_alone_is_no_detection():
    rows = hand_made()
    rows.loc[(rows["id"] == "lpv_smo") & rows["case"].isna(), "false_alarms"] = 1
    told = compare_rows.echoes(rows)
    own = told[(told["id"] == "lpv_smo") & told["case"].notna()]
    assert not own["detected"].any() and (own["outcome"] == "echo").sum() == 2
    assert told[told["id"] == "iotsekf"]["detected"].sum() == 2


# -- flights -----------------------------------------------------------------------------------------------------------


def test_matrix_flies_every_builtin_fault_on_seeds_of_the_evaluation():
    flights = matrix()
    assert 40 <= len(flights) <= 120
    seeds = [s.seed for s in flights]
    assert min(seeds) >= EVALUATION_SEED and len(set(seeds)) == len(seeds)
    kinds = {(f.kind, f.target.split(".")[0]) for s in flights for f in s.faults}
    single = [s.faults[0] for s in map(load_scenario, builtin_names()) if len(s.faults) == 1]
    wanted = {(f.kind, f.target.split(".")[0]) for f in single}
    assert kinds >= wanted
    assert all(f.start_s >= 20.0 for s in flights for f in s.faults)  # control_redundancy learns for 20 s
    assert all(s.flight.mass_t == POINT["flight.mass_t"] for s in flights if s.flight.cas_kt)
    free = [s for s in flights if not s.faults]
    assert len(free) >= 20 and {s.manoeuvre for s in flights} == {s.manoeuvre for s in free}


@pytest.fixture(scope="module")
def flights():
    base = ["duration_s=7", "faults.0.start_s=3", CHOSEN]
    ofc = [load_scenario("liquid-ofc", [*base, f"faults.0.amplitude_mm={mm}", "seed=1000001"]) for mm in (1.0, 8.0)]
    return [*ofc, load_scenario("cruise", ["duration_s=7", CHOSEN, "seed=1000002"])]


@pytest.fixture(scope="module")
def logs(flights, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for i, scenario in enumerate(flights):
        simulate(scenario, log=folder / f"{i}.mcap")
    return sorted(folder.glob("*.mcap"))


def test_logs_give_the_rows_of_a_campaign_of_the_same_flights(flights, logs):
    result = run_many(flights, workers=0)
    frame, _, tomls = compare_rows.of_result(result, flights)
    by = ["run", "id"]
    flown = compare_rows.tidy(frame, tomls).sort_values(by, ignore_index=True)
    read = compare_rows.tidy(*compare_rows.of_logs(logs)).sort_values(by, ignore_index=True)
    keys = ["case", "id", "level", "lanes", "word", "concerned", "detected", "class", "outcome", "false_alarms"]
    pd.testing.assert_frame_equal(flown[keys], read[keys])
    for column in (
        "delay_s",
        "amplitude_mm",
        "rod_mm",
        "hours",
        "r_fault",
        "r_fault_free",
    ):
        np.testing.assert_allclose(flown[column], read[column], rtol=1e-6)
    assert flown["detected"].any() and flown["r_fault_free"].notna().sum() == 3


def test_compare_of_a_folder_of_logs_writes_table_and_report(logs, tmp_path):
    found = compare([logs[0].parent])
    write_comparison(found, tmp_path / "out")
    told = found.to_dict()
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert told["runs"] == 3 and {d["id"] for d in told["detectors"]} == {"iotsekf", "position_monitor", "rfafe"}
    for d in told["detectors"]:
        assert {"id", "level", "detected", "missed", "false_alarms_per_hour", "delay_s"} <= set(d)
    rows = pd.read_parquet(told["table"])
    assert len(rows) == len(pd.read_csv(tmp_path / "out" / "compare.csv")) == 9
    assert not any(d["beyond_physics"] for d in told["detectors"])
    assert found.report.read_text("utf-8").startswith("<!doctype html>")


def test_compare_of_a_campaign_folder_is_that_of_its_rows(flights, tmp_path):
    run_many(flights, workers=0, out=tmp_path / "c")
    found = compare([tmp_path / "c"])
    frame, _, tomls = compare_rows.of_campaign(tmp_path / "c")
    pd.testing.assert_frame_equal(found.rows.drop(columns=["bound_mm", "best"]), compare_rows.tidy(frame, tomls))
    assert found.runs == 3 and all(d["step_us"] is None or d["step_us"] > 0 for d in found.detectors)


def test_report_compares_one_log_and_many_cells(logs):
    assert "no fault-free flight was flown" in render(compare(logs[:1]))
    rows = compare(logs).rows
    ofc = rows[rows["case"].notna()]
    many = pd.concat(
        [ofc.assign(run=f"r{i}", amplitude_mm=ofc["amplitude_mm"] * (1 + i / 50)) for i in range(100)] + [rows]
    )
    made = compare(logs[:1])
    made.rows, made.detectors = many.reset_index(drop=True), stats.detectors(many)
    text = render(made)
    assert '"heatmap"' in text and "NaN" not in text.split('id="figures">')[1].split("</script>")[0]


def test_command_prints_one_json_object(logs, tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        app(["compare", *map(str, logs), "-o", str(tmp_path / "o"), "--json"])
    assert end.value.code == 0
    told = json.loads(capsys.readouterr().out)
    assert told["runs"] == 3 and told["report"].endswith("compare.html")


def test_folder_without_flights_gets_a_clear_error(tmp_path, logs):
    from cosim.errors import CosimError

    with pytest.raises(CosimError, match="holds no"):
        compare([tmp_path])
    with pytest.raises(CompareError, match="folder"):
        compare([tmp_path, logs[0]])


def test_delays_are_never_negative_and_missing_ones_are_null(logs):
    rows = compare(logs).rows
    assert (rows["delay_s"].dropna() >= 0).all()
    assert rows.loc[~rows["detected"], "delay_s"].isna().all()
    assert not any(math.isinf(x) for x in rows["delay_s"].dropna())


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_browser_draws_every_figure_of_a_comparison(logs, tmp_path):
    made = compare(logs)
    write_comparison(made, tmp_path / "out")
    found = use(made.report, tmp_path)
    assert found["errors"] == [] and found["requests"] == [] and not found["overflow"]
    assert {"maps", "delays", "false-alarms", "sweeps"} <= {p["id"] for p in found["plots"]}
    assert all(p["svg"] and p["traces"] and p["marks"] for p in found["plots"])
    assert found["theme"][2] != found["theme"][3]
    assert found["toggle"]["off"] == 0 < found["toggle"]["before"] == found["toggle"]["on"]


def test_many_frequencies_are_taken_together_in_octaves():
    hz, mm = np.geomspace(0.4, 5.5, 40), np.linspace(1.0, 9.0, 40)
    about = {"group": "g", "family": "f", "able": True, "bound_mm": 0.5}
    rows = [
        {**about, "frequency_hz": f, "amplitude_mm": a, "seen": a > 3.0 + ((i + j) % 5 - 2) / 4}
        for i, f in enumerate(hz)
        for j, a in enumerate(mm)
    ]
    found = {d["frequency_hz"]: d for d in stats.sizes(pd.DataFrame(rows))}
    assert list(found) == [0.5, 1.0, 2.0, 4.0]
    assert all(3.0 < d["a90"] < d["a90_95"] < 4.0 for d in found.values())
    assert all((d["bound_mm"], d["below"]) == (0.5, 0) for d in found.values())


def test_every_flight_stands_in_one_column_and_what_could_not_judge_stays_in_the_denominator():
    rows = hand_made()
    mine = (rows["id"] == "lpv_smo") & (rows["case"] == "hydraulic.ofc_liquid")
    rows.loc[mine & (rows["amplitude_mm"] == 1.0), "idle"] = True
    rows.loc[mine & (rows["amplitude_mm"] == 1.0), "why_not_valid"] = "outside its box (mass)"
    d = stats.detectors(rows)[1]
    assert (d["designed"], d["detected"], d["idle"], d["missed"]) == (3, 1, 1, 1)
    assert sum(d[word] for word in stats.WORDS) == d["designed"] and d["why_not_valid"] == "outside its box (mass)"
    assert d["detection_probability"] == pytest.approx(1 / 3)  # not 1/2: leaving it out would flatter
    assert d["right_s"] == math.inf and stats.detectors(rows)[0]["right_s"] == 1.0
