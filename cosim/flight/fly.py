"""Fly a built flight: run every tick, watch for departure, keep what is asked for."""

import functools
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from cosim.flight.loop.tape import Tape
from cosim.flight.tick import Loop, order
from cosim.judge.store import column_store, release

CHECK_EVERY = 10  # ticks between looks at the flight's health: 50 ms
PROGRESS_EVERY = 200
SPAN = 4000  # ticks that are stored at once

# Beyond these the aerodynamic tables mean nothing and the flight is called departed; each is far outside what the law's
# protections allow.
LIMITS = {
    "alpha": (math.radians(-20.0), math.radians(35.0)),
    "beta": (math.radians(-30.0), math.radians(30.0)),
    "phi": (math.radians(-110.0), math.radians(110.0)),
    "theta": (math.radians(-60.0), math.radians(60.0)),
    "nz": (-3.0, 5.0),
    "mach": (0.1, 0.99),
    "h": (-100.0, 16_000.0),  # along sea level an aircraft still flies
}


def health(truth: Any) -> tuple[str, str]:
    """Return (status, reason) of a record of truth.

    "diverged" where a number is not finite, "departed" outside LIMITS, else ("", "").
    """
    if _inside(np.asarray(truth).reshape(1))():
        return "", ""
    for name in truth.dtype.names:
        if not math.isfinite(truth[name]):
            return "diverged", f"{name} is {truth[name]}"
    for name, (low, high) in LIMITS.items():
        if not low <= truth[name] <= high:
            return "departed", f"{name} = {truth[name]:.4g} is outside {low:.4g} to {high:.4g} (SI)"
    return "", ""


def _inside(truth):
    """Return a call that tells whether every number of the record in `truth` (1,) is within its bounds."""
    low, high = _bounds(truth.dtype)
    v = truth.view("f8")
    return lambda: ((v >= low) & (v <= high)).all()  # False for what is no number


@functools.cache
def _bounds(kind):
    """Return what every field of the truth may be: LIMITS, or any number."""
    most = np.finfo(float).max
    return np.array([LIMITS.get(name, (-most, most)) for name in kind.names]).T


def record(setup: Any, names: Sequence[Any]) -> tuple[np.ndarray, str, str]:
    """Fly a built flight without a log; return (values (ticks, names) of the named bus signals, status, reason)."""
    index = np.array([setup.loop.bus.index(n) for n in names])
    rows, status, reason = fly(setup, keep=(index, np.float64))
    if status == "interrupted":
        raise KeyboardInterrupt
    return rows, status, reason


def fly(setup: Any, *logs: Any, progress: Any = None, keep: Any = None, pause: Any = None) -> tuple:
    """Run every tick of a built flight; return (trace of the ticks flown, status, reason).

    `logs` take the bus of each tick (cosim/flight/tick.py). The trace is an array (ticks, columns) of what the
    judgement needs (cosim/judge/store.py), or of `keep` (positions, dtype). `pause` is (tick, call): `call(tick)`
    before that one is flown. `progress(t, end)` is called now and then.
    """
    index, kind = keep or (setup.trace.index, np.float32)
    trace = column_store(setup.ticks, len(index), kind)
    flown, status, reason = onwards(setup.loop, trace, index, 0, *logs, progress=progress, pause=pause)
    return trace[:flown], status or "completed", reason


def onwards(
    loop: Loop, trace: np.ndarray, index: np.ndarray, first: int, *logs: Any, progress: Any = None, pause: Any = None
) -> tuple[int, str, str]:
    """Fly a loop from tick `first` to the end of `trace` (ticks, n), whose rows take the positions `index` of the bus.

    The rest is as for `fly`. Return (ticks flown since the start, status, reason), "" to the end.
    """
    n = len(trace)
    rows, tape = np.empty((min(n, SPAN), len(index))), Tape(loop.v, loop.dt)
    order(loop, tape, *logs, keep=(index, rows))
    stop, call = pause or (n, lambda k: None)
    flown, status, reason = first, "", ""
    for a, b in pairwise(sorted({first, *range(first - first % SPAN + SPAN, n, SPAN), stop, n})):
        if a == stop:
            call(stop)
        flown, status, reason = _span(loop, tape, range(a, b), progress, n)
        trace[a:flown] = rows[a % SPAN :][: flown - a]
        release(trace)
        if status:
            break
    if stop == n and not status:
        call(stop)
    return flown, status, reason


def _span(loop, tape, ticks, progress, n):
    """Run these ticks by a tape; return what `onwards` does."""
    whole = ticks.start
    inside = _inside(loop.bus["truth"])
    try:
        for k in ticks:
            tape.run(k)
            whole = k + 1
            if k % CHECK_EVERY == 0:
                if not inside():
                    bad, why = health(loop.truth)
                    return whole, bad, f"at {k * loop.dt:.2f} s {why}"
                if progress and k % PROGRESS_EVERY == 0:
                    progress(k * loop.dt, n * loop.dt)
    except KeyboardInterrupt:
        return whole, "interrupted", f"at {whole * loop.dt:.2f} s by the user"
    return whole, "", ""
