"""Campaigns: a row per run and lane, nothing lost or flown twice, whoever flies them, whatever is killed."""

import concurrent.futures as cf
import hashlib
import os
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest
import worker_calls
from worker_calls import flights

from cosim.campaign import engine, store, worker
from cosim.campaign.engine import run_many
from cosim.campaign.store import flatten, load
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
    assert mine["isolated_class"].isin(["ambiguous", "ofc_liquid"]).all()  # large at 3 Hz
    assert (mine["r_max_before"] < 1).all() and (mine["r_max_after"] > 1).all()
    assert mine["amplitude_mm"].between(7, 10).all()  # 8 mm by the linear loop
    assert list(mine["seed"]) == [1_000_000 + i for i in range(5)]
    row = result.frame.iloc[-1]
    assert row["status"] == "infeasible" and "44,000 ft" in row["error"] and pd.isna(row["id"])
    assert worker.run_id(flights(1)[0]) == result.frame["run"][0] != result.frame["run"].iloc[6]
    nested = {"a": {"b": 1}, "faults": [{"kind": "x"}], "e": ["p", "q"], "none": []}
    assert flatten(nested) == {"a.b": 1, "faults.0.kind": "x", "e": "p,q"}


def test_any_executor_gives_the_same_rows(flown, tmp_path):
    processes = run_many([*flights(5), infeasible()], workers=2, out=tmp_path)
    pd.testing.assert_frame_equal(processes.frame, flown[0].frame)
    with cf.ThreadPoolExecutor(3) as executor:
        threads = run_many([*flights(5), infeasible()], executor=executor)
    pd.testing.assert_frame_equal(threads.frame, flown[0].frame)


def test_resume_flies_only_what_is_missing_and_never_leaves_a_row_out(flown, tmp_path):
    first = run_many(flights(2), workers=0, out=tmp_path)
    again = run_many([*flights(5), infeasible()], workers=0, out=tmp_path)
    assert (first.resumed, again.resumed, again.done) == (0, 2, 6)
    pd.testing.assert_frame_equal(again.frame, flown[0].frame)
    with pytest.raises(CampaignError, match=r"an earlier version of it: run 0 had another .* faults\.0\.kind,"):
        run_many([load_scenario("rod-drift")], workers=0, out=tmp_path)
    with pytest.raises(CampaignError, match="--resume"):
        run_many([*flights(5), infeasible()], workers=0, out=tmp_path, resume=False)


def test_rows_of_other_code_do_not_mix(tmp_path):
    run_many(flights(1), workers=0, out=tmp_path)
    about = tmp_path / "campaign.json"
    about.write_text(about.read_text().replace('"digest": "', '"digest": "x'))
    with pytest.raises(CampaignError, match="other code"):
        run_many(flights(2), workers=0, out=tmp_path)


@pytest.mark.parametrize("name", ["campaign.json", "runs.parquet", "parts/mine.parquet"])
def test_a_folder_with_a_foreign_file_stays_as_it_is(name, tmp_path):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text('{"name": "mine"}')
    with pytest.raises(OutputError, match="that no campaign wrote"):
        run_many(flights(1), workers=0, out=tmp_path)
    assert [p.read_text() for p in tmp_path.rglob("*") if p.is_file()] == ['{"name": "mine"}']


def test_two_campaigns_at_once_on_a_folder_leave_the_rows_of_one(tmp_path):
    second = []

    def meanwhile(done, total):
        second.append(run_many(flights(1), workers=0, out=tmp_path))

    first = run_many(flights(1), workers=0, out=tmp_path, progress=meanwhile)
    assert first.frame.equals(second[0].frame) and len(load(tmp_path)[0]) == len(first.frame)


def test_a_damaged_file_is_named_and_its_runs_fly_again(tmp_path):
    run_many(flights(2), workers=0, out=tmp_path)
    path = tmp_path / "runs.parquet"
    path.write_bytes(path.read_bytes()[:500])
    for reads in (lambda: load(tmp_path), lambda: run_many(flights(2), workers=0, out=tmp_path)):
        with pytest.raises(CampaignError, match=r"runs\.parquet: is damaged: .* Remove it"):
            reads()
    path.unlink()
    assert run_many(flights(2), workers=0, out=tmp_path).resumed == 0


SCRIPT = """
import sys
sys.path[:0] = [{root!r}, {helpers!r}]
from cosim.campaign import engine, store
from worker_calls import flights
def main():
    store.FLUSH_RUNS = 4
    engine.run_many(flights(10), workers=2, out={out!r}, progress=lambda done, total: print(done, flush=True))
"""
GUARD = 'if __name__ == "__main__":\n    main()\n'


def _script(path, end, out):
    path.write_text(SCRIPT.format(root=os.getcwd(), helpers=os.path.dirname(worker_calls.__file__), out=str(out)) + end)
    return [sys.executable, path]


def test_kill_9_and_resume_equals_an_uninterrupted_campaign(tmp_path):
    killed, whole = tmp_path / "killed", tmp_path / "whole"
    command = _script(tmp_path / "script.py", GUARD, killed)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    for line in process.stdout:  # some files of rows are there, some runs are in flight
        if int(line) >= 6:
            break
    process.kill()
    process.wait()
    safe = load(killed)[0]["run"].nunique()
    assert 0 < safe < 10 and not (killed / "runs.parquet").exists()
    resumed = run_many(flights(10), workers=0, out=killed)
    assert resumed.resumed == safe
    pd.testing.assert_frame_equal(resumed.frame, run_many(flights(10), workers=0, out=whole).frame)
    assert (killed / "runs.parquet").read_bytes() == (whole / "runs.parquet").read_bytes()
    assert not list((killed / "parts").iterdir())


def test_a_script_without_a_guard_is_one_line_before_anything_is_written(tmp_path):
    command = _script(tmp_path / "script.py", "main()\n", tmp_path / "out")
    told = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert told.returncode == 1 and not (tmp_path / "out").exists()
    assert "script.py: flies a campaign at its top level" in told.stderr.splitlines()[-1], told.stderr
    assert "__name__" in told.stderr.splitlines()[-1]


class KilledWorker(Exception):
    """What Dask raises for a call whose workers died."""


class Unlucky(cf.Executor):
    """Loses a call that has an unlucky run the first time, one with a deadly run always."""

    def submit(self, function, /, *arguments, **more):
        future: cf.Future = cf.Future()
        try:
            future.set_result(function(*arguments, kill=self.dies))
        except KilledWorker as error:
            future.set_exception(error)
        return future

    def dies(self, pid, with_signal):
        raise KilledWorker("its worker died")


@pytest.mark.parametrize("bad, status", [("deadly", "crashed"), ("unlucky", "completed")])
@pytest.mark.parametrize("executor", [None, Unlucky()], ids=["processes", "cluster"])
def test_a_run_that_kills_its_process_is_a_row_and_the_others_fly(executor, bad, status, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "fly_packed", worker_calls.die)
    monkeypatch.setattr("cosim.flight.loop.compiling.prepare", lambda scenario: None)
    monkeypatch.setattr(worker.Packed, "__getitem__", lambda self, i: None)
    runs, packed = ["a", bad, *"bcdefghijklmnopqrs"], worker.Packed()
    packed.seeds, packed.packed = [i // 3 for i in range(len(runs))], [str(tmp_path / run) for run in runs]
    found = [(f.run, f.rows[0]["status"]) for f in engine._flights(runs, packed, (), None, 2, executor, None)]
    assert len(found) == len(runs) and dict(found) == {run: "completed" for run in runs} | {bad: status}


PARENT = """
import time
from cosim.campaign.pool import pool
if __name__ == "__main__":
    with pool(2) as workers:
        held = [workers.submit(time.sleep, 600) for _ in range(2)]
        while len(workers._processes) < 2:
            time.sleep(0.01)
        print(*workers._processes, flush=True)
        time.sleep(600)
"""


def _alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc; elsewhere by the same code, not shown")
def test_workers_of_a_killed_campaign_end_at_once(tmp_path):
    (tmp_path / "parent.py").write_text(PARENT)
    with subprocess.Popen([sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        time.sleep(2.0)  # until they have begun to work
        assert len(workers) == 2 and all(map(_alive, workers))
        os.kill(parent.pid, signal.SIGKILL)
    end = time.monotonic() + 20
    while any(map(_alive, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(map(_alive, workers))


def test_a_folder_says_what_was_flown_with_what_and_what_it_took(flown, tmp_path):
    rows, timing, tomls, told = load(flown[1])
    pd.testing.assert_frame_equal(rows, flown[0].frame, check_dtype=False)
    assert (told["runs"], told["rows"]) == (rows["run"].nunique(), len(rows)) == (len(tomls), 31)
    assert told["seeds"] == [rows["seed"].min(), rows["seed"].max()]
    assert told["digest"] == store.fingerprint()["digest"]
    assert told["sha256"]["runs.parquet"] == hashlib.sha256((flown[1] / "runs.parquet").read_bytes()).hexdigest()
    took = timing["core_s"].dropna()
    assert told["flights_per_core_s"] == pytest.approx(len(took) / took.sum()) and 0.01 < took.median() < 60.0
    with pytest.raises(CampaignError, match="holds no finished run"):
        load(tmp_path)


def test_a_run_that_was_flown_again_counts_once():
    rows = [("a", 0, "crashed"), ("b", 0, "error"), ("c", 0, "infeasible"), *[("a", i, "completed") for i in (0, 1, 1)]]
    found = pd.DataFrame(rows, columns=["run", "lane", "status"]).assign(fault=None)
    told = store.joined(pd.DataFrame({"run": ["a", "b", "c"], "order": [0, 1, 2]}), found)
    assert list(told["run"] + told["status"]) == ["acompleted", "acompleted", "berror", "cinfeasible"]
