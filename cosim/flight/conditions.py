"""Faults that begin when something happens: the flight is flown until it does, then with the fault from that tick on.

A flight repeats to the last bit, so the tick at which a condition first holds is that of the flight with the fault. The
scenario that flies, and that its log holds, has the onset as `start_s` beside `when`.
"""

import numpy as np

from cosim.flight.build import build
from cosim.flight.fly import record
from cosim.scenario import Scenario
from cosim.scenario.condition import condition, source


def resolved(scenario: Scenario) -> Scenario:
    """Return `scenario` with an onset for each fault that waits for a condition; after the flight's end where it never
    holds. Raises ScenarioError for a signal that the flight does not have.

    Conditions are met one after the other: what one fault does can make the next one true.
    """
    while any(f.waits for f in scenario.faults):
        waiting = {i: condition(f.when or "") for i, f in enumerate(scenario.faults) if f.waits}
        names = list(dict.fromkeys(name for c in waiting.values() for name in c.signals()))
        rows, *_ = record(build(_without(scenario, waiting)), [source(name) for name in names])
        values = dict(zip(names, np.asarray(rows).T))
        first = {i: np.flatnonzero(c.true(values)) for i, c in waiting.items()}
        onset = {i: (int(k[0]) + 1) * scenario.dt for i, k in first.items() if len(k)}
        next_one = min(onset, key=lambda i: onset[i], default=None)
        starts = {next_one: onset[next_one]} if next_one is not None else dict.fromkeys(waiting, scenario.duration_s)
        faults = tuple(f.at_time(starts[i]) if i in starts else f for i, f in enumerate(scenario.faults))
        scenario = scenario.model_copy(update={"faults": faults})
    return scenario


def _without(scenario, waiting):
    """Return the scenario without the faults that still wait."""
    faults = tuple(f for i, f in enumerate(scenario.faults) if i not in waiting)
    return scenario.model_copy(update={"faults": faults})
