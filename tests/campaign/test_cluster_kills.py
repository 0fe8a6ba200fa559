"""Many workers of a cluster, killed at random: the same rows, none lost or doubled, and progress to be believed."""

import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import light_flight
import pandas as pd
import pyarrow.parquet as pq
import pytest

from cosim.campaign import pool
from cosim.campaign.flights import run_many
from cosim.campaign.run import cluster, run_campaign
from cosim.campaign.store import MANIFEST
from cosim.scenario import load_scenario

WORKERS, RUNS, KILLS = 16, 320, 12
HELPERS = str(Path(light_flight.__file__).parent)


@pytest.mark.slow
def test_sixteen_workers_killed_at_random_give_the_rows_of_one_process(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(pool, "fly", light_flight.fly)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([HELPERS, str(Path(HELPERS).parents[1])]))
    base = load_scenario("cruise", ["duration_s=2", "detectors.enabled=[]"])
    scenarios = [base.model_copy(update={"seed": 1_000_000 + i}) for i in range(RUNS)]
    rng, killed, seen, stop = random.Random(1), [], [], threading.Event()

    def kill(workers):
        while len(killed) < KILLS and not stop.wait(0.02):
            alive = [n.pid for n in workers() if n.pid]
            if alive and len(seen) > RUNS * (len(killed) + rng.random()) / (KILLS + 1):  # from begin to end
                killed.append(rng.choice(alive))
                try:
                    os.kill(killed[-1], signal.SIGKILL)
                except ProcessLookupError:
                    killed.pop()

    def progress(done, total):
        seen.append((time.monotonic(), done, total))

    with distributed.LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
    ) as made:
        killer = threading.Thread(target=kill, args=(lambda: list(made.workers.values()),), daemon=True)
        with cluster(made.scheduler_address) as (executor, threads):
            assert threads == WORKERS
            for future in [executor.submit(light_flight.ready, i) for i in range(4 * WORKERS)]:
                future.result()  # everything is imported
            killer.start()
            found = run_many(scenarios, executor=executor, workers=threads, out=tmp_path / "far", progress=progress)
        stop.set()
        killer.join()
    assert len(killed) == KILLS
    monkeypatch.setattr(light_flight, "PAUSE_S", 0.0)
    here = run_many(scenarios, workers=0, out=tmp_path / "here")
    pd.testing.assert_frame_equal(found.frame, here.frame)
    assert not found.frame.duplicated(["run", "lane"]).any() and found.failed == 0
    done = [d for _, d, _ in seen]
    assert done == list(range(1, RUNS + 1)), "progress counts every run once"
    told = [json.loads((tmp_path / name / MANIFEST).read_text()) for name in ("far", "here")]
    assert told[0]["sha256"] == told[1]["sha256"] and told[0]["runs"] == RUNS and told[0]["rows"] == 4 * RUNS
    half = RUNS // 2
    begin, middle, end = seen[0][0], seen[half][0], seen[-1][0]
    left = (middle - begin) / half * (RUNS - half)  # what a linear clock says at half time
    assert 0.4 < left / (end - middle) < 2.5, (left, end - middle)


FILE = """
base = "cruise"
runs = {}
seed = 5
[set]
duration_s = 0.3
"detectors.enabled" = ["position_monitor"]
"elevator.feedback" = "measured"
[draw]
"flight.mass_t" = {{ low = 210.0, high = 230.0 }}
"""
MANY = int(os.environ.get("COSIM_RUNS", "150"))
CLUSTER = 4  # workers, each a process with a thread


def _cluster(part, *args):
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    code = f"from distributed.cli.dask_{part} import main; main()"
    return subprocess.Popen([sys.executable, "-W", "ignore", "-c", code, *args], **quiet)


def _busy(pid):
    """Return (seconds of the processor, largest memory [MB]) of a process."""
    told, status = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split(), Path(f"/proc/{pid}/status")
    peak = int(status.read_text().split("VmHWM:")[1].split()[0]) / 1e3
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK"), peak


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_real_flights_survive_kills_new_workers_and_a_new_scheduler(tmp_path):
    """COSIM_RUNS flights (150): `COSIM_RUNS=3000 pytest -m slow -s tests/campaign/test_cluster_kills.py -k real`."""
    pytest.importorskip("distributed")
    (tmp_path / "many.toml").write_text(FILE.format(MANY))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address, rng, told = f"tcp://127.0.0.1:{port}", random.Random(2), []
    scheduler = _cluster("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    join = lambda: _cluster("worker", address, "--nthreads", "1", "--memory-limit", "0", "--no-dashboard")  # noqa: E731
    workers, out = [join() for _ in range(CLUSTER)], tmp_path / "far"
    campaign = [sys.executable, "-m", "cosim", "campaign", str(tmp_path / "many.toml"), "--scheduler", address]
    campaign += ["-o", str(out)]
    begun, clients, peak, restarted = time.monotonic(), [], 0.0, False

    def there():
        parts = list((out / "parts").glob("rows-*.parquet"))
        return sum(pq.read_metadata(p).num_rows for p in parts)

    per_run = 4  # lanes of the detector
    try:
        while True:
            words = campaign + (["--resume"] if clients else [])
            clients.append(subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
            next_s = time.monotonic() + 10
            while clients[-1].poll() is None:
                time.sleep(0.5)
                with contextlib.suppress(OSError, IndexError):
                    peak = max(peak, _busy(clients[-1].pid)[1])
                if time.monotonic() < next_s:
                    continue
                next_s, done = time.monotonic() + rng.expovariate(1 / 12), there() // per_run
                if not restarted and done > MANY / 2:
                    restarted = True
                    scheduler.kill()
                    scheduler.wait()
                    scheduler = _cluster("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
                    told.append(f"{time.monotonic() - begun:.0f} s: another scheduler, {done} flights done")
                elif rng.random() < 0.5 or len(workers) < 2:
                    workers.append(join())
                    told.append(f"{time.monotonic() - begun:.0f} s: worker added, {done} flights done")
                elif done:
                    lost = workers.pop(rng.randrange(len(workers)))
                    lost.kill()
                    lost.wait()
                    told.append(f"{time.monotonic() - begun:.0f} s: worker killed, {done} flights done")
            said = clients[-1].communicate()
            ended = f"the command ended with {clients[-1].returncode}: {said[1][-200:]}"
            told.append(f"{time.monotonic() - begun:.0f} s: {ended}")
            assert "Traceback" not in said[1], said[1]
            if clients[-1].returncode == 0 or len(clients) > 5:
                break
            workers = [w for w in workers if w.poll() is None]
            workers += [join() for _ in range(CLUSTER - len(workers))]
    finally:
        for process in (*workers, scheduler, *clients):
            process.kill()
    print("\n" + "\n".join(told) + f"\nclient: {peak:.0f} MB at most")
    assert clients[-1].returncode == 0
    begun = time.process_time()
    here = run_campaign(tmp_path / "many.toml", out=tmp_path / "here", workers=0)
    print(f"alone: {MANY / (time.process_time() - begun):.1f} flights per second of one core, rows and all")
    frames = [pq.read_table(tmp_path / name / "runs.parquet").to_pandas() for name in ("far", "here")]
    pd.testing.assert_frame_equal(*frames)
    assert frames[0]["run"].nunique() == MANY == here.done and not frames[0].duplicated(["run", "lane"]).any()
    sums = [json.loads((tmp_path / name / MANIFEST).read_text())["sha256"] for name in ("far", "here")]
    assert sums[0] == sums[1]
