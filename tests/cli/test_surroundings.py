"""The command line and its surroundings: signals, names that others gave, files that are none."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from killed import heeds_ctrl_c

import cosim
from cosim.files import left_by

COSIM = [sys.executable, "-m", "cosim.cli"]
SHORT = ["run", "cruise", "-s", "duration_s=0.2", "-s", "detectors.enabled=[]", "-s", "elevator.feedback=measured"]


def test_few_letters_and_closed_outputs_are_no_error():
    poor = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    told = subprocess.run([*COSIM, "list", "detectors"], env=poor, capture_output=True)
    assert told.returncode == 0 and b"Traceback" not in told.stderr, told.stderr.decode()
    assert subprocess.run(["sh", "-c", f"{' '.join(COSIM)} list >&- 2>&-"]).returncode == 0


def test_what_lies_in_the_current_folder_is_not_taken_for_a_library(tmp_path):
    for name in ("numpy", "tomllib", "rich", "json", "jsbsim", "pydantic"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not asked for')")
    there = os.environ | {"PYTHONPATH": str(Path(cosim.__file__).parents[1])}
    command = [sys.executable, "-m", "cosim", *SHORT, "-o", "a.mcap"]
    told = subprocess.run(command, env=there, cwd=tmp_path, capture_output=True)
    assert told.returncode == 0, told.stderr.decode()


def test_a_signal_while_kernels_are_compiled_ends_the_command_and_its_compilers(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [*COSIM, *SHORT, "-o", str(tmp_path / "a.mcap")]
    with subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as flight:
        children = Path(f"/proc/{flight.pid}/task/{flight.pid}/children")
        if not children.exists():
            pytest.skip("needs the list of a process's children")
        deadline = time.monotonic() + 60
        while not (compilers := _started_by(flight.pid)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert compilers
        flight.send_signal(signal.SIGTERM)
        said = flight.stderr.read().decode()
        assert (flight.wait(), "Traceback" in said, "interrupted" in said) == (130, False, True), said
    left = [Path(f"/proc/{pid}/status").read_text() for pid in compilers if Path(f"/proc/{pid}").exists()]
    assert all("Z (zombie)" in status for status in left), left  # ended, if not yet taken note of


def _started_by(pid):
    """Return the processes that the threads of a process have started."""
    return [int(n) for p in Path(f"/proc/{pid}/task").glob("*/children") for n in p.read_text().split()]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_flight_whose_log_can_be_read(number, tmp_path):
    log = tmp_path / "x.mcap"
    command = [*COSIM, "run", "cruise", "-s", "duration_s=3000", "-o", log]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, preexec_fn=heeds_ctrl_c, **pipes) as flight:
        deadline = time.monotonic() + 120
        while not (left_by(log).exists() and left_by(log).stat().st_size > 4_000_000) and time.monotonic() < deadline:
            time.sleep(0.05)
        flight.send_signal(number)
        said = flight.stdout.read().decode()
        assert flight.wait() == 130 and "interrupted" in said
    found = cosim.open_log(log)
    assert found.n_ticks > 100 and found.result["status"] == "interrupted"


IN_TURN = """
import json, sys
from typer.testing import CliRunner
from cosim.cli.commands import app
for args in json.loads(sys.argv[1]):
    done = CliRunner().invoke(app, args)
    print(json.dumps([done.exit_code, done.stderr]), flush=True)
"""


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    fifo = tmp_path / "fifo.toml"
    os.mkfifo(fifo)
    mapped, recovered = ["replay", fifo, "--map", fifo], ["recover", fifo, "-o", tmp_path / "r.mcap"]
    commands = [["run", fifo], ["campaign", fifo], ["info", fifo], ["report", fifo], mapped, recovered,
                ["replay", fifo], ["info", "/dev/zero"]]  # fmt: skip
    given = json.dumps([[str(word) for word in args] for args in commands])
    told = subprocess.run([sys.executable, "-c", IN_TURN, given], capture_output=True, timeout=120)
    ended = [json.loads(line) for line in told.stdout.splitlines()]
    assert len(ended) == len(commands), told.stderr.decode()
    for args, (status, said) in zip(commands, ended):
        assert status == 2 and said.count("\n") == 1, (args, said)
