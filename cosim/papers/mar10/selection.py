"""[Mar10] slides 13 to 15: do the residuals that a scenario's faults move react, and no others?

The slides show curves without numbers. What they claim follows from slide 10: a residual reacts to the faults that its
signature names and to no other, and after one fault those blind to it show the next. Nominal aircraft and sensors,
the families that this aircraft's structure allows.
"""

import functools

import numpy as np

from cosim.flight.plant.force_model import force_model
from cosim.papers.mar10 import flights
from cosim.papers.row import Planned
from fdi.control_redundancy import structure as redundancy_structure

INPUTS = ("elevator", "aileron", "rudder", "engine")


@functools.cache
def run(number):
    """Return (flight, detector log, families) of a scenario with nominal aircraft and sensors."""
    flown = flights.fly(number)
    log = flights.run(flown, flights.detector())
    return flown, log, redundancy_structure.families(force_model().structure()[:3])


def _unmoved(number):
    """Return (families that fire before any fault that moves them, their names), from the learned offset on."""
    flown, log, families = run(number)
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
    flown, log, families = run(number)
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


def plan():
    """Return the Planned rows."""
    out = []
    for number, truth in flights.TRUTH.items():
        where = f"slide {12 + number}, scenario {number}"
        out.append(
            Planned(
                "mar10",
                f"{where}: residual families that fire although no fault so far moves them",
                "slide 10: 0 in the signature",
                lambda n=number: _unmoved(n),
                0,
                0,
            )
        )
        out += [
            Planned(
                "mar10",
                f"{where}: residual families that show the {name} and are blind to earlier faults",
                'slide 10: "full isolation possible": at least one',
                lambda n=number, k=k: _selected(n, k),
                1,
                27,
            )
            for k, (name, _) in enumerate(truth)
        ]
    return out
