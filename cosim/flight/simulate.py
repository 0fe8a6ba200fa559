"""Fly one scenario: build the loop, fly it, judge the detectors."""

import errno
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext

from cosim.errors import LogError, told_at_call
from cosim.flight.build import Setup, build
from cosim.flight.detection.detectors import left_out
from cosim.flight.faults.conditions import resolved
from cosim.flight.faults.fault_free_reference import Twin
from cosim.flight.fly import fly
from cosim.flight.loop.recorder import open_writer, result_texts
from cosim.flight.plugins.watchdog import ended_by_force, watched
from cosim.judge.result import Result, judge, judged
from cosim.log import LogWriter
from cosim.scenario import Scenario, load_scenario
from cosim.scenario.user_parts import stdout_to_stderr


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
    if not isinstance(scenario, Scenario):
        if not isinstance(scenario, str | os.PathLike):
            raise TypeError(f"{scenario!r} is no scenario: give what cosim.load_scenario returns, a name or a file")
        scenario = load_scenario(scenario)
    assert isinstance(scenario, Scenario)
    scenario = resolved(scenario)
    setup = build(scenario)
    own = [guest.runner for guest in setup.guests]
    with (
        _whose(own),
        open_writer(setup, log) if log else nullcontext() as writer,
        Twin(setup) if achieved else nullcontext() as twin,
    ):
        sinks = [writer] if writer else []
        flown = time.perf_counter()
        hangs = ended_by_force(lambda: _cut_off(writer, setup)) if setup.foreign else nullcontext()
        with stdout_to_stderr() if own else nullcontext(), watched(own) if own else nullcontext(), hangs:
            trace, status, reason = fly(setup, *sinks, progress=progress, pause=twin and twin.pause)
        wall = time.perf_counter() - flown
        result = Result(
            log=str(log) if log else None, status=status, reason=reason, sim_time_s=len(trace) * setup.loop.dt,
            wall_time_s=wall,
            faults=[{"kind": f.kind, "target": f.target, "start_s": f.start_s} for f in scenario.faults],
        )  # fmt: skip
        if timed:
            setup.time_detectors()
        swings = twin.moved(trace) if twin and status != "interrupted" else None
        faults = judged(scenario, swings)
        result.detectors = [judge(w, trace, setup.loop.dt, faults) for w in setup.watches()]
        done = setup.trace.consequences(scenario, trace)
        lost = {name: why.partition(" (")[0] for name, why in left_out(scenario).items()}  # without the remedy's path
        result.extra = {"achieved": swings, "consequences": done, "startup_s": flown - started, "notes": setup.notes,
                        "not_run": lost}  # fmt: skip
        if writer:
            writer.close(result=result_texts(result))
            if result.log != os.fspath(writer.path):
                result.extra["notes"].append(f"{log} stays as it was; the flight so far is {writer.path}")
                result.log = os.fspath(writer.path)
    return result


@contextmanager
def _whose(runners: list) -> Iterator[None]:
    """Name the user's detectors where the log's own file was closed under it."""
    try:
        yield
    except LogError as error:
        if not runners or getattr(error.__cause__, "errno", 0) != errno.EBADF:
            raise
        names = ", ".join(r.guest.DETECTOR.id for r in runners)
        said = f"was closed by code that flew in its flight: {names}"
        raise LogError(said, place=error.place, remedy="A detector closes only files that it has opened") from error


def _cut_off(writer: LogWriter | None, setup: Setup) -> str:
    """Close the log of a flight that hangs in compiled code, and return what is to be said."""
    t = float(setup.loop.bus["clock"]["t"][0])
    why = f"at {t:.2f} s by the user, in a guest that did not return"
    if writer:
        cut = Result(log=str(writer.path), status="interrupted", reason=why, sim_time_s=t, wall_time_s=0.0, faults=[])
        writer.close(result=result_texts(cut))
    return f"interrupted {why}"
