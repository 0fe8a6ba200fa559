"""[Mar10] slides 13 to 15: the residuals that a scenario's faults move react, and no others.

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


def chosen(number: int) -> tuple[float, str]:
    """Return (faults of a scenario that no residual of their own shows, or that one shows too early; what fires).

    A family is a fault's own that it moves while the earlier ones do not, until a later fault moves it too; it is early
    when it fires before any fault that moves it, from the learned offset on.
    """
    flown, log, families = nominal_flight(number)
    t, truth, early = flown.index.to_numpy(), flights.TRUTH[number], []
    own: dict[str, list[str]] = {name: [] for name, _ in truth}
    for family, fired in zip(families, log["fired"].T > 0.5):
        moved = [(name, at) for name, at in truth if family.signature[INPUTS.index(name)]]
        first, second = ([at for _, at in moved] + [np.inf] * 2)[:2]
        if fired[(t >= 20.0) & (t < first)].any():
            early.append(family.name)
        if fired[(t >= first) & (t < second)].any():
            own[moved[0][0]].append(family.name)
    words = "; ".join(f"{name}: {', '.join(which) or 'none'}" for name, which in own.items())
    alone = sum(not which for which in own.values())
    return len(early) + alone, words + (f"; early: {', '.join(early)}" if early else "")
