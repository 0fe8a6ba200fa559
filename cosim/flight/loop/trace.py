"""Trace of a run for its judgement: verdicts, residuals, estimates beside their faults, elevators.

One indexed copy of the bus per tick in single precision (codes are exact, residuals need no more), so that the loop
stays fast and ten minutes stay small.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actuators.constants import M_S_PER_KT
from cosim.flight.loop.bus import Bus
from cosim.judge.detection import JudgedLane, outputs_read
from cosim.judge.estimation import plan
from cosim.judge.fault_effect import MOTION, consequences
from cosim.scenario import Scenario
from cosim.scenario.catalog import LOOP_SENSOR, TECHNOLOGIES


def _rod(columns, segment, technology, aircraft):
    """Return (column of the rod's or screw's position, metres per unit)."""
    name = technology.loop_sensor
    state = technology.sensors[name].state
    gains = technology.design(aircraft.own(technology.name)).gains
    return columns(f"{technology.name}.{segment}.{state}"), gains.get(name, 1.0)


@dataclass
class Columns:
    """Names of the bus and their columns in the trace; the same name stands once."""

    bus: Bus
    column: dict = field(default_factory=dict)

    def __call__(self, name: str) -> int:
        """Return the column of bus name `name`, added when it is new."""
        return self.column.setdefault(name, len(self.column))

    @property
    def index(self) -> NDArray[np.int64]:
        """Return the positions in the bus, one per column."""
        return np.array([self.bus.index(name) for name in self.column], np.int64)


class Trace:
    """Hold the columns of one flight: `rows[k] = v[index]` at every tick."""

    def __init__(self, scenario: Scenario, bus: Bus, detectors: Iterable[Any]):
        """`detectors` are the Installed ones of the flight (cosim/flight/detection/detectors.py)."""
        columns, technology = Columns(bus), scenario.elevator.technology
        self._lanes = []
        for d, lane in ((each, lane) for each in detectors for lane in each.lanes):
            parts, outputs = d.module.ISOLABLE_PARTS, bus.kinds[d.id].names or ()
            at = {f: columns(f"{d.id}.{lane}.{f}") for f in outputs_read(parts, outputs)}
            estimate = plan(scenario, d.id, lane, columns)
            self._lanes.append(JudgedLane(d.id, d.level, d.target(lane), parts, at, estimate))
        self.surface = {seg: columns(f"truth.aircraft.de_{s}") for seg, s in scenario.aircraft.short.items()}
        self.rod = {seg: _rod(columns, seg, TECHNOLOGIES[t], scenario.aircraft)
                    for seg, t in technology.items() if t in LOOP_SENSOR}  # fmt: skip
        self.motion = {name: columns(f"truth.aircraft.{name}") for name in MOTION}
        short = scenario.aircraft.short.values()
        self.hinge = [[columns(f"truth.aircraft.{f}_{s}") for f in ("hm0", "hmd", "de")] for s in short]
        self.index = columns.index

    def consequences(self, scenario: Scenario, rows: Any) -> dict[str, float] | None:
        """Return what the faults of `scenario` did to the aircraft from `rows` (ticks, columns), None without any."""
        starts = [f.start_s for f in scenario.faults if f.start_s is not None]
        if not starts:
            return None
        low, high = scenario.aircraft.limits.cas_kt
        onset = round(min(starts) / scenario.dt)
        rows = rows[onset:]
        motion = {name: rows[:, column] for name, column in self.motion.items()}
        hinge = (rows[:, hm0] + rows[:, hmd] * rows[:, de] for hm0, hmd, de in self.hinge)
        return consequences(motion, hinge, scenario.dt, (low * M_S_PER_KT, high * M_S_PER_KT))

    def judged_lanes(self, step_us: dict[str, float]) -> list[JudgedLane]:
        """Return every detector lane; `step_us` maps detector -> microseconds per step and lane."""
        return [replace(lane, step_us=step_us.get(lane.id, float("nan"))) for lane in self._lanes]
