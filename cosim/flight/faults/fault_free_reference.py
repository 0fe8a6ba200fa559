"""Fault-free reference of a flight, and how far a fault moves its elevator against it.

Same flight point, seed, noise and manoeuvre: what differs is the fault and what the law and the servos do about it. The
reference flies without detectors (but those that a servo closes on). The last ones are kept, so that runs that differ
in their fault only share one. What is measured of the difference stands in cosim/judge/fault_effect.py.
"""

import numpy as np
from numpy.typing import NDArray

from cosim.flight.build import Setup, build
from cosim.flight.fly import fly
from cosim.judge.fault_effect import moved
from cosim.judge.store import release
from cosim.scenario import Scenario

KEPT = 16  # flights without faults
_positions: dict[str, NDArray] = {}  # TOML of a flight without faults -> rods [m] and surfaces [rad] of its segments


def faulted(scenario: Scenario) -> dict[str, list]:
    """Return {segment: its injections} of the segments that a fault acts on, directly or by a sensor of the loop."""
    out: dict[str, list] = {}
    for j in scenario.injections():
        if j.place in ("elevator", "actuator_sensor") and j.path != "monitor":
            out.setdefault(j.name, []).append(j)
    return out


def displacement(setup: Setup, rows: NDArray) -> dict[str, dict]:
    """Return what the faults of a flight, of which `rows` are the trace, did to the segments that they act on.

    {segment: {rod_mm, surface_deg, travel_pct, amplitude_mm, amplitude_deg}}: the first three are peaks. {} when no
    fault acts on an elevator; else the flight without them is flown.
    """
    scenario, trace = setup.scenario, setup.trace
    segments, out = faulted(scenario), {}
    reference = _fault_free(scenario) if segments else rows
    n = min(len(rows), len(reference))
    for segment, faults in segments.items():
        i = 2 * list(scenario.aircraft.short).index(segment)
        own = slice(i, i + 2)
        apart = (rows[:n, trace.moving[own]] * trace.gains[own]).astype(float)
        apart -= reference[:n, own] * trace.gains[own]
        release(rows)
        release(reference)
        out[segment] = moved(apart, faults, scenario.dt, scenario.aircraft.travel)
    return out


def _fault_free(scenario):
    """Return rods and surfaces (ticks, 2 segments) of a scenario without its faults, as they stand on the bus."""
    quiet = unwatched(scenario).model_copy(update={"title": "", "faults": ()})
    key = quiet.expanded_toml()
    if key not in _positions:
        setup = build(quiet)
        _positions[key], *_ = fly(setup, keep=(setup.trace.index[setup.trace.moving], np.float32))
        if len(_positions) > KEPT:
            del _positions[next(iter(_positions))]
    return _positions[key]


def unwatched(scenario: Scenario) -> Scenario:
    """Return `scenario` without detectors but those in the loop: nothing of a user's detectors is run to fly it."""
    own = {name: t for name, t in (scenario.detectors.model_extra or {}).items() if "file" not in t}
    return scenario.model_copy(update={"detectors": type(scenario.detectors)(enabled=(), **own)})
