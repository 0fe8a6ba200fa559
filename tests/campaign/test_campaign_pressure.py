"""A large campaign under pressure: memory and processor taken by others, workers killed at random. No silent end.

COSIM_RUNS flights (`pytest -m slow -s tests/campaign/test_campaign_pressure.py`).
"""

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from cosim.campaign.flights import run_many
from cosim.scenario import load_scenario

RUNS = int(os.environ.get("COSIM_RUNS", "2000"))
KILL_S = float(os.environ.get("COSIM_KILL_S", "15"))  # mean time between two kills
SHORT = ("duration_s=0.2", "detectors.enabled=['position_monitor']", "elevator.feedback=measured")
PRESSURE = """
import time
while True:
    held = [bytearray(b"x") * (1 << 28) for _ in range(6)]
    time.sleep(0.5)
    del held
"""


def _workers():
    """Return the processes that any thread of this one has started."""
    told = [path.read_text() for path in Path("/proc/self/task").glob("*/children")]
    return [int(pid) for text in told for pid in text.split()]


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="finds workers in /proc")
def test_two_thousand_flights_under_pressure(tmp_path):
    scenarios = [load_scenario("cruise", [*SHORT, f"seed={2_000_000 + i}"]) for i in range(RUNS)]
    over, killed, told = threading.Event(), [], []
    rng = random.Random(4)
    with subprocess.Popen([sys.executable, "-c", PRESSURE]) as pressure:

        def kill():
            while not over.wait(rng.expovariate(1.0 / KILL_S)):
                found = [pid for pid in _workers() if pid != pressure.pid]
                with contextlib.suppress(ProcessLookupError, IndexError):  # none at the moment
                    os.kill(rng.choice(found), signal.SIGKILL)
                    killed.append(time.monotonic())

        threading.Thread(target=kill, daemon=True).start()
        try:
            done = run_many(scenarios, workers=2, out=tmp_path, progress=lambda n, total: told.append(n))
        finally:
            over.set()
            pressure.kill()
    status = done.frame.drop_duplicates("run")["status"].value_counts().to_dict()
    print(f"\n{done.done} of {RUNS} flights have rows, {status}; {len(killed)} processes killed")
    assert done.done == RUNS == told[-1] and set(status) <= {"completed", "crashed"}
    again = run_many(scenarios, workers=2, out=tmp_path)
    assert again.resumed == status["completed"] and again.failed == 0 and again.done == RUNS
