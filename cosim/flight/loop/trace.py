"""Trace of a run for its judgement: verdicts, residuals, estimates beside their faults, elevators.

One indexed copy of the bus per tick in single precision (codes are exact, residuals need no more), so that the loop
stays fast and ten minutes stay small.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from actuators.constants import M_S_PER_KT
from cosim.flight.loop.bus import Bus
from cosim.judge.detection import JudgedLane, outputs_read
from cosim.judge.estimation import plan
from cosim.judge.fault_effect import MOTION, consequences
from cosim.judge.store import release
from cosim.scenario import Scenario
from cosim.scenario.catalog import LOOP_SENSOR, TECHNOLOGIES


def _rod(segment, technology, aircraft):
    """Return (bus name of the rod's or screw's position, metres per unit)."""
    name = technology.loop_sensor
    gain = technology.design(aircraft.own(technology.name)).gains.get(name, 1.0)
    return f"{technology.name}.{segment}.{technology.sensors[name].state}", gain


class Trace:
    """Hold the columns of one flight: `rows[k] = v[index]` at every tick.

    Of each segment in turn, `moving` are the columns of rod and surface, `gains` their metres and radians per unit, not
    a number where it has no rod.
    """

    def __init__(self, scenario: Scenario, bus: Bus, detectors: Iterable[Any]):
        """`detectors` are the Installed ones of the flight (cosim/flight/detection/detectors.py)."""
        column: dict[str, int] = {}  # by name on the bus; the same name stands once
        technology, aircraft = scenario.elevator.technology, scenario.aircraft

        def columns(name):
            return column.setdefault(name, len(column))

        self.lanes = []
        for d, lane in ((each, lane) for each in detectors for lane in each.lanes):
            parts, outputs = d.module.ISOLABLE_PARTS, bus.kinds[d.id].names or ()
            at = {f: columns(f"{d.id}.{lane}.{f}") for f in outputs_read(parts, outputs)}
            estimate = plan(scenario, d.id, lane, columns)
            self.lanes.append(JudgedLane(d.id, d.record.level, d.target(lane), parts, at, estimate))
        moving = []
        for seg, short in aircraft.short.items():
            own, surface = TECHNOLOGIES[technology[seg]], f"truth.aircraft.de_{short}"
            rod = _rod(seg, own, aircraft) if own.name in LOOP_SENSOR else (surface, math.nan)
            moving += [rod, (surface, 1.0)]
        self.moving = [columns(name) for name, _ in moving]
        self.gains = np.array([gain for _, gain in moving], np.float32)
        self.motion = {name: columns(f"truth.aircraft.{name}") for name in MOTION}
        self.hinge = [[columns(f"truth.aircraft.{f}_{s}") for f in ("hm0", "hmd", "de")]
                      for s in aircraft.short.values()]  # fmt: skip
        self.index = np.array([bus.index(name) for name in column], np.int64)

    def consequences(self, scenario: Scenario, rows: Any) -> dict[str, float] | None:
        """Return what the faults of `scenario` did to the aircraft from `rows` (ticks, columns), None without any."""
        begin = min((f.start_s for f in scenario.faults if f.start_s is not None), default=scenario.duration_s)
        low, high = scenario.aircraft.limits.cas_kt
        rows = rows[round(begin / scenario.dt) :]
        motion = {name: rows[:, column] for name, column in self.motion.items()}
        return consequences(motion, self._moments(rows), scenario.dt, (low * M_S_PER_KT, high * M_S_PER_KT))

    def _moments(self, rows):
        """Yield the hinge moment of each segment (ticks,) [N m]; the columns of one at a time are in memory."""
        for hm0, hmd, de in self.hinge:
            yield rows[:, hm0] + rows[:, hmd] * rows[:, de]
            release(rows)
