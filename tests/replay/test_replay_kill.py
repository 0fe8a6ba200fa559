"""kill -9 of a run at random moments: whole chunks come back, nothing hangs, the recovered log replays exactly."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from killed import grown, killer
from typer.testing import CliRunner

import cosim
from cosim.cli.commands import app
from cosim.files import left_by
from cosim.log import open_log, recover
from cosim.log.writer import ROWS
from cosim.replay import replay

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")
ENABLED = 'detectors.enabled=["iotsekf","ema_kalman_flight","position_monitor","rfafe"]'
CHUNK = ROWS  # ticks
LOAD = f"""
import cosim
scenario = cosim.load_scenario("liquid-ofc", ["duration_s=300", {ENABLED!r}])
cosim.simulate(cosim.load_scenario("liquid-ofc", ["duration_s=0.1", {ENABLED!r}]), timed=False)
"""


def check(path, out):
    """Recover a killed log and check that whole chunks came back and replay exactly; return the ticks."""
    begun = time.monotonic()
    report = recover(path, out)
    assert not report["complete"] and report["ticks"] == CHUNK * report["chunks"]
    log = open_log(out)
    assert log.n_ticks == report["ticks"] and not log.complete
    if log.n_ticks:
        r = replay(out)
        assert r.exact and r.skipped == 0 and r.rows == log.n_ticks * len(r.detectors), r.differences
    assert time.monotonic() - begun < 60
    return log.n_ticks


@pytest.mark.parametrize("kills", [4, pytest.param(40, marks=pytest.mark.slow)])
def test_killed_flights_come_back_and_replay_exactly(kills, tmp_path):
    path, rng, lengths = tmp_path / "killed.mcap", np.random.default_rng(3), []

    def wait():
        # none before the file begins, every other one when some chunks are there, however slow it goes
        grown(left_by(path), 1_000_000 * (len(lengths) % 2) + 1)
        time.sleep(float(rng.uniform(0.0, 0.3)))

    with killer(LOAD, f"cosim.simulate(scenario, log={str(path)!r}, timed=False)") as kill:
        for _ in range(kills):
            kill(wait)
            lengths.append(check(left_by(path), tmp_path / "out.mcap"))
            left_by(path).unlink()
    assert sum(n > 0 for n in lengths) >= kills / 2, lengths


def test_a_killed_cosim_run_leaves_the_old_log_comes_back_and_replays_exactly(tmp_path):
    path = tmp_path / "killed.mcap"
    cosim.simulate(cosim.load_scenario("cruise", ["duration_s=0.2", ENABLED]), log=path, timed=False)
    old = path.read_bytes()
    options = ["liquid-ofc", "--set", "duration_s=300", "--set", ENABLED, "-o", str(path)]
    command = [sys.executable, "-m", "cosim", "run", *options]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as run:
        grown(left_by(path), 3_000_000)
        run.kill()
    assert run.returncode == -signal.SIGKILL and path.read_bytes() == old
    assert sorted(p.name for p in tmp_path.iterdir()) == ["killed.mcap", "killed.mcap.part"]
    assert check(left_by(path), tmp_path / "out.mcap") > 0
    again = CliRunner().invoke(app, ["run", *options])
    assert again.exit_code == 2 and f"{left_by(path)} is there" in again.stderr
    back = CliRunner().invoke(app, ["recover", str(path)])
    assert back.exit_code == 0 and open_log(tmp_path / "killed.recovered.mcap").n_ticks > 0
    assert path.read_bytes() == old
    left_by(path).unlink(missing_ok=True)  # it stays where the kill cut a chunk in two, and goes where it lost nothing
    gone = CliRunner().invoke(app, ["recover", str(left_by(path))])
    assert gone.exit_code == 2 and "No such file" in gone.stderr
