"""Fault estimates beside what they estimate: which output, which fault, which unit, which injected signal.

A detector's record says what its outputs estimate (fdi/common/record.py, `Estimate`):

| of | truth |
|---|---|
| valve | f_u - s_u u: what acted at the valve of its actuator less what the servo sent |
| a word of a sensor | the fault in the reading |
| elevator, elevator.left, elevator.right | surface less healthy, mean of the segments |
| thrust | minus the mean loss of the engines |

A healthy elevator is the simple actuator (actuators/simple/actuator.py) on the law's command: inside the loop an
oscillation is filtered, so the injected signal is not what the aircraft feels. A filter's estimate at t_k concerns the
tick that ends there: signals at the valve are taken one tick back.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from actuators.common.linkage import ARM
from actuators.ema import jay
from actuators.simple import actuator as simple
from fdi import registry
from fdi.common.record import Estimate as Part

if TYPE_CHECKING:
    from cosim.scenario import Scenario

ADDED = ("bias", "drift", "scale", "oscillation", "jam_liquid", "ofc_liquid")  # they add a signal
LEAD = jay.values("elevator")["lead"]  # screw travel per radian of motor [m/rad]
SETTLE_S, SETTLE_PERIODS = 2.0, 3.0  # after the onset and its ramp; the longer one counts
BLOCK = 1 << 16  # ticks at once: bounds the memory


@dataclass(frozen=True)
class Estimate:
    """Estimate one fault: its column in the trace, those of the truth, how they combine, when it should hold."""

    column: int
    columns: tuple
    truth: Callable  # (trace columns as (n, ticks) float64, dt, what it left of the ticks before) -> (ticks,)
    unit: str
    start: float  # [s], after settling
    end: float  # [s]

    def error(self, trace: Any, dt: float) -> Iterator[np.ndarray]:
        """Yield f_hat - f on the settled ticks, in blocks; none when there are no such ticks."""
        first, stop = round(self.start / dt), round(min(self.end / dt, len(trace)))
        held: dict = {}
        for a in range(0, stop if first < stop else 0, BLOCK):
            part = trace[a : min(a + BLOCK, stop)]
            f = self.truth(part[:, list(self.columns)].T.astype(float), dt, held)
            yield (part[:, self.column].astype(float) - f)[max(0, first - a) :]


def plan(scenario: "Scenario", detector: str, lane: str, columns: Callable[[str], int]) -> Estimate | None:
    """Return the Estimate of the earliest fault that `detector` estimates on `lane`, or None. `columns(bus name)` gives
    a column of the trace."""
    for j in sorted(scenario.injections(), key=lambda j: j.start):
        found = _found(detector, lane, j, scenario)
        if found:
            column, names, truth, unit = found
            period = scenario.faults[j.fault].period_s or 0.0
            start = j.start + j.ramp + max(SETTLE_S, SETTLE_PERIODS * period)
            return Estimate(columns(column), tuple(map(columns, names)), truth, unit, start, j.end)
    return None


def truths(scenario: "Scenario") -> list[str]:
    """Return the names of the bus from which the truth of any estimate of the faults of `scenario` is made."""
    injections = scenario.injections()
    named = [name for j in injections for name in (j.name, j.sensor) if name]
    parts = dict.fromkeys(("valve", "thrust", "elevator", "elevator.left", "elevator.right", *named))
    places = [*scenario.elevator.technology, "aircraft"]
    found = (_truth(Part(of, "", ""), lane, j, scenario) for j in injections for lane in places for of in parts)
    return list(dict.fromkeys(name for each in found if each for name in each[0]))


def _found(detector, lane, j, scenario):
    record = registry.find(detector)
    for e in record.estimates if record else ():
        found = _truth(e, lane, j, scenario)
        if found:
            return f"{detector}.{lane}.{e.output}", *found, e.unit
    return None


def _truth(e, lane, j, scenario):
    """Return (names of the bus, how they combine) of what estimate `e` of a lane should follow when `j` is injected."""
    part, _, side = e.of.partition(".")
    aircraft, own = scenario.aircraft, scenario.elevator.technology.get(lane)
    if e.of == "valve":
        here = (j.place, j.name, j.at) == ("elevator", lane, "valve") and own == "hydraulic"
        return ([f"hydraulic_in.{lane}.{n}" for n in ("f_u", "s_u", "u")], _at_valve) if here else None
    if part == "elevator":
        parts = [s for name, s in aircraft.short.items() if name.startswith(side)]
        here = j.place == "elevator" and not j.sensor and j.name.startswith(side)
        return (["law.law.de_cmd", *(f"truth.aircraft.de_{s}" for s in parts)], _beyond_healthy) if here else None
    if e.of == "thrust":
        losses = [f"surfaces.aircraft.thrust_loss_{i}" for i in aircraft.engine_names]
        return (losses, lambda v, dt, held: -v.mean(axis=0)) if j.place == "engine" else None
    if j.kind not in ADDED:
        return None
    if j.place == "sensor" and j.name == e.of:
        return _reading(j.name), _added(1.0, 1.0)
    if j.sensor == e.of and j.name == lane:
        per_truth = LEAD if e.of == "position" else 1.0  # the sensor is wired to the motor's angle
        return _reading(f"{lane}_{e.of}"), _added(per_truth, ARM if (e.of, e.unit) == ("surface", "m") else 1.0)
    return None


def _reading(lane):
    return [f"sensors_in.{lane}.{n}" for n in ("f_add", "g_add", "f_scale", "g_scale", "truth")]


def _at_valve(v, dt, held):
    f_u, s_u, u = v
    before = held.get("last", (0.0, 0.0))
    held["last"] = f_u[-1], s_u[-1]
    f_u, s_u = (np.concatenate([[first], x[:-1]]) for first, x in zip(before, (f_u, s_u)))
    return f_u - s_u * u  # u is still the one held over the last tick, f_u and s_u were already the next ones


def _added(per_truth, per_reading):
    def truth(v, dt, held):
        f_add, g_add, f_scale, g_scale, s = v
        return per_reading * (f_add + g_add + (f_scale + g_scale) * per_truth * s)

    return truth


def _beyond_healthy(v, dt, held):
    command, actual = v[0], v[1:].mean(axis=0)
    p = simple.params()
    x, last = held.get("healthy") or (simple.init_at(p, actual[0]), actual[0])
    u, log = np.zeros((1, len(command)), simple.INPUTS), np.zeros((1, len(command)), simple.STATE)
    u["command"] = command
    simple.rollout(x, u, p, dt, log)
    held["healthy"] = x, log["delta"][0, -1]
    return actual - np.concatenate([[last], log["delta"][0, :-1]])
