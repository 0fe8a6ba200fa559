"""The command line and its surroundings: few letters, signals."""

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

COSIM = [sys.executable, "-m", "cosim"]


def test_few_letters_are_no_error():
    poor = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    told = subprocess.run([*COSIM, "list", "detectors"], env=poor, capture_output=True)
    assert told.returncode == 0 and b"Traceback" not in told.stderr, told.stderr.decode()


@pytest.mark.skipif(os.name == "nt", reason="a shell that closes streams")
def test_closed_streams_are_no_error():
    told = subprocess.run(f'"{sys.executable}" -m cosim list classes >&- 2>&-', shell=True)
    assert told.returncode == 0


def ended(command, number, ready, **how):
    """Send a signal to a command when it is `ready(process)`; return what that said, and the command."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **how) as flight:
        deadline = time.monotonic() + 120
        while not (found := ready(flight)) and time.monotonic() < deadline:
            time.sleep(0.05)
        flight.send_signal(number)
        said = flight.stdout.read().decode()
        assert flight.wait() == 130 and "interrupted" in said and "Traceback" not in said, said
    return found


def test_a_signal_while_kernels_are_compiled_ends_the_command_and_its_compilers(tmp_path):
    if not Path("/proc/self/task").exists():
        pytest.skip("needs the list of a process's children")

    def compilers(flight):
        return [n for p in Path(f"/proc/{flight.pid}/task").glob("*/children") for n in p.read_text().split()]

    words = ["run", "cruise", "-s", "duration_s=0.2", "-s", "detectors.enabled=[]", "-o", str(tmp_path / "a.mcap")]
    found = ended([*COSIM, *words], signal.SIGTERM, compilers, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)})
    left = [Path(f"/proc/{pid}/status").read_text() for pid in found if Path(f"/proc/{pid}").exists()]
    assert found and all("Z (zombie)" in status for status in left), left  # ended, if not yet taken note of


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_flight_whose_log_can_be_read(number, tmp_path):
    log = tmp_path / "x.mcap"
    part, words = left_by(log), ["run", "cruise", "-s", "duration_s=3000", "-o", log]
    ended([*COSIM, *words], number, lambda _: part.exists() and part.stat().st_size > 4_000_000,
          preexec_fn=heeds_ctrl_c)  # fmt: skip
    found = cosim.open_log(log)
    assert found.n_ticks > 100 and found.result["status"] == "interrupted"
