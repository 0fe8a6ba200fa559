"""Fault-free reference of a flight, and how far a fault moves its elevator against it.

Same flight point, seed, noise and manoeuvre: what differs is the fault and what the law and the servos do about it. The
twin flies without detectors (but those that a servo closes on). Until the first fault it is the flight itself: a copy
of the process flies on without the faults from there, while the flight goes on with them. Where a process cannot be
copied the twin flies all of it. The last twins are kept, so that runs that differ in their fault only share one.
What is measured of the difference stands in cosim/judge/fault_effect.py.
"""

import ctypes
import functools
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

from cosim.flight.build import Setup, build
from cosim.flight.fly import fly, onwards
from cosim.flight.loop.schedule import Tape
from cosim.flight.tick import order
from cosim.judge.column_store import SPAN, Columns, ColumnStore
from cosim.judge.fault_effect import moved as of_segment
from cosim.scenario import Scenario, parse

KEPT = 16  # twins
WAITS_FOR_PARENT = "parent"  # name of a thread that holds no lock
_PR_SET_PDEATHSIG = 1  # of Linux: which signal a process gets when the one that started it ends
_positions: OrderedDict[str, ColumnStore] = OrderedDict()  # TOML of a flight without faults -> `positions`


def achieved(scenario: Scenario) -> dict[str, dict]:
    """Fly `scenario` and its twin; return what its faults did to the segments that they act on.

    {segment: {rod_mm, surface_deg, travel_pct, amplitude_mm, amplitude_deg}}: the first three are peaks. Costs a flight
    and the twin. Raises TrimError.
    """
    setup = build(scenario)
    with Twin(setup) as twin:
        rows, *_ = fly(setup, pause=twin.pause)
        return twin.moved(rows)


def faulted(scenario: Scenario) -> dict[str, list]:
    """Return {segment: its injections} of the segments that a fault acts on, directly or by a sensor of the loop."""
    out: dict[str, list] = {}
    for j in scenario.injections():
        if j.place in ("elevator", "actuator_sensor") and j.path != "monitor":
            out.setdefault(j.name, []).append(j)
    return out


class Twin:
    """The twin of a built flight that is about to be flown: `pause` is for `fly`, then `moved` says what it shows."""

    def __init__(self, setup: Setup):
        self._setup, self._segments = setup, faulted(setup.scenario)
        self._key = _quiet(setup.scenario).expanded_toml() if self._segments else ""  # of the twin
        self._child, self._first = 0, 0  # its process, and its first tick
        self._rows, self._flown = np.zeros((0, 0), np.float32), np.zeros(1, np.int64)  # what it writes
        self.pause: tuple[int, Any] | None = None
        if self._segments and self._key not in _positions and _copies():
            first = int(np.min(setup.loop.faults.p["start"]) / setup.loop.dt) - 1
            self.pause = min(max(0, first), setup.ticks), self._part

    def _part(self, k):
        """Fly on without the faults from tick `k`, in a copy of this process."""
        n, columns = self._setup.ticks, _columns(self._setup.trace)
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

    def moved(self, rows: Any) -> dict[str, dict]:
        """Return what `achieved` returns, from the rows of the flight flown; {} when no fault acts on an elevator."""
        if not self._segments:
            return {}
        trace, scenario = self._setup.trace, self._setup.scenario
        twin = self._positions(rows)
        n, out = min(len(rows), len(twin)), {}
        for seg, faults in self._segments.items():
            difference = Columns(functools.partial(_apart, trace, rows, twin, seg), n)
            out[seg] = of_segment(difference, faults, scenario.dt, scenario.aircraft.travel)
        return out

    def _positions(self, rows):
        """Return `positions` of the twin; `rows` are those of the flight."""
        if self._child:
            child, self._child = self._child, 0
            if os.waitpid(child, 0)[1] == 0:
                column = {c: i for i, c in enumerate(_columns(self._setup.trace))}
                rest = Columns(lambda c, a, b: self._rows[a:b, column[c]], int(self._flown[0]), self._first)
                _keep(self._key, _stored(self._setup.trace, rows[: self._first], rest))
        return positions(self._key)

    def __enter__(self) -> "Twin":
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
    loop.plant.hide()
    tape = Tape(loop.v, loop.dt)
    order(loop, tape, keep=(index, rows))
    return onwards(loop, tape, range(k, len(rows)))[0]


def positions(scenario_toml: str) -> ColumnStore:
    """Return columns (ticks, 8) of a flight: per segment rod [m], NaN where it has none, and surface [rad]."""
    if scenario_toml not in _positions:
        setup = build(parse(tomllib.loads(scenario_toml)))
        rows, *_ = fly(setup)
        _keep(scenario_toml, _stored(setup.trace, rows))
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
    """Return (column of the trace, its m or rad) of each segment's rod and surface; None where it has no rod."""
    rods = [trace.rod.get(segment, (None, math.nan)) for segment in trace.surface]
    return [place for rod, column in zip(rods, trace.surface.values()) for place in (rod, (column, 1.0))]


def _columns(trace):
    return [column for column, _ in _places(trace) if column is not None]


def _read(rows, column, gain):
    """Return one of the places (ticks,) in single precision, NaN without a column."""
    return np.full(len(rows), np.nan, np.float32) if column is None else np.asarray(gain * rows[:, column], np.float32)


def _stored(trace, *parts):
    """Return `positions` from the rows (ticks, columns of the trace) of a flight's parts."""
    out = ColumnStore()
    for part in parts:
        for a in range(0, len(part), SPAN):
            out.append(np.stack([_read(part[a : a + SPAN], *place) for place in _places(trace)], axis=1))
    return out


def _apart(trace, rows, twin, segment, c, first, stop):
    """Return the difference of a flight and its twin in the rod [m] (c = 0) or the surface [rad] (1) of a segment."""
    i = 2 * list(trace.surface).index(segment) + c
    return _read(rows[first:stop], *_places(trace)[i]).astype(float) - twin[first:stop, i]
