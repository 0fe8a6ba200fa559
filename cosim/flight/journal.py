"""What a flight in somebody's hands has come to, kept beside its log while it flies: LOG.flown.toml.

A flight that is stepped, or watched live, writes its log when it is closed. Killed before, it leaves this: the scenario
of what was flown, with what was injected and when. The same scenario flies the same bits, so `recover` flies it once
more and writes the log that the flight would have written.
"""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from cosim.errors import CosimError
from cosim.files import replace_text
from cosim.flight.simulate import simulate
from cosim.scenario import load_scenario

EVERY_S = 0.5  # of the wall clock, at least, from one writing to the next
HEAD = "# What a flight had come to when this was written: `cosim recover {log}` flies it again and writes its log.\n"


def beside(log: str | os.PathLike) -> Path:
    """Return where the journal of a log stands."""
    return Path(f"{os.fspath(log)}.flown.toml")


class Journal:
    """Keep what a flight has come to; `log` None: nothing is kept. Raises OutputError where it cannot be begun."""

    def __init__(self, log: str | os.PathLike | None):
        self._path = None if log is None else beside(log)
        self._last = -float("inf")

    def write(self, flown: Callable[[], Any], *, now: bool = False) -> None:
        """Write the scenario `flown()`, unless that was done within EVERY_S and is not asked for `now`."""
        if self._path is None or (not now and time.monotonic() - self._last < EVERY_S):
            return
        text = HEAD.format(log=self._path.name.removesuffix(".flown.toml")) + flown().expanded_toml()
        if self._last < 0.0:
            replace_text(self._path, text)
        else:
            with suppress(CosimError, OSError):  # a disk that is full by now: the flight goes on
                replace_text(self._path, text)
        self._last = time.monotonic()

    def done(self) -> None:
        """Remove it: the log is written."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def recover(log: str | os.PathLike, out: str | os.PathLike, *, progress: Any = None) -> dict[str, Any]:
    """Fly again what the journal of `log` says was flown, write its log to `out`, remove the journal; say what it is.

    Raises ScenarioError for a journal that is none, LogError when `out` cannot be written.
    """
    path = beside(log)
    scenario = load_scenario(str(path))
    result = simulate(scenario, log=out, achieved=True, timed=False, progress=progress)
    path.unlink(missing_ok=True)
    return {"out": os.fspath(out), "flown_again": True, "duration_s": result.sim_time_s, "status": result.status,
            "ticks": round(result.sim_time_s / scenario.dt), "faults": result.faults}  # fmt: skip
