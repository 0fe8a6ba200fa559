"""Crash journal of an interactive flight, beside its log while it flies: LOG.flown.toml.

A flight that is stepped, or watched live, writes its log when it is closed. Killed before, it leaves this: the scenario
of what was flown, with what was injected and when. The same scenario flies the same bits, so `recover` flies it once
more and writes the log that the flight would have written.
"""

import os
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

from cosim.errors import CosimError, OutputError, ScenarioError
from cosim.files import OTHER, TAKEN, claim, left_by, locked, replace, replace_text
from cosim.log.format import OURS
from cosim.log.log_file import free
from cosim.scenario import load_scenario

EVERY_S = 0.5  # of the wall clock, at least, from one writing to the next
HEAD = "# What a flight had come to when this was written: `cosim recover {log}` flies it again and writes its log.\n"


def beside(log: str | os.PathLike) -> Path:
    """Return where the journal of a log stands."""
    return Path(f"{os.fspath(log)}.flown.toml")


def absent(log: str | os.PathLike) -> None:
    """Raise OutputError where a log has a journal, or a part: a flight to it is in the air, or was killed there."""
    _landed(log)
    claim(log, OURS)
    free(log)
    if beside(log).is_file():
        remedy = f"`cosim recover {log}` makes its log; or choose another -o"
        raise OutputError("a flight that was killed, or not closed, left its journal", place=str(log), remedy=remedy)


def _landed(log):
    """Raise OutputError while the flight whose journal stands beside `log` is in the air."""
    with suppress(OSError), beside(log).open("rb") as file:
        if not locked(file):
            raise OutputError(TAKEN, place=str(log), remedy=OTHER)


class Journal:
    """Keep what a flight has come to; `log` None: nothing is kept.

    While it is kept, no other flight goes to the same log. Raises OutputError where it cannot be begun, or another
    flight's is there.
    """

    def __init__(self, log: str | os.PathLike | None):
        self._path = None if log is None else beside(log)
        self._lock: Any = None
        self._last = -float("inf")
        if log is not None:
            absent(log)

    def write(self, flown: Callable[[], Any], *, now: bool = False) -> None:
        """Write the scenario `flown()`, unless that was done within EVERY_S and is not asked for `now`."""
        if self._path is None or (not now and time.monotonic() - self._last < EVERY_S):
            return
        text = HEAD.format(log=self._path.name.removesuffix(".flown.toml")) + flown().expanded_toml()
        first = self._last < 0.0
        if first:
            absent(str(self._path).removesuffix(".flown.toml"))  # another flight may have begun since
        self._release()
        with nullcontext() if first else suppress(CosimError, OSError):  # a disk that is full by now: it flies on
            replace_text(self._path, text)
        with suppress(OSError):  # a lock on the file, another one after each writing, that goes free with the process
            self._lock = open(str(self._path), "rb")
            locked(self._lock)
        self._last = time.monotonic()

    def __del__(self):
        self._release()

    def _release(self):
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def done(self) -> None:
        """Remove it: the log is written. One of another flight, or none of which a tick was kept, stays."""
        if self._path is not None and self._last > 0.0:
            self._path.unlink(missing_ok=True)
            self._release()
            self._last = -float("inf")


def recover(
    log: str | os.PathLike, out: str | os.PathLike, *, trust: bool = False, progress: Any = None
) -> dict[str, Any]:
    """Fly again what the journal of `log` says was flown, write its log to `out`, remove the journal; say what it is.

    Code that it names runs only with `trust`: a journal is found beside a log, and may come from another user.
    Interrupted, it raises KeyboardInterrupt: the journal stays, and what is at `out`. Raises ScenarioError for a
    file that is no journal, or that names code, OutputError or LogError when `out` cannot be written, or the flight is
    in the air.
    """
    path = beside(log)
    _landed(log)
    scenario = load_scenario(str(path))
    if scenario.code and not trust:
        named = ", ".join(f"{file.name}, sha256 {file.sha256 or 'unknown'}" for file in scenario.code)
        raise ScenarioError(f"names code: {named}", place=str(path), remedy="Read it, then add --trust")
    result = replace(os.fspath(out), lambda part: _whole(scenario, part, progress))
    for done in (path, left_by(log)):
        done.unlink(missing_ok=True)
    return {"out": os.fspath(out), "flown_again": True, "duration_s": result.sim_time_s, "status": result.status,
            "ticks": round(result.sim_time_s / scenario.dt), "faults": result.faults}  # fmt: skip


def _whole(scenario, part, progress):
    from cosim.flight.simulate import simulate  # a look for a journal needs no loop

    result = simulate(scenario, log=part, achieved=True, timed=False, progress=progress)
    if result.status == "interrupted":
        raise KeyboardInterrupt
    return result
