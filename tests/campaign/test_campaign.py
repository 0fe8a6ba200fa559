"""Campaigns: a row per run and lane, nothing lost or flown twice, whoever flies them, whatever is killed."""

import concurrent.futures as cf
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest
import worker_calls
from worker_calls import die_once, flights, killed

from cosim.campaign import pool as campaign_pool
from cosim.campaign.flights import flatten, run_many
from cosim.campaign.store import FILES, MANIFEST, Store, fingerprint, load
from cosim.campaign.worker import failed, run_id
from cosim.errors import CampaignError, OutputError
from cosim.scenario import load_scenario


def infeasible():
    return load_scenario("cruise", ["flight.mass_t=400", "flight.altitude_ft=44000", "duration_s=2"])


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Five flights and a point without a trim, flown in this process into a folder."""
    out = tmp_path_factory.mktemp("campaign")
    return run_many([*flights(5), infeasible()], workers=0, out=out), out


def test_a_run_has_one_row_per_detector_lane_and_what_a_reader_needs(flown):
    result, _ = flown
    assert (result.done, result.failed, result.resumed) == (6, 1, 0)
    rows = result.frame[result.frame["status"] == "completed"]
    assert list(rows.groupby("run").size()) == [6] * 5  # 2 hydraulic lanes, 4 of the position monitor
    mine = rows[(rows["id"] == "iotsekf") & (rows["target"] == "elevator.left_inner")]
    assert mine["concerned"].all() and mine["alarm"].all() and (mine["delay_periods"] < 3).all()
    assert (mine["isolated_class"] == "ofc_liquid").all()
    assert (mine["r_max_before"] < 1).all() and (mine["r_max_after"] > 1).all()
    assert mine["amplitude_mm"].between(7, 10).all()  # 8 mm by the linear loop
    assert list(mine["seed"]) == [1_000_000 + i for i in range(5)]
    pd.testing.assert_frame_equal(pd.read_parquet(result.parquet), result.frame, check_dtype=False)


def test_a_point_without_a_trim_is_a_row_with_its_reason(flown):
    row = flown[0].frame.iloc[-1]
    assert row["status"] == "infeasible" and "44000 ft" in row["error"] and pd.isna(row["id"])


def test_an_error_inside_a_flight_is_a_row_with_its_text():
    broken = load_scenario("cruise", ["duration_s=1"])
    object.__setattr__(broken.flight, "turbulence", "hurricane")
    frame = run_many([broken, *flights(1)], workers=0).frame
    assert list(frame.drop_duplicates("run")["status"]) == ["error", "completed"]
    assert "hurricane" in frame["error"][0]


def test_a_process_pool_gives_the_same_rows(flown, tmp_path):
    result = run_many([*flights(5), infeasible()], workers=2, out=tmp_path)
    pd.testing.assert_frame_equal(result.frame, flown[0].frame)


def test_any_executor_gives_the_same_rows(flown):
    with cf.ThreadPoolExecutor(3) as executor:
        result = run_many([*flights(5), infeasible()], executor=executor)
    pd.testing.assert_frame_equal(result.frame, flown[0].frame)


def test_resume_flies_only_what_is_missing_and_grows(flown, tmp_path):
    first = run_many(flights(2), workers=0, out=tmp_path)
    again = run_many([*flights(5), infeasible()], workers=0, out=tmp_path)
    assert (first.resumed, again.resumed, again.done) == (0, 2, 6)
    pd.testing.assert_frame_equal(again.frame, flown[0].frame)


def test_a_folder_with_rows_is_not_flown_over(flown):
    with pytest.raises(CampaignError, match="--resume"):
        run_many(flights(5), workers=0, out=flown[1], resume=False)


def test_rows_of_other_code_do_not_mix(tmp_path):
    run_many(flights(1), workers=0, out=tmp_path)
    about = tmp_path / "campaign.json"
    about.write_text(about.read_text().replace('"digest": "', '"digest": "x'))
    with pytest.raises(CampaignError, match="other code"):
        run_many(flights(2), workers=0, out=tmp_path)


@pytest.mark.parametrize("name", [*FILES, "parts/rows-mine.parquet"])
def test_a_folder_with_a_foreign_file_stays_as_it_is(name, tmp_path):
    held = {name: '{"name": "mine"}', ".env.template": "A=1", ".cosim-part-mine": "B=2"}
    for file, text in held.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    with pytest.raises(OutputError, match=f"holds a {name} that no campaign wrote"):
        run_many(flights(1), workers=0, out=tmp_path)
    assert {str(p.relative_to(tmp_path)): p.read_text() for p in tmp_path.rglob("*") if p.is_file()} == held


def test_a_folder_with_other_files_takes_a_campaign_and_keeps_them(tmp_path):
    names = [".env.template", ".env.defaults", ".app.settings.json", "notes.md"]
    for name in names:
        (tmp_path / name).write_text("mine")
    for again in (False, True):
        assert run_many(flights(1), workers=0, out=tmp_path, resume=again).done == 1
    assert [(tmp_path / name).read_text() for name in names] == ["mine"] * 4


SCRIPT = """
import sys
sys.path[:0] = [{root!r}, {helpers!r}]
from cosim.campaign import flights as many
from worker_calls import flights
if __name__ == "__main__":
    many.FLUSH_RUNS = 4
    many.run_many(flights(10), workers=2, out={out!r}, progress=lambda done, total: print(done, flush=True))
"""


def test_kill_9_and_resume_equals_an_uninterrupted_campaign(tmp_path, monkeypatch):
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(root=os.getcwd(), helpers=os.path.dirname(worker_calls.__file__), out=str(killed)))
    process = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, start_new_session=True)
    for line in process.stdout:  # some files of rows are there, some runs are in flight
        if int(line) >= 6:
            break
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    parts = list((killed / "parts").glob("rows-*.parquet"))
    safe = len(pd.concat(map(pd.read_parquet, parts))["run"].unique())
    assert 0 < safe < 10 and not (killed / "runs.parquet").exists()
    resumed = run_many(flights(10), workers=0, out=killed)
    assert resumed.resumed == safe
    pd.testing.assert_frame_equal(resumed.frame, run_many(flights(10), workers=0, out=whole).frame)
    assert (killed / "runs.parquet").read_bytes() == (whole / "runs.parquet").read_bytes()


def test_a_worker_that_dies_loses_no_run(monkeypatch):
    """The first process that flies the third run dies; the run is flown again elsewhere."""
    monkeypatch.setattr(campaign_pool, "fly", die_once)
    jobs = [(run, None) for run in ("a", "b", "deadly", *"efghi")]
    marker = f"/tmp/cosim-test-{os.getpid()}-{time.monotonic_ns()}"
    monkeypatch.setenv("COSIM_TEST_MARKER", marker)
    try:
        found = sorted(run for run, *_ in campaign_pool.outcomes(jobs, workers=2))
    finally:
        os.path.exists(marker) and os.unlink(marker)
    assert found == [run for run, _ in jobs]


def test_a_run_that_kills_every_worker_is_a_row_and_the_others_fly(monkeypatch):
    monkeypatch.setattr(campaign_pool, "fly", killed)
    jobs = [(run, None) for run in ("a", "b", "deadly")]
    found = {run: rows for run, rows, _ in campaign_pool.outcomes(jobs, workers=2)}
    assert len(found) == 3
    assert [run for run, rows in found.items() if rows[0]["status"] == "crashed"] == ["deadly"]


def test_ids_name_the_scenario_and_nothing_else():
    a, b = flights(2)
    assert run_id(a) == run_id(flights(1)[0]) != run_id(b)


def test_flatten_names_keys_as_the_scenario_file_does():
    assert flatten({"a": {"b": 1}, "faults": [{"kind": "x"}], "e": ["p", "q"], "none": []}) == {
        "a.b": 1,
        "faults.0.kind": "x",
        "e": "p,q",
    }



def test_load_reads_a_campaign_finished_or_not(tmp_path, flown):
    with pytest.raises(CampaignError, match="holds no whole run"):
        load(tmp_path)
    rows, timing = load(flown[1])
    assert len(rows) == 31 and {"wall_time_s", "step_us"} <= set(timing.columns)
    shutil.copytree(flown[1], tmp_path / "killed")
    (tmp_path / "killed" / "runs.parquet").unlink()
    pd.testing.assert_frame_equal(load(tmp_path / "killed")[0], rows, check_dtype=False)


def test_a_manifest_says_what_was_flown_with_what_and_what_it_took(flown):
    rows, timing = load(flown[1])
    told = json.loads((flown[1] / MANIFEST).read_text(encoding="utf-8"))
    assert (told["runs"], told["rows"]) == (rows["run"].nunique(), len(rows))
    assert told["seeds"] == [rows["seed"].min(), rows["seed"].max()] and told["digest"] == fingerprint()["digest"]
    assert told["sha256"]["runs.parquet"] == hashlib.sha256((flown[1] / "runs.parquet").read_bytes()).hexdigest()
    took = timing["core_s"].dropna()
    assert told["flights_per_core_s"] == pytest.approx(len(took) / took.sum()) and 0.01 < took.median() < 60.0


def test_rows_survive_being_there_twice(tmp_path):
    scenarios = pd.DataFrame({"run": ["a", "b"], "order": [0, 1]})
    store = Store(tmp_path, scenarios, ["", ""])
    store.add([failed("b", "infeasible", "x")], [])
    store.add([failed("a", "infeasible", "x"), failed("b", "infeasible", "x")], [])
    assert list(store.rows()["run"]) == ["a", "b"]
    assert store.consolidate(tmp_path) == {"a": "infeasible", "b": "infeasible"}
    assert len(list((tmp_path / "parts").glob("rows-*"))) == 1
    assert Store(tmp_path, scenarios, ["", ""]).finished == {"a", "b"}


def test_resuming_flies_runs_that_failed_again_and_keeps_the_flight(tmp_path):
    scenarios = pd.DataFrame({"run": ["a", "b", "c"], "order": [0, 1, 2]})
    store = Store(tmp_path, scenarios, [""] * 3)
    store.add([failed("a", "crashed", "x"), failed("b", "error", "y")], [])
    store.add([failed("c", "infeasible", "z")], [])
    again = Store(tmp_path, scenarios, [""] * 3)
    assert again.finished == {"c"}
    again.add([failed("a", "completed", "") | {"lane": i} for i in range(2)], [])
    assert list(zip(again.rows()["run"], again.rows()["status"])) == [
        ("a", "completed"), ("a", "completed"), ("b", "error"), ("c", "infeasible"),
    ]  # fmt: skip


@pytest.mark.slow
def test_two_workers_are_at_least_1_8_times_as_fast_as_one():
    """Measure on a quiet machine with two cores; the pools' start is paid before the clock runs."""
    scenarios = [load_scenario("cruise", ["duration_s=60", f"seed={1_000_000 + i}"]) for i in range(40)]
    took = {}
    for workers in (1, 2):
        with campaign_pool.pool(workers) as executor:
            run_many([load_scenario("cruise", ["duration_s=1", f"seed={i}"]) for i in range(8)], executor=executor)
            begin = time.perf_counter()
            run_many(scenarios, executor=executor, workers=workers)
            took[workers] = time.perf_counter() - begin
    assert took[1] / took[2] >= 1.8, took


def test_a_run_that_a_cluster_gives_up_is_tried_once_more_alone():
    class KilledWorker(Exception):
        """What Dask raises for a call whose workers died."""

    class Unlucky(cf.Executor):
        """Loses a call the first time, another one always."""

        def __init__(self):
            self.lost = []

        def submit(self, function, /, *arguments, **more):
            future: cf.Future = cf.Future()
            key = arguments[0]
            if key == "bad" or (key == "unlucky" and key not in self.lost):
                self.lost.append(key)
                future.set_exception(KilledWorker("its worker died"))
            else:
                future.set_result(function(*arguments))
            return future

    calls = [(key, str.upper, (key,)) for key in ("a", "unlucky", "bad", "b")]
    found = list(campaign_pool.finished(calls, executor=Unlucky(), crashed=lambda key, text: f"crashed: {text}"))
    told = {"a": "A", "b": "B", "unlucky": "UNLUCKY", "bad": "crashed: KilledWorker: its worker died"}
    assert len(found) == 4 and dict(found) == told
