"""kill -9 of a run at random moments: whole chunks come back, nothing hangs, the recovered log replays exactly."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from cosim.log import open_log, recover
from cosim.log.writer import ROWS
from cosim.replay import replay

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")
ENABLED = 'detectors.enabled=["iotsekf","ema_kalman_flight","position_monitor","rfafe"]'
CHUNK = ROWS  # ticks

# one interpreter loads everything once, and forks a flight for every line that it is sent
FLIGHTS = """
import os, sys
import cosim
scenario = cosim.load_scenario("liquid-ofc", ["duration_s=300", {enabled!r}])
cosim.simulate(cosim.load_scenario("liquid-ofc", ["duration_s=0.1", {enabled!r}]), timed=False)
for _ in sys.stdin:
    pid = os.fork()
    if not pid:
        cosim.simulate(scenario, log={path!r}, timed=False)
        os._exit(0)
    print(pid, flush=True)
    os.waitpid(pid, 0)
    print("dead", flush=True)
"""


def grown(path, size=1):
    """Wait until a file holds `size` bytes."""
    end = time.monotonic() + 60
    while not path.exists() or path.stat().st_size < size:
        assert time.monotonic() < end, "the run writes nothing"
        time.sleep(0.002)


def check(path, out):
    """Recover a killed log and check that whole chunks came back and replay exactly; return the ticks."""
    begun = time.monotonic()
    report = recover(path, out)
    assert report["parameters_intact"] and not report["complete"] and report["ticks"] == CHUNK * report["chunks"]
    log = open_log(out)
    assert log.n_ticks == report["ticks"] and not log.complete
    if log.n_ticks:
        r = replay(out)
        assert r.exact and r.skipped == 0 and r.rows == log.n_ticks * len(r.detectors), r.differences
    assert time.monotonic() - begun < 60
    return log.n_ticks


def test_twenty_killed_flights_come_back_and_replay_exactly(tmp_path):
    path, rng, lengths = tmp_path / "killed.mcap", np.random.default_rng(3), []
    code = FLIGHTS.format(path=str(path), enabled=ENABLED)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as parent:
        for _ in range(20):
            parent.stdin.write("go\n")
            parent.stdin.flush()
            pid = int(parent.stdout.readline())
            grown(path)
            time.sleep(float(rng.uniform(0.0, 0.3)))
            os.kill(pid, signal.SIGKILL)
            assert parent.stdout.readline() == "dead\n"
            lengths.append(check(path, tmp_path / "out.mcap"))
            path.unlink()
        parent.stdin.close()
    assert sum(n > 0 for n in lengths) >= 10, lengths


def test_a_killed_cosim_run_comes_back_and_replays_exactly(tmp_path):
    path = tmp_path / "killed.mcap"
    args = [
        sys.executable,
        "-m",
        "cosim.cli",
        "run",
        "liquid-ofc",
        "--set",
        "duration_s=300",
        "--set",
        ENABLED,
        "-o",
        str(path),
    ]
    with subprocess.Popen(args, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as run:
        grown(path, 1_000_000)
        run.kill()
    assert run.returncode == -signal.SIGKILL
    assert check(path, tmp_path / "out.mcap") > 0
