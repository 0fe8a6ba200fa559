"""Tests of NAME: the folder keeps the contract of an aircraft, and it flies. Run with pytest."""

from pathlib import Path

import cosim
from cosim.flight.check import check
from cosim.scenario import parse
from cosim.scenario.aircraft import load_aircraft

FOLDER = Path(__file__).with_name("NAME")


def test_it_keeps_the_contract() -> None:
    """`cosim check NAME` says the same."""
    assert [line for line in check(FOLDER)["checks"] if line["result"] == "bad"] == []


def test_it_flies() -> None:
    """Two seconds at each of its points."""
    for point in load_aircraft(str(FOLDER)).points.values():
        flight = {"aircraft": str(FOLDER), **point}
        scenario = parse({"duration_s": 2.0, "flight": flight, "detectors": {"enabled": []}})
        assert cosim.simulate(scenario).status == "completed"
