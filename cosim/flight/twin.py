"""How far a fault moves its elevator: the flight against its twin, the same flight without the faults.

Same flight point, seed, noise and manoeuvre: what differs is the fault and what the law and the servos do about it. The
twin flies without detectors (but those that a servo closes on), which costs a bit less than the flight; the last twins
are kept, so that runs that differ in their fault only share one.
What is measured of the difference stands in cosim/judge/achieved.py.
"""

import functools
import tomllib

import numpy as np
from numpy.typing import NDArray

from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.flight.trace import History
from cosim.judge.achieved import moved as of_segment
from cosim.scenario import Scenario, parse


def achieved(scenario: Scenario) -> dict[str, dict]:
    """Fly `scenario` and its twin; return what its faults did to the segments that they act on.

    {segment: {rod_mm, surface_deg, travel_pct, amplitude_mm, amplitude_deg}}: the first three are peaks. Costs a flight
    and the twin. Raises TrimError.
    """
    setup = build(scenario)
    rows, *_ = fly(setup)
    return moved(scenario, setup.history, rows)


def faulted(scenario: Scenario) -> dict[str, list]:
    """Return {segment: its injections} of the segments that a fault acts on, directly or by a sensor of the loop."""
    out: dict[str, list] = {}
    for j in scenario.injections():
        if j.place in ("elevator", "actuator_sensor") and j.path != "monitor":
            out.setdefault(j.name, []).append(j)
    return out


def moved(scenario: Scenario, history: History | None, rows: NDArray | None) -> dict[str, dict]:
    """Return what `achieved` returns, from the rows of a flight flown; {} when no fault acts on an elevator segment."""
    segments = faulted(scenario)
    if not segments or history is None or rows is None:
        return {}
    twin = positions(_without_faults(scenario))
    here = _positions(history, rows)
    n = min(len(here), len(twin))
    names = list(history.surface)
    difference = here[:n].astype(float) - twin[:n]
    pair = {seg: difference[:, 2 * names.index(seg) :][:, :2] for seg in segments}
    dt, travel = scenario.dt, scenario.aircraft.travel
    return {seg: of_segment(pair[seg], faults, dt, travel) for seg, faults in segments.items()}


@functools.lru_cache(maxsize=16)
def positions(scenario_toml: str) -> NDArray[np.float32]:
    """Return (ticks, 8) float32 of a flight: per segment rod [m], NaN where it has none, and surface [rad]."""
    setup = build(parse(tomllib.loads(scenario_toml)))
    rows, *_ = fly(setup)
    return _positions(setup.history, rows)


def _without_faults(scenario):
    """Return the TOML of the twin: no fault, no detector but those in the loop."""
    quiet = scenario.detectors.model_copy(update={"enabled": ()})
    return scenario.model_copy(update={"title": "", "faults": (), "detectors": quiet}).expanded_toml()


def _positions(history, rows):
    out = np.full((len(rows), 2 * len(history.surface)), np.nan, np.float32)
    for i, seg in enumerate(history.surface):
        if seg in history.rod:
            column, gain = history.rod[seg]
            out[:, 2 * i] = gain * rows[:, column]
        out[:, 2 * i + 1] = rows[:, history.surface[seg]]
    return out
