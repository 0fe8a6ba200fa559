"""Fly one scenario: build the loop, run every tick, watch for departure, judge the detectors."""

import math
import time
from contextlib import nullcontext

import numpy as np

from cosim.build import build
from cosim.result import Result, judge, judged
from cosim.tick import tick

CHECK_EVERY = 10  # ticks between looks at the flight's health: 50 ms
PROGRESS_EVERY = 200

# Beyond these the aerodynamic tables mean nothing and the flight is called departed; each is far outside what the law's protections allow.
LIMITS = {
    "alpha": (math.radians(-20.0), math.radians(35.0)), "beta": (math.radians(-30.0), math.radians(30.0)),
    "phi": (math.radians(-110.0), math.radians(110.0)), "theta": (math.radians(-60.0), math.radians(60.0)),
    "nz": (-3.0, 5.0), "mach": (0.1, 0.99), "h": (0.0, 16_000.0),
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


def simulate(scenario, *, log=None, progress=None, live=None):
    """Fly `scenario` and return a Result.

    `log` is the path of the MCAP file to write, or None for none. `progress(t, duration)` is called now and then. Ctrl-C ends the flight
    with status "interrupted" and a readable log. Raises TrimError when the flight point cannot be flown, LogError when the log cannot be
    written. The wall clock is read for the result only; nothing of it enters the log.
    """
    started = time.perf_counter()
    setup = build(scenario)
    loop, n = setup.loop, setup.ticks
    history = np.full((n, len(setup.history_index)), np.nan)
    status, reason, k = "completed", "", 0
    with setup.open_log(log) if log else nullcontext() as writer:
        append = writer.append if writer else _nowhere
        flown = time.perf_counter()
        try:
            for k in range(n):
                tick(loop, k, append)
                history[k] = loop.v[setup.history_index]
                if k % CHECK_EVERY == 0:
                    bad, why = health(loop.truth)
                    if bad:
                        status, reason = bad, f"at {k * loop.dt:.2f} s {why}"
                        break
                    if progress and k % PROGRESS_EVERY == 0:
                        progress(k * loop.dt, n * loop.dt)
        except KeyboardInterrupt:
            status, reason = "interrupted", f"at {k * loop.dt:.2f} s by the user"
        wall = time.perf_counter() - flown
        result = Result(
            log=str(log) if log else None, status=status, reason=reason, sim_time_s=(k + 1) * loop.dt, wall_time_s=wall,
            faults=[{"kind": f.kind, "target": f.target, "start_s": f.start_s} for f in scenario.faults],
        )
        setup.time_detectors()
        result.detectors = [judge(w, history[: k + 1], loop.dt, judged(scenario)) for w in setup.watches()]
        result.extra = {"achieved": setup.achieved(history[: k + 1]), "startup_s": flown - started}
        if writer:
            writer.close(result=setup.log_result(result))
    return result


def _nowhere(v):
    pass
