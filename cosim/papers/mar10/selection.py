"""[Mar10] slides 13 to 15: do the residuals that a scenario's faults move react, and no others?

The slides show curves without numbers. What they claim follows from slide 10: a residual reacts to the faults that its
signature names and to no other, and after one fault those blind to it show the next. Nominal aircraft and sensors,
the families that this aircraft's structure allows.
"""

import functools
from typing import Any

import numpy as np

from cosim.flight.plant.force_model import force_model
from cosim.papers.mar10 import flights
from fdi.control_redundancy import structure as redundancy_structure

INPUTS = ("elevator", "aileron", "rudder", "engine")


@functools.cache
def nominal_flight(number: int) -> Any:
    """Return (flight, detector log, families) of a scenario with nominal aircraft and sensors."""
    flown = flights.fly(number)
    log = flights.detector_log(flown, flights.detector())
    return flown, log, redundancy_structure.families(force_model().structure()[:3])


def _unmoved(number):
    """Return (families that fire before any fault that moves them, their names), from the learned offset on."""
    flown, log, families = nominal_flight(number)
    wrong = []
    for j, family in enumerate(families):
        moved = [at for name, at in flights.TRUTH[number] if family.signature[INPUTS.index(name)]]
        quiet = (flown.index >= 20.0) & (flown.index < min(moved, default=np.inf))
        if (log["fired"][quiet, j] > 0.5).any():
            wrong.append(family.name)
    return len(wrong), ", ".join(wrong)


def _selected(number, k):
    """Return (families that fire for fault k, which moves them while the earlier ones do not; their names).

    Counted until a later fault moves them too.
    """
    flown, log, families = nominal_flight(number)
    truth = flights.TRUTH[number]
    found = []
    for j, family in enumerate(families):
        moved = [at for name, at in truth if family.signature[INPUTS.index(name)]]
        if not moved or moved[0] != truth[k][1]:
            continue
        on = (flown.index >= moved[0]) & (flown.index < (moved[1] if len(moved) > 1 else np.inf))
        if (log["fired"][on, j] > 0.5).any():
            found.append(family.name)
    return len(found), ", ".join(found)


def chosen(number: int) -> tuple[float, str]:
    """Return (faults of a scenario that no residual of their own shows, or that one shows too early; what fires)."""
    early, names = _unmoved(number)
    shown = [(name, *_selected(number, k)) for k, (name, _) in enumerate(flights.TRUTH[number])]
    words = "; ".join(f"{name}: {which or 'none'}" for name, _, which in shown)
    return early + sum(n == 0 for _, n, _ in shown), words + (f"; early: {names}" if names else "")
