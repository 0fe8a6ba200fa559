"""What is estimated is taken off again: an oscillation at the valve, three faults of what the law flies on."""

import numpy as np
import pytest

import cosim
from cosim.scenario import load_scenario

ROD, H = "hydraulic.left_inner.q_rod", "truth.aircraft.h"


def swing(*changes):
    """Return the range of the left inner rod over the last two seconds less that of the same flight without a fault."""
    short = ["duration_s=18", "flight.turbulence=none", *changes]
    faulty, twin = (cosim.fly(load_scenario("lu17-compensated-ofc", c), [ROD]) for c in (short, [*short, "faults=[]"]))
    return float(np.ptp((faulty[ROD] - twin[ROD]).to_numpy()[-400:]))


def test_an_oscillation_is_taken_off_the_valve_and_nothing_without_one():
    assert swing() < 0.2 * swing("elevator.compensate=false")
    names = ["elevator.compensate=false", "elevator.compensate=true"]
    flights = [cosim.fly(load_scenario("lu17-fault-free", ["duration_s=4", n]), [ROD])[ROD] for n in names]
    assert np.array_equal(*flights)


@pytest.mark.parametrize(("word", "low", "high"), [("true", 0.0, 60.0), ("false", 150.0, 600.0)])
def test_the_law_keeps_its_altitude_on_reconstructed_sensors(word, low, high):
    changes = ["duration_s=20", f"sensors.reconstructed={word}"]
    h = cosim.fly(load_scenario("alwi14-reconstructed", changes), [H])[H].to_numpy()
    assert low <= np.abs(h - h[0]).max() <= high


@pytest.mark.parametrize(("word", "low", "high"), [("true", 0.0, 40.0), ("false", 150.0, 900.0)])
def test_stabiliser_and_throttles_fly_on_when_elevators_and_an_engine_are_gone(word, low, high):
    """Once the engine fails, another mass and speed than the scenario's: the altitude that the law holds is held."""
    changes = ["flight.mass_t=240", "flight.cas_kt=270", "faults.1.start_s=45", "duration_s=90"]
    names = [H, "law.law.h_ref"]
    flown = cosim.fly(load_scenario("mar10-reconfigured", [*changes, f"law.reallocate={word}"]), names)
    assert low <= (flown[H] - flown[names[1]])[flown.index >= 45].abs().max() <= high


def test_nothing_is_moved_while_nothing_is_declared():
    names = ["law.law.stab_cmd", "law.law.throttle_cmd", H]
    words = ["law.reallocate=false", "law.reallocate=true"]
    short = ["duration_s=12", "faults=[]", 'detectors.enabled=["control_redundancy"]']
    flights = [cosim.fly(load_scenario("mar10-reconfigured", [*short, w]), names) for w in words]
    assert np.array_equal(*flights)
