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

import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from actuators.common.linkage import ARM
from actuators.ema import jay
from actuators.simple import actuator as simple
from cosim.judge.store import release
from fdi import registry

if TYPE_CHECKING:
    from cosim.scenario import Scenario

ADDED = ("bias", "drift", "scale", "oscillation", "jam_liquid", "ofc_liquid")  # they add a signal
LEAD = jay.values("elevator")["lead"]  # screw travel per radian of motor [m/rad]
SETTLE_S, SETTLE_PERIODS = 2.0, 3.0  # after the onset and its ramp; the longer one counts
BLOCK = 1 << 16  # ticks


@dataclass(frozen=True)
class Estimate:
    """Estimate one fault: its column in the trace, those of the truth, how they combine, when it should hold."""

    column: int
    columns: tuple
    truth: Callable  # (columns (n, ticks) float64 of the next ticks, dt, what it keeps between calls, {}) -> (ticks,)
    unit: str
    start: float  # [s], after settling
    end: float  # [s]

    def error(self, trace: NDArray, dt: float) -> Iterator[NDArray]:
        """Yield f_hat - f on the settled ticks, block by block, none when there are no such ticks."""
        first, stop = round(self.start / dt), round(min(self.end / dt, len(trace)))
        kept: dict = {}
        for a in range(0, stop if first < stop else 0, BLOCK):
            rows = trace[a : min(a + BLOCK, stop)]
            f = self.truth(rows[:, list(self.columns)].T.astype(float), dt, kept)
            yield (rows[:, self.column].astype(float) - f)[max(0, first - a) :]
            release(trace)


def plan(scenario: "Scenario", detector: str, lane: str, columns: Callable[[str], int]) -> Estimate | None:
    """Return the Estimate of the earliest fault that `detector` estimates on `lane`, or None. `columns(bus name)` gives
    a column of the trace."""
    estimates = getattr(registry.find(detector), "estimates", ())
    injections = sorted(scenario.injections(), key=lambda j: j.start) if estimates else ()
    for j, e in itertools.product(injections, estimates):
        names, truth = _truth(e, lane, j, scenario)
        if names:
            column, period = columns(f"{detector}.{lane}.{e.output}"), scenario.faults[j.fault].period_s or 0.0
            start = j.start + j.ramp + max(SETTLE_S, SETTLE_PERIODS * period)
            return Estimate(column, tuple(map(columns, names)), truth, e.unit, start, j.end)
    return None


def _truth(e, lane, j, scenario):
    """Return (names of the bus, how they combine) of what estimate `e` of a lane should follow when `j` is injected;
    no names where it is not of `j`."""
    part, _, side = e.of.partition(".")
    on_elevator, technology = j.place == "elevator" and not j.sensor, scenario.elevator.technology.get(lane)
    if e.of == "valve" and on_elevator and (j.name, j.at, technology) == (lane, "valve", "hydraulic"):
        return [f"hydraulic_in.{lane}.{n}" for n in ("f_u", "s_u", "u")], _at_valve
    if part == "elevator" and on_elevator and j.name.startswith(side):
        segments = [s for name, s in scenario.aircraft.short.items() if name.startswith(side)]
        return ["law.law.de_cmd", *(f"truth.aircraft.de_{s}" for s in segments)], _beyond_healthy
    if e.of == "thrust" and j.place == "engine":
        return [f"surfaces.aircraft.thrust_loss_{i}" for i in scenario.aircraft.engine_names], _mean_loss
    sensor = {e.of: e.of} if j.place == "sensor" else {e.of: f"{lane}_{e.of}"} if j.name == lane else {}
    if j.kind in ADDED and (name := sensor.get(j.name if j.place == "sensor" else j.sensor)):
        per_truth = LEAD if e.of == "position" else 1.0  # the sensor is wired to the motor's angle
        per_reading = ARM if (e.of, e.unit) == ("surface", "m") else 1.0
        fields = ("f_add", "g_add", "f_scale", "g_scale", "truth")
        return [f"sensors_in.{name}.{n}" for n in fields], functools.partial(_added, per_truth, per_reading)
    return [], None


def _at_valve(v, dt, kept):
    last = np.concatenate([kept.get("last", np.zeros((2, 1))), v[:2]], axis=1)
    kept["last"], (f_u, s_u) = last[:, -1:], last[:, :-1]
    return f_u - s_u * v[2]  # u is still the one held over the last tick, f_u and s_u were already the next ones


def _mean_loss(v, dt, kept):
    return -v.mean(axis=0)


def _added(per_truth, per_reading, v, dt, kept):
    f_add, g_add, f_scale, g_scale, s = v
    return per_reading * (f_add + g_add + (f_scale + g_scale) * per_truth * s)


def _beyond_healthy(v, dt, kept):
    actual, p = v[1:].mean(axis=0), simple.params()
    if "x" not in kept:
        kept |= {"x": simple.init_at(p, actual[0]), "healthy": actual[:1]}
    u, log = np.zeros((1, len(actual)), simple.INPUTS), np.zeros((1, len(actual)), simple.STATE)
    u["command"] = v[0]  # acts from the next tick on
    simple.rollout(kept["x"], u, p, dt, log)
    healthy = np.append(kept["healthy"], log["delta"][0])
    kept["healthy"] = healthy[-1:]
    return actual - healthy[:-1]
