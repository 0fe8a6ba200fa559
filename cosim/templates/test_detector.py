"""Tests of NAME: it keeps the contract, and it names the fault that it was made for. Run with pytest."""

from pathlib import Path

import cosim
from cosim.flight.check import check
from cosim.parts import with_detectors

FILE = Path(__file__).with_name("NAME.py")


def test_it_keeps_the_contract() -> None:
    """`cosim check NAME.py` says the same."""
    found = check(FILE)
    assert found["keeps"], [line for line in found["checks"] if line["result"] == "bad"]


def test_it_names_a_rod_sensor_that_is_off_by_12_mm() -> None:
    """The fault of the scenario begins after 4 s."""
    fault = "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=4, path='monitor'}"
    only = ["duration_s=8", "detectors.enabled=[]", "elevator.feedback=measured"]
    scenario = cosim.load_scenario("cruise", [*only, fault])
    result = cosim.simulate(with_detectors(scenario, [FILE])).to_dict()
    lanes = {lane["target"]: lane for lane in result["detectors"]}
    assert lanes["elevator.left_inner"]["isolated"] == {"class": "sensor", "target": "elevator.left_inner.rod"}
    assert not any(lane["false_alarms"] for lane in lanes.values())
