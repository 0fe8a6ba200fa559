"""Faults that begin on a condition: the flight is flown until it holds, then with the fault from that tick on.

A flight repeats to the last bit, so the tick at which a condition first holds is that of the flight with the fault. The
scenario that flies, and that its log holds, has the onset as `start_s` beside `when`.
"""

import numpy as np

from cosim.flight.build import build
from cosim.flight.fly import record
from cosim.scenario import Scenario, parse
from cosim.scenario.condition import TIME, condition, other_fault, signals, true
from cosim.scenario.user_parts import identified


def resolved(scenario: Scenario) -> Scenario:
    """Return `scenario` with an onset for each fault that waits for a condition; after the flight's end where it never
    holds. Raises ScenarioError for a signal that the flight does not have.

    Conditions are met one after the other: what one fault does can make the next one true.
    """
    scenario = identified(scenario)
    while any(f.waits for f in scenario.faults):
        waiting = {i: condition(f.when or "") for i, f in enumerate(scenario.faults) if f.waits}
        begun = tuple(f for i, f in enumerate(scenario.faults) if i not in waiting)
        setup = build(scenario.model_copy(update={"faults": begun}))
        names = list(dict.fromkeys(name for c in waiting.values() for name in signals(c)))
        flown = [name for name in names if name != TIME and other_fault(name) is None]
        rows, *_ = record(setup, ["clock.clock.t", *flown])
        t, *columns = np.asarray(rows).T
        values = {TIME: t, **dict(zip(flown, columns))}
        values |= {name: _of_fault(name, scenario, t) for name in names if name not in values}
        first = {i: np.flatnonzero(true(c, values)) for i, c in waiting.items()}
        onset = {i: round((int(k[0]) + 1) * scenario.dt, 9) for i, k in first.items() if len(k)}
        next_one = min(onset, key=lambda i: onset[i], default=None)
        starts = {next_one: onset[next_one]} if next_one is not None else dict.fromkeys(waiting, scenario.duration_s)
        faults = tuple(f.at_time(starts[i]) if i in starts else f for i, f in enumerate(scenario.faults))
        changed = scenario.model_copy(update={"faults": faults})
        scenario = parse(changed.model_dump(exclude_none=True), place="")  # refuses what is not possible together
    return scenario


def _of_fault(name, scenario, t):
    """Return `fault.N.active` or `fault.N.since` at the times t, not a number where fault N has not begun."""
    fault, slack = scenario.faults[other_fault(name)], 0.5 * scenario.dt  # as the loop takes them, to the nearest tick
    if fault.waits:
        return np.full_like(t, np.nan)
    begun = t > fault.start_s - slack
    ended = t >= (np.inf if fault.end_s is None else fault.end_s) - slack
    value = np.where(ended, 0.0, 1.0) if name.endswith("active") else t - fault.start_s
    return np.where(begun, value, np.nan)
