"""Fly one scenario: build the loop, run every tick, watch for departure, judge the detectors."""

import math
import time
from contextlib import nullcontext

import numpy as np

from cosim.achieved import moved
from cosim.build import build
from cosim.record import open_writer, result_texts
from cosim.result import Result, judge, judged
from cosim.tick import tick

CHECK_EVERY = 10  # ticks between looks at the flight's health: 50 ms
PROGRESS_EVERY = 200

# Beyond these the aerodynamic tables mean nothing and the flight is called departed; each is far outside what the law's
# protections allow.
LIMITS = {
    "alpha": (math.radians(-20.0), math.radians(35.0)),
    "beta": (math.radians(-30.0), math.radians(30.0)),
    "phi": (math.radians(-110.0), math.radians(110.0)),
    "theta": (math.radians(-60.0), math.radians(60.0)),
    "nz": (-3.0, 5.0),
    "mach": (0.1, 0.99),
    "h": (-100.0, 16_000.0),  # a flight along sea level is one
}


def health(truth):
    """Return (status, reason): "diverged" for a number that is none, "departed" outside LIMITS, else ("", "")."""
    for name in truth.dtype.names:
        if not math.isfinite(truth[name]):
            return "diverged", f"{name} is {truth[name]}"
    for name, (low, high) in LIMITS.items():
        if not low <= truth[name] <= high:
            return "departed", f"{name} = {truth[name]:.4g} is outside {low:.4g} to {high:.4g} (SI)"
    return "", ""


def simulate(scenario, *, log=None, progress=None, live=None, achieved=False, timed=True):
    """Fly `scenario` and return a Result.

    `log` is the path of the MCAP file to write, or None. `progress(t, duration)` is called now and then. Ctrl-C ends
    the flight with status "interrupted" and a readable log. With `achieved` the same flight is flown again without its
    faults, and the result says how far the faults moved the elevators (cosim/achieved.py); without `timed` the
    detectors' cost per step is not measured. Raises TrimError when the flight point cannot be flown, LogError when the
    log cannot be written. The wall clock is read for the result only; nothing of it enters the log.
    """
    started = time.perf_counter()
    setup = build(scenario)
    with open_writer(setup, log) if log else nullcontext() as writer:
        flown = time.perf_counter()
        history, status, reason = fly(setup, writer.append if writer else _nowhere, progress)
        wall = time.perf_counter() - flown
        result = Result(
            log=str(log) if log else None,
            status=status,
            reason=reason,
            sim_time_s=len(history) * setup.loop.dt,
            wall_time_s=wall,
            faults=[{"kind": f.kind, "target": f.target, "start_s": f.start_s} for f in scenario.faults],
        )
        if timed:
            setup.time_detectors()
        result.detectors = [judge(w, history, setup.loop.dt, judged(scenario)) for w in setup.watches()]
        result.extra = {
            "achieved": moved(scenario, setup.history, history) if achieved and status != "interrupted" else None,
            "startup_s": flown - started,
        }
        if writer:
            writer.close(result=result_texts(result))
    return result


def record(setup, names):
    """Fly a built flight without a log; return (values (ticks, names) of the named bus signals, status, reason)."""
    index = np.array([setup.loop.bus.index(n) for n in names])
    rows, status, reason = fly(setup, keep=(index, np.float64))
    if status == "interrupted":
        raise KeyboardInterrupt
    return rows, status, reason


def fly(setup, append=None, progress=None, keep=None):
    """Run every tick of a built flight; return (history of the ticks flown, status, reason).

    `append(v)` takes the bus of each tick; `keep` says what of it becomes history, (positions, dtype), by default what
    the judgement needs.
    """
    loop, n = setup.loop, setup.ticks
    index, kind = keep or (setup.history.index, np.float32)
    history = np.empty((n, len(index)), kind)  # pages are taken as the flight goes on
    append = append or _nowhere
    k = 0
    try:
        for k in range(n):
            tick(loop, k, append)
            history[k] = loop.v[index]
            if k % CHECK_EVERY == 0:
                bad, why = health(loop.truth)
                if bad:
                    return history[: k + 1], bad, f"at {k * loop.dt:.2f} s {why}"
                if progress and k % PROGRESS_EVERY == 0:
                    progress(k * loop.dt, n * loop.dt)
    except KeyboardInterrupt:
        return history[: k + 1], "interrupted", f"at {k * loop.dt:.2f} s by the user"
    return history, "completed", ""


def _nowhere(v):
    pass
