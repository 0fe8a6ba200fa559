"""The fault-free run: flown by a copy of the process from the first fault on it is the one flown whole."""

import os

import numpy as np
import pytest

import cosim
from cosim.flight.faults import fault_free_reference

TWO = ["faults.1.target=elevator.right_inner", "faults.1.kind=jam", "faults.1.start_s=2", "flight.turbulence=light"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that copies processes")
def test_a_copy_of_the_process_flies_what_the_whole_run_does(monkeypatch):
    scenario = cosim.load_scenario("liquid-ofc", ["faults.0.start_s=1", "duration_s=4", *TWO])
    flown, positions = [], []
    for copies in (True, False):
        monkeypatch.setattr(fault_free_reference, "_copies", lambda copies=copies: copies)
        fault_free_reference._positions.clear()
        flown.append(cosim.simulate(scenario, achieved=True, timed=False).extra["achieved"])
        kept = next(iter(fault_free_reference._positions.values()))
        positions.append(kept)
    assert flown[0] == flown[1] and flown[0]["left_inner"]["rod_mm"] > 1.0
    np.testing.assert_array_equal(*positions)


def test_a_copy_that_dies_costs_only_time(monkeypatch):
    scenario = cosim.load_scenario("liquid-ofc", ["faults.0.start_s=1", "duration_s=3"])
    expected = fault_free_reference.achieved(scenario)
    fault_free_reference._positions.clear()
    monkeypatch.setattr(fault_free_reference, "_copies", lambda: hasattr(os, "fork"))
    monkeypatch.setattr(fault_free_reference, "_quietly", lambda *given: os._exit(3))
    assert fault_free_reference.achieved(scenario) == expected
