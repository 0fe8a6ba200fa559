"""Scenarios as tables at one flight point, for the tests of what is accepted and what is refused."""

from cosim.flight.plant.point import SIX
from cosim.scenario import parse

POINT = SIX["sun13"]
OFC = {"target": "elevator.left_inner", "kind": "ofc_liquid", "start_s": 12.0, "amplitude_mm": 5.0, "frequency_hz": 1.0}


def flight(*faults, **tables):
    """Return the scenario of these faults and tables at POINT, or raise its ScenarioError."""
    return parse({"flight": POINT, "faults": list(faults), **tables})


def fault(target, kind, **own):
    """Return a fault's table from 10 s on; `own` are the keys of its kind."""
    return {"target": target, "kind": kind, "start_s": 10.0, **own}
