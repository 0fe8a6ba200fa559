"""Fault-free reference of a flight, and how far a fault moves its elevator against it.

Same flight point, seed, noise and manoeuvre: what differs is the fault and what the law and the servos do about it. The
reference flies without detectors (but those that a servo closes on). Until the first fault it is the flight itself: a
copy of the process flies on without the faults from there, while the flight goes on with them. Where a process cannot
be copied it flies all of it. The last ones are kept, so that runs that differ in their fault only share one.
What is measured of the difference stands in cosim/judge/fault_effect.py.
"""

import ctypes
import gc
import mmap
import os
import signal
import sys
import threading
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.flight.build import Setup, build
from cosim.flight.fly import fly, onwards
from cosim.judge.fault_effect import moved
from cosim.judge.store import column_store
from cosim.scenario import Scenario

KEPT = 16  # flights without faults
WAITS_FOR_PARENT = "parent"  # name of a thread that holds no lock
_PR_SET_PDEATHSIG = 1  # of Linux: which signal a process gets when the one that started it ends
_positions: dict[str, NDArray] = {}  # TOML of a flight without faults -> rods [m] and surfaces [rad] of its segments


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
        self._quiet = unwatched(setup.scenario).model_copy(update={"title": "", "faults": ()})
        self._key = self._quiet.expanded_toml() if self._segments else ""
        self._child, self._first = 0, 0  # its process, and its first tick
        self.pause: tuple[int, Any] | None = None
        if self._segments and self._key not in _positions and _copies():
            first = int(np.min(setup.loop.faults.p["start"]) / setup.loop.dt) - 1
            self.pause = min(max(0, first), setup.ticks), self._part

    def _part(self, k):
        """Fly on without the faults from tick `k`, in a copy of this process that shares `_rows` with it."""
        index, n = self._setup.trace.index[self._setup.trace.moving], self._setup.ticks
        self._rows = np.frombuffer(mmap.mmap(-1, 4 * len(index) * n), np.float32).reshape(n, -1)
        self._first, self._child = k, os.fork()
        if not self._child:
            try:
                ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)  # a copy ends with what it was copied from
                gc.disable()  # what is not written to is not copied
                loop = self._setup.loop
                loop.faults.p["start"] = np.inf
                quiet = replace(loop, detectors=[d for d in loop.detectors if d.name in self._quiet.running])
                flown, *_ = onwards(quiet, self._rows, index, k)
                os._exit(flown < n)
            finally:
                os._exit(1)

    def displacement(self, rows: NDArray) -> dict[str, dict]:
        """Return what `achieved` returns, from the rows of the flight flown; {} when no fault acts on an elevator."""
        if not self._segments:
            return {}
        trace, scenario = self._setup.trace, self._setup.scenario
        reference, out = self._reference(rows), {}
        n = min(len(rows), len(reference))
        for segment, faults in self._segments.items():
            i = 2 * list(scenario.aircraft.short).index(segment)
            own = slice(i, i + 2)
            flown = rows[:n, trace.moving[own]] * trace.gains[own]
            apart = flown.astype(float) - reference[:n, own]
            out[segment] = moved(apart, faults, scenario.dt, scenario.aircraft.travel)
        return out

    def _reference(self, rows):
        """Return rods and surfaces (ticks, 2 segments) without the faults [m, rad]; `rows` are those of the flight."""
        child, self._child = self._child, 0
        if child and os.waitpid(child, 0)[1] == 0:
            self._rows[: self._first] = rows[: self._first, self._setup.trace.moving]
            self._keep(self._rows)
        if self._key not in _positions:
            whole = build(self._quiet)
            flown, *_ = fly(whole, keep=(whole.trace.index[whole.trace.moving], np.float32))
            self._keep(flown)
        return _positions[self._key]

    def _keep(self, rows):
        positions = column_store(*rows.shape)
        np.multiply(rows, self._setup.trace.gains, out=positions)
        _positions[self._key] = positions
        if len(_positions) > KEPT:
            del _positions[next(iter(_positions))]

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


def unwatched(scenario: Scenario) -> Scenario:
    """Return `scenario` without detectors but those in the loop: nothing of a user's detectors is run to fly it."""
    own = {name: t for name, t in (scenario.detectors.model_extra or {}).items() if "file" not in t}
    return scenario.model_copy(update={"detectors": type(scenario.detectors)(enabled=(), **own)})
