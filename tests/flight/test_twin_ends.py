"""The copy of a process that flies the twin ends with the process, however that ends."""

import os
import signal
import subprocess
import sys
import time

import pytest

FLY = """
import os, cosim
from cosim.flight.faults import fault_free_reference
fork = os.fork
def told():
    child = fork()
    if child:
        print(child, flush=True)
    return child
os.fork = told
keys = ["duration_s=36000", "faults.0.start_s=0.1", "detectors.enabled=[]", "elevator.feedback=measured"]
twin.achieved(cosim.load_scenario("liquid-ofc", keys))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only on Linux is a process copied")
def test_the_twin_of_a_killed_flight_ends(tmp_path):
    with subprocess.Popen([sys.executable, "-c", FLY], stdout=subprocess.PIPE, text=True) as flight:
        copy = int(flight.stdout.readline())
        time.sleep(0.2)
        os.kill(flight.pid, signal.SIGKILL)
    end = time.monotonic() + 10
    while os.path.exists(f"/proc/{copy}") and time.monotonic() < end:
        time.sleep(0.05)
    assert not os.path.exists(f"/proc/{copy}")
