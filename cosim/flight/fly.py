"""Fly a built flight: run every tick, watch for departure, keep what is asked for."""

import functools
import math
from collections.abc import Sequence
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


def health(truth: np.ndarray) -> tuple[str, str]:
    """Return (status, reason) of a record of truth (1,).

    "diverged" where a number is not finite, "departed" outside LIMITS, else ("", "").
    """
    low, high = _bounds(truth.dtype)
    v = truth.view("f8")
    if ((v >= low) & (v <= high)).all():  # False for what is no number
        return "", ""
    now = dict(zip(truth.dtype.names or (), v.tolist()))
    for name, value in now.items():
        if not math.isfinite(value):
            return "diverged", f"{name} is {value}"
    name, (low, high) = next((n, (low, high)) for n, (low, high) in LIMITS.items() if not low <= now[n] <= high)
    return "departed", f"{name} = {now[name]:.4g} is outside {low:.4g} to {high:.4g} (SI)"


@functools.cache
def _bounds(kind):
    """Return what every field of the truth may be: LIMITS, or any number."""
    most = np.finfo(float).max
    return np.array([LIMITS.get(name, (-most, most)) for name in kind.names]).T


def record(setup: Any, names: Sequence[Any]) -> tuple[np.ndarray, str, str]:
    """Fly a built flight without a log; return (values (ticks, names) of the named bus signals, status, reason)."""
    index = np.array([setup.loop.bus.index(n) for n in names])
    return fly(setup, keep=(index, np.float64))


def fly(setup: Any, *logs: Any, progress: Any = None, keep: Any = None) -> tuple:
    """Run every tick of a built flight; return (trace of the ticks flown, status, reason).

    `logs` take the bus of each tick (cosim/flight/tick.py). The trace is an array (ticks, columns) of what the
    judgement needs (cosim/judge/store.py), or of `keep` (positions, dtype). `progress(t, end)` is called now and then.
    Raises KeyboardInterrupt for one with `keep` that is interrupted: a part of it serves nobody.
    """
    loop, n = setup.loop, setup.scenario.ticks
    index, kind = keep or (setup.trace.index, np.float32)
    trace, rows = column_store(n, len(index), kind), np.empty((min(n, SPAN), len(index)))
    tape = order(loop, *logs, keep=(index, rows))
    flown, status, reason = 0, "", ""
    while flown < n and not status:
        first = flown
        flown, status, reason = advance(loop, tape, range(first, min(first + SPAN, n)), progress, n)
        trace[first:flown] = rows[: flown - first]
        release(trace)
    if keep and status == "interrupted":
        raise KeyboardInterrupt
    return trace[:flown], status or "completed", reason


def advance(loop: Loop, tape: Tape, ticks: range, progress: Any = None, n: int = 0) -> tuple[int, str, str]:
    """Run some ticks, of a flight of `n`; return (the tick after the last one flown, status, reason): "" where the
    flight goes on, "departed", "diverged", or "interrupted" by Ctrl-C."""
    whole, truth = ticks.start, loop.bus["truth"]
    try:
        for k in ticks:
            tape.run(k)
            whole = k + 1
            if k % CHECK_EVERY == 0:
                bad, why = health(truth)
                if bad:
                    return whole, bad, f"at {k * loop.dt:.2f} s {why}"
                if progress and k % PROGRESS_EVERY == 0:
                    progress(k * loop.dt, n * loop.dt)
    except KeyboardInterrupt:
        return whole, "interrupted", f"at {whole * loop.dt:.2f} s by the user"
    return whole, "", ""
