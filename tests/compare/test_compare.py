"""Comparison of levels: logs and matrix end to end."""

import json
import shutil
import tomllib

import numpy as np
import pandas as pd
import pytest

from cosim.campaign.engine import run_many
from cosim.campaign.worker import run_id
from cosim.compare import compare, stats
from cosim.compare import rows as compare_rows
from cosim.errors import CosimError
from cosim.flight.simulate import simulate
from cosim.report import write_comparison
from cosim.report.compare_page import render
from cosim.scenario import load_scenario, parse
from cosim.scenario.load import applied

CHOSEN = "detectors.enabled=['iotsekf','position_monitor','rfafe']"


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


def test_a_flight_that_ends_before_its_fault_counts_as_one_without(tmp_path):
    change = ["duration_s=3", "faults.0.start_s=5", CHOSEN]
    simulate(load_scenario("liquid-ofc", change), log=tmp_path / "short.mcap")
    rows = compare_rows.tidy(*compare_rows.of_logs([tmp_path / "short.mcap"])[:2])
    assert len(rows) == 3 and not rows["concerned"].any() and rows[["case", "outcome"]].isna().all(axis=None)


def test_logs_give_the_rows_of_a_campaign_of_the_same_flights(flights, logs):
    result = run_many(flights, workers=0)
    frame, tomls = result.frame, {run_id(s): s.expanded_toml() for s in flights}
    by = ["run", "id"]
    flown = compare_rows.tidy(frame, tomls).sort_values(by, ignore_index=True)
    read = compare_rows.tidy(*compare_rows.of_logs(logs)[:2]).sort_values(by, ignore_index=True)
    keys = ["case", "id", "level", "lanes", "word", "concerned", "detected", "isolated_class", "outcome"]
    keys.append("false_alarms")
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


def test_logs_of_one_flight_count_once_each_detector_by_its_first_log(flights, logs, tmp_path):
    shutil.copy(logs[0], tmp_path / "0.mcap")
    shutil.copy(logs[0], tmp_path / "1.mcap")
    more = parse(applied(tomllib.loads(flights[0].expanded_toml()), ["detectors.enabled=['iotsekf','ofc_monitor']"])[0])
    simulate(more, log=tmp_path / "2.mcap")
    (tmp_path / "3.mcap").write_bytes(logs[0].read_bytes()[: logs[0].stat().st_size * 2 // 3])
    found = compare([tmp_path])
    assert "counted once: 1.mcap of 0.mcap, 2.mcap of 0.mcap, 3.mcap of 0.mcap; ends early" in found.source
    assert found.source.endswith("judged up to there: 3.mcap") and found.runs == 1
    assert sorted(found.rows["id"]) == ["iotsekf", "ofc_monitor", "position_monitor", "rfafe"]
    assert {d["id"]: d["designed"] for d in found.detectors}["iotsekf"] == 1


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
    assert found.report.read_text("utf-8").startswith("<!doctype html>")


def test_two_campaigns_stand_side_by_side_on_the_flights_of_both(flights, tmp_path):
    """One detector is changed between them, one flight is in the second alone."""
    run_many(flights, workers=0, out=tmp_path / "before")
    late = ["detectors.position_monitor.t_confirm=9"]
    deaf = [parse(applied(tomllib.loads(s.expanded_toml()), late)[0]) for s in flights]
    more = load_scenario("cruise", ["duration_s=7", CHOSEN, "seed=1000003"])
    run_many([*deaf, more], workers=0, out=tmp_path / "after")
    found = compare([tmp_path / "before", tmp_path / "after"])
    names = ["position_monitor (before)", "position_monitor (after)"]
    assert [d["id"] for d in found.detectors] == names and found.runs == 3
    assert "3 flights in both, 1 only in after left out" in found.source and "iotsekf, rfafe" in found.source
    seen = [d["alarmed_on"] for d in found.detectors]
    (pair,) = found.pairs
    assert seen == [1, 0] and (pair["a"], pair["b"], pair["n"], pair["only_a"], pair["only_b"]) == (*names, 2, 1, 0)
    assert set(found.rows["word"].dropna()) == {"may"}  # by the record of the name without the campaign
    text = render(found)
    assert "Two campaigns side by side" in text and "position_monitor (before) alone in 1" in text
    assert json.loads(json.dumps(found.to_dict()))["pairs"]
    shutil.copytree(tmp_path / "before", tmp_path / "again")
    assert "every detector the same" in compare([tmp_path / "before", tmp_path / "again"]).source
    with pytest.raises(CosimError, match="named twice"):
        compare([tmp_path / "before", tmp_path / "after" / ".." / "before"])


def test_folder_without_flights_gets_a_clear_error(tmp_path, logs):
    from cosim.errors import CosimError

    with pytest.raises(CosimError, match="holds no"):
        compare([tmp_path])
    with pytest.raises(CosimError, match="folder"):
        compare([tmp_path, logs[0]])


def test_many_frequencies_are_taken_together_in_octaves():
    hz, mm = np.geomspace(0.4, 5.5, 40), np.linspace(1.0, 9.0, 40)
    about = {"group": "g", "family": "f", "able": True}
    rows = [
        {**about, "frequency_hz": f, "amplitude_mm": a, "seen": a > 3.0 + ((i + j) % 5 - 2) / 4}
        for i, f in enumerate(hz)
        for j, a in enumerate(mm)
    ]
    found = {d["frequency_hz"]: d for d in stats.sizes(pd.DataFrame(rows))}
    assert list(found) == [0.5, 1.0, 2.0, 4.0]
    assert all(3.0 < d["a90"] < d["a90_95"] < 4.0 for d in found.values())
