"""The fault-free run: flown by a copy of the process from the first fault on it is the one flown whole."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import cosim
from cosim.flight.faults import fault_free_reference as reference

TWO = ["faults.1.target=elevator.right_inner", "faults.1.kind=jam", "faults.1.start_s=2", "flight.turbulence=light"]
SCENARIO = ["faults.0.start_s=1", "duration_s=4", *TWO]
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
fault_free_reference.achieved(cosim.load_scenario("liquid-ofc", keys))
"""
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only on Linux is a process copied")


def test_a_copy_of_the_process_flies_what_the_whole_run_does_and_one_that_dies_costs_only_time(monkeypatch):
    scenario, flown, positions = cosim.load_scenario("liquid-ofc", SCENARIO), [], []
    real = reference.onwards
    for copies, onwards in ((False, real), (True, real), (True, lambda *given: os._exit(3))):
        monkeypatch.setattr(reference, "_copies", lambda copies=copies: copies)
        monkeypatch.setattr(reference, "onwards", onwards)
        reference._positions.clear()
        flown.append(cosim.simulate(scenario, achieved=True, timed=False).extra["achieved"])
        positions.append(next(iter(reference._positions.values())))
    assert flown[0] == flown[1] == flown[2] and flown[0]["left_inner"]["rod_mm"] > 1.0
    np.testing.assert_array_equal(positions[0], positions[1])


def test_the_copy_of_a_killed_flight_ends():
    with subprocess.Popen([sys.executable, "-c", FLY], stdout=subprocess.PIPE, text=True) as flight:
        copy = int(flight.stdout.readline())
        time.sleep(0.2)
        os.kill(flight.pid, signal.SIGKILL)
    end = time.monotonic() + 10
    while os.path.exists(f"/proc/{copy}") and time.monotonic() < end:
        time.sleep(0.05)
    assert not os.path.exists(f"/proc/{copy}")
