"""Fault-free reference of a flight, and how far a fault moves its elevator against it.

Same flight point, seed, noise and manoeuvre: what differs is the fault and what the law and the servos do about it. The
reference flies without detectors (but those that a servo closes on). Until the first fault it is the flight itself: a
copy of the process flies on without the faults from there, while the flight goes on with them. Where a process cannot
be copied it flies all of it. The last ones are kept, so that runs that differ in their fault only share one.
What is measured of the difference stands in cosim/judge/fault_effect.py.
"""

import ctypes
import gc
import math
import mmap
import os
import signal
import sys
import threading
import tomllib
from collections import OrderedDict
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.flight.build import Setup, build
from cosim.flight.fly import fly, onwards
from cosim.flight.loop.schedule import Tape
from cosim.flight.tick import order
from cosim.judge.fault_effect import moved
from cosim.judge.store import column_store
from cosim.scenario import Scenario, parse

KEPT = 16  # flights without faults
WAITS_FOR_PARENT = "parent"  # name of a thread that holds no lock
_PR_SET_PDEATHSIG = 1  # of Linux: which signal a process gets when the one that started it ends
_positions: OrderedDict[str, NDArray] = OrderedDict()  # TOML of a flight without faults -> `positions`


def achieved(scenario: Scenario) -> dict[str, dict]:
    """Fly `scenario` with and without its faults; return what these did to the segments that they act on.

    {segment: {rod_mm, surface_deg, travel_pct, amplitude_mm, amplitude_deg}}: the first three are peaks. Raises
    TrimError.
    """
    setup = build(scenario)
    with FaultFreeRun(setup) as reference:
        rows, *_ = fly(setup, pause=reference.pause)
        return reference.displacement(rows)


def faulted(scenario: Scenario) -> dict[str, list]:
    """Return {segment: its injections} of the segments that a fault acts on, directly or by a sensor of the loop."""
    out: dict[str, list] = {}
    for j in scenario.injections():
        if j.place in ("elevator", "actuator_sensor") and j.path != "monitor":
            out.setdefault(j.name, []).append(j)
    return out


class FaultFreeRun:
    """A built flight without its faults, from the first onset on in a copy of the process. `pause` is for `fly`, then
    `displacement` says how far the faults have moved the elevators."""

    def __init__(self, setup: Setup):
        self._setup, self._segments = setup, faulted(setup.scenario)
        self._key = _quiet(setup.scenario).expanded_toml() if self._segments else ""  # of this run
        self._child, self._first = 0, 0  # its process, and its first tick
        self._rows, self._flown = np.zeros((0, 0), np.float32), np.zeros(1, np.int64)  # what it writes
        self.pause: tuple[int, Any] | None = None
        if self._segments and self._key not in _positions and _copies():
            first = int(np.min(setup.loop.faults.p["start"]) / setup.loop.dt) - 1
            self.pause = min(max(0, first), setup.ticks), self._part

    def _part(self, k):
        """Fly on without the faults from tick `k`, in a copy of this process."""
        n, columns = self._setup.ticks, [column for column, _ in _places(self._setup.trace)]
        self._rows = np.frombuffer(mmap.mmap(-1, 4 * len(columns) * n), np.float32).reshape(n, -1)
        self._flown = np.frombuffer(mmap.mmap(-1, 8), np.int64)
        self._first, self._child = k, os.fork()
        if not self._child:
            try:
                ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a copy ends with what it was copied from
                gc.disable()  # what is not written to is not copied
                self._flown[:] = _quietly(self._setup, k, self._setup.trace.index[columns], self._rows)
                os._exit(0)
            finally:
                os._exit(1)

    def displacement(self, rows: NDArray) -> dict[str, dict]:
        """Return what `achieved` returns, from the rows of the flight flown; {} when no fault acts on an elevator."""
        if not self._segments:
            return {}
        trace, scenario = self._setup.trace, self._setup.scenario
        reference, places, out = self._reference(rows), _places(trace), {}
        n = min(len(rows), len(reference))
        for segment, faults in self._segments.items():
            i = 2 * list(trace.surface).index(segment)
            difference = _placed(places[i : i + 2], rows[:n]).astype(float) - reference[:n, i : i + 2]
            out[segment] = moved(difference, faults, scenario.dt, scenario.aircraft.travel)
        return out

    def _reference(self, rows):
        """Return `positions` without the faults; `rows` are those of the flight."""
        if self._child:
            child, self._child = self._child, 0
            if os.waitpid(child, 0)[1] == 0:
                places = _places(self._setup.trace)
                own = [(i, gain) for i, (_, gain) in enumerate(places)]
                reference = _placed(own, self._rows[: int(self._flown[0])])
                reference[: self._first] = _placed(places, rows[: self._first])
                _keep(self._key, reference)
        return positions(self._key)

    def __enter__(self) -> "FaultFreeRun":
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if self._child:  # nobody wants to know any more
            os.kill(self._child, 9)
            os.waitpid(self._child, 0)
            self._child = 0


def _copies():
    """Tell whether this process may be copied: on Linux, while it has no other thread of Python than this one, and in a
    worker the one that only waits for the parent's end."""
    others = {t.name for t in threading.enumerate() if t is not threading.current_thread()}
    return sys.platform == "linux" and others <= {WAITS_FOR_PARENT} and hasattr(os, "fork")


def _quietly(setup, k, index, rows):
    """Fly a built flight on from tick `k` without its faults; rows[k:] take the positions `index` of the bus.

    Return how many ticks have been flown.
    """
    quiet = _quiet(setup.scenario).running
    loop = replace(setup.loop, detectors=[d for d in setup.loop.detectors if d.name in quiet])
    loop.faults.p["start"] = np.inf
    tape = Tape(loop.v, loop.dt)
    order(loop, tape, keep=(index, rows))
    return onwards(loop, tape, range(k, len(rows)))[0]


def positions(scenario_toml: str) -> NDArray:
    """Return columns (ticks, 8) of a flight: per segment rod [m], NaN where it has none, and surface [rad]."""
    if scenario_toml not in _positions:
        setup = build(parse(tomllib.loads(scenario_toml)))
        rows, *_ = fly(setup)
        _keep(scenario_toml, _placed(_places(setup.trace), rows))
    _positions.move_to_end(scenario_toml)
    return _positions[scenario_toml]


def _keep(key, value):
    _positions[key] = value
    if len(_positions) > KEPT:
        _positions.popitem(last=False)


def unwatched(scenario: Scenario) -> Scenario:
    """Return `scenario` without detectors but those in the loop: nothing of a user's detectors is run to fly it."""
    own = {name: t for name, t in (scenario.detectors.model_extra or {}).items() if "file" not in t}
    return scenario.model_copy(update={"detectors": type(scenario.detectors)(enabled=(), **own)})


def _quiet(scenario):
    return unwatched(scenario).model_copy(update={"title": "", "faults": ()})


def _places(trace):
    """Return (column of the trace, its m or rad) of each segment's rod and surface; NaN where it has no rod."""
    rods = [trace.rod.get(segment, (column, math.nan)) for segment, column in trace.surface.items()]
    return [place for rod, column in zip(rods, trace.surface.values()) for place in (rod, (column, 1.0))]


def _placed(places, rows):
    """Return (ticks, places) in single precision of the rows (ticks, columns)."""
    out = column_store(len(rows), len(places))
    for i, (column, gain) in enumerate(places):
        out[:, i] = gain * rows[:, column]
    return out
