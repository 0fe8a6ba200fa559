"""What a run keeps of every tick for its judgement: verdicts, residuals, estimates beside their faults, elevators.

One indexed copy of the bus per tick in single precision (codes are exact, residuals need no more), so that the loop
stays fast and ten minutes stay small.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cosim.flight.bus import Bus
from cosim.judge.estimation import plan
from cosim.judge.result import Watch
from cosim.scenario import Scenario
from cosim.scenario.catalog import LOOP_SENSOR, TECHNOLOGIES

VERDICT = ("alarm", "verdict", "culprit", "r")


def _rod(columns, segment, technology):
    """Return (column of the rod's or screw's position, metres per unit)."""
    name = technology.loop_sensor
    state = technology.sensors[name].state
    return columns(f"{technology.name}.{segment}.{state}"), technology.design().gains.get(name, 1.0)


@dataclass
class Columns:
    """Names of the bus and their columns in the history; the same name stands once."""

    bus: Bus
    column: dict = field(default_factory=dict)

    def __call__(self, name: str) -> int:
        """Return the column of bus name `name`, added when it is new."""
        return self.column.setdefault(name, len(self.column))

    @property
    def index(self) -> NDArray[np.int64]:
        """Return the positions in the bus, one per column."""
        return np.array([self.bus.index(name) for name in self.column], np.int64)


class History:
    """Hold the columns of one flight: `rows[k] = v[index]` at every tick."""

    def __init__(self, scenario: Scenario, bus: Bus, members: list[tuple]):
        """`members` is [(id, level, target, culprits, section, lane)] of every detector lane."""
        columns, technology = Columns(bus), scenario.elevator.technology
        self.lanes = []
        for name, level, target, culprits, section, lane in members:
            own = [columns(f"{section}.{lane}.{f}") for f in VERDICT]
            self.lanes.append((name, level, target, culprits, own, plan(scenario, name, lane, columns)))
        self.surface = {seg: columns(f"truth.aircraft.de_{s}") for seg, s in scenario.aircraft.short.items()}
        self.rod = {seg: _rod(columns, seg, TECHNOLOGIES[t]) for seg, t in technology.items() if t in LOOP_SENSOR}
        self.index = columns.index

    def watches(self, step_us: dict[str, float]) -> list[Watch]:
        """Return the Watch of every detector lane; `step_us` maps detector -> microseconds per step and lane."""
        return [
            Watch(name, level, target, culprits, alarm, verdict, culprit, r, estimate, step_us.get(name, float("nan")))
            for name, level, target, culprits, (alarm, verdict, culprit, r), estimate in self.lanes
        ]
