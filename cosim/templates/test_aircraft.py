"""Tests of NAME: the folder keeps the contract of an aircraft, and it flies. Run with pytest."""

from pathlib import Path

import cosim
from cosim.flight.plant.check import check

FOLDER = Path(__file__).with_name("NAME")


def test_it_keeps_the_contract() -> None:
    """`cosim check NAME` says the same."""
    assert [finding for finding in check(str(FOLDER)) if not finding.good] == []


def test_it_flies() -> None:
    """Two seconds of cruise."""
    only = ["duration_s=2", "detectors.enabled=[]", "elevator.feedback=measured", f"flight.aircraft={FOLDER}"]
    assert cosim.simulate(cosim.load_scenario("cruise", only)).status == "completed"
