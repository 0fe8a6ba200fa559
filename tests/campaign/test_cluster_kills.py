"""Many workers of a cluster, killed at random: the same rows, none lost or doubled, and progress to be believed."""

import json
import os
import random
import signal
import threading
import time
from pathlib import Path

import light_flight
import pandas as pd
import pytest

from cosim.campaign import manifest, pool, run_many
from cosim.campaign.run import cluster
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
    told = [json.loads((tmp_path / name / manifest.FILE).read_text()) for name in ("far", "here")]
    assert told[0]["sha256"] == told[1]["sha256"] and told[0]["runs"] == RUNS and told[0]["rows"] == 4 * RUNS
    half = RUNS // 2
    begin, middle, end = seen[0][0], seen[half][0], seen[-1][0]
    left = (middle - begin) / half * (RUNS - half)  # what a linear clock says at half time
    assert 0.4 < left / (end - middle) < 2.5, (left, end - middle)
