"""Fly one scenario: build the loop, fly it, judge the detectors."""

import os
import time
from collections.abc import Callable
from contextlib import nullcontext

from cosim.errors import told_at_call
from cosim.flight.build import build
from cosim.flight.detection.detectors import left_out
from cosim.flight.faults.conditions import resolved
from cosim.flight.faults.fault_free_reference import displacement
from cosim.flight.fly import fly
from cosim.flight.loop.recorder import open_writer, result_texts
from cosim.judge.result import Result, judge, judged
from cosim.scenario import Scenario, load_scenario


@told_at_call
def simulate(
    scenario: Scenario | str | os.PathLike, *, log: str | os.PathLike | None = None,
    progress: Callable[[float, float], None] | None = None, achieved: bool = False, timed: bool = True,
) -> Result:  # fmt: skip
    """Fly `scenario`, a Scenario or what load_scenario takes, and return a Result.

    `log` is the path of the MCAP file to write, or None. `progress(t, duration)` is called now and then. Ctrl-C ends
    the flight with status "interrupted" and a readable log. With `achieved` the same flight is flown again without its
    faults, and the result says how far the faults moved the elevators (cosim/flight/faults/fault_free_reference.py);
    without `timed` the detectors' cost per step is not measured. Raises TrimError when the flight point cannot be
    flown, LogError when the log cannot be written. The wall clock is read for the result only; nothing of it enters the
    log.
    """
    started = time.perf_counter()
    if not isinstance(scenario, Scenario | str | os.PathLike):
        raise TypeError(f"{scenario!r} is no scenario: give what cosim.load_scenario returns, a name or a file")
    scenario = resolved(scenario if isinstance(scenario, Scenario) else load_scenario(scenario))
    setup = build(scenario)
    with open_writer(setup, log) if log else nullcontext() as writer:
        flown = time.perf_counter()
        trace, status, reason = fly(setup, writer, progress=progress)
        result = Result(
            log=str(log) if log else None, status=status, reason=reason, sim_time_s=len(trace) * setup.loop.dt,
            wall_time_s=time.perf_counter() - flown,
            faults=[{"kind": f.kind, "target": f.target, "start_s": f.start_s} for f in scenario.faults],
        )  # fmt: skip
        swings = displacement(setup, trace) if achieved and status != "interrupted" else None
        faults = judged(scenario, swings)
        result.detectors = [judge(w, trace, setup.loop.dt, faults) for w in setup.judged_lanes(timed)]
        lost = {name: why.partition(" (")[0] for name, why in left_out(scenario).items()}  # without the remedy's path
        result.extra = {"achieved": swings, "consequences": setup.trace.consequences(scenario, trace),
                        "startup_s": flown - started, "notes": setup.notes, "not_run": lost}  # fmt: skip
        if writer:
            writer.close(result=result_texts(result))
            if result.log != os.fspath(writer.path):
                result.extra["notes"].append(f"{log} stays as it was; the flight so far is {writer.path}")
                result.log = os.fspath(writer.path)
    return result
