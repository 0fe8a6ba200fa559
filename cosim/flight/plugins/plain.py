"""A plain Python class as a block: one object per lane, stepped with what is measured, its answers checked.

Whatever a guest does, the flight goes on: a lane that raises, answers nonsense or takes longer than its limit for a
step is dropped, its outputs say so, and nothing else is touched.
"""

import functools
import math
import time
from collections import namedtuple
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from actuators.block import dtype, record
from cosim.flight.plugins import contract
from cosim.flight.plugins.watchdog import Overdue
from cosim.scenario import vocabulary
from cosim.scenario.user_parts import short_traceback
from fdi.common.verdict import AMBIGUOUS, NAMES, NONE

LIMIT_S = 0.5  # for one step, by default; a detector's own parameter limit_s changes it
FIRST = 20.0  # so many times as long may the first step of a lane take: models load
OUTPUTS = ("r", "alarm", "verdict", "culprit", "valid", "estimate", "probability", "status")
GOOD, RAISED, NONSENSE, SLOW = 0.0, 1.0, 2.0, 3.0  # of status
QUIET = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # what a lane says that does not say anything
_CODES = {name: float(code) for code, name in enumerate(NAMES)}
_KEYS = {"r", "alarm", "verdict", "culprit", "estimate", "valid"}


class Nonsense(Exception):
    """An answer that cannot be used."""


class PlainDetector:
    """A class as the module of a block: `runner()` makes what steps its lanes."""

    OUTPUTS = OUTPUTS

    def __init__(self, cls: type, file: str, sha256: str):
        """`cls` is a class by the contract; raises GuestError where it is not."""
        self.cls, self.file, self.sha256 = cls, file, sha256
        own, self._defaults = contract.record(cls), contract.parameters(cls)
        self.CULPRITS = ("", *getattr(cls, "culprits", ()))
        units = {field: vocabulary.find(word).unit for field, word in own.inputs.items()}
        self.INPUTS = dtype([(field, "f8", unit) for field, unit in units.items()])
        self.PARAMS = dtype([("limit_s", "f8", "s"), *((name, "f8") for name in self._defaults)])
        estimate = own.estimates[0].unit if own.estimates else "-"
        self.STATE = dtype([(n, "f8", estimate if n == "estimate" else "-") for n in OUTPUTS])
        self.DETECTOR = contract.Detector(**{**vars(own), "fit": lambda site: self.params()})

    def params(self, **values: Any) -> np.ndarray:
        """Return PARAMS: the defaults of __init__, `values` instead."""
        return record(self.PARAMS, **{"limit_s": LIMIT_S, **self._defaults, **values})

    def init(self, p: np.ndarray) -> Any:
        """Return STATE of p's shape: nothing said."""
        return np.zeros(p.shape, self.STATE)

    def runner(self, limited: bool = False, lanes: tuple = ()) -> "Runner":
        """Return what steps the `lanes` of one flight; with `limited` a step that takes too long drops its lane."""
        return Runner(self, limited, lanes)


class Runner:
    """The objects of one flight; called like a block's rollout, and told what became of them.

    A lane whose object misbehaves is dropped, the others go on. `problems` has a sentence for each that was, `notes`
    what one did wrong otherwise.
    """

    def __init__(self, guest: PlainDetector, limited: bool, lanes: tuple = ()):
        self.guest, self.limited, self.lanes = guest, limited, lanes
        self.keeps = False  # whether `told` is filled
        self.problems: list[str] = []
        self.notes: list[str] = []
        self.patience_s = math.inf  # what a step may take where `limited` does not bound it
        self.fatal = ""  # the problem that could have been the process's: no end, no memory
        self.steps, self.seconds = 0, 0.0
        self.told: list[tuple] = []  # (step, lane, {class: probability}) of every answer that gave probabilities
        self._updates: list[Any] = []  # of the lanes' objects
        self._status: list[float] = []
        measured: Any = namedtuple("Measured", tuple(guest.INPUTS.names or ()))  # type: ignore[misc]
        self._make = measured._make
        self._limit, self._dt = math.inf, math.nan
        self._since, self._lane = math.inf, 0  # when the step under way began, and of which lane it is

    def __call__(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, log: np.ndarray | None = None) -> None:
        """Step every lane through every tick; x, p: (lane,), u, log: (lane, tick)."""
        self._start(p, dt)
        rows, given = x.view(np.float64).reshape(len(x), -1), u.view(np.float64).reshape(*u.shape, -1)
        out = None if log is None else log.view(np.float64).reshape(*log.shape, -1)
        for k in range(u.shape[1]):
            for i, row in enumerate(rows):
                self._step(i, row, given[i, k].tolist(), dt)
                if out is not None:
                    out[i, k] = row
            self.steps += 1

    def bound(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float) -> Any:
        """Return a call without arguments that advances every lane by one tick."""
        self._start(p, dt)
        return functools.partial(self, x, u, p, dt)

    def busy_s(self) -> float:
        """Return for how long the step under way has been [s], below 0 while there is none."""
        return time.perf_counter() - self._since

    @property
    def limit_s(self) -> float:
        """Return how long the step under way may take [s]."""
        return min(self.patience_s, self._limit * (1.0 if self.steps else FIRST))

    @property
    def step(self) -> str:
        """Return the name of the step under way."""
        where = f" on {self.lanes[self._lane]}" if self._lane < len(self.lanes) else ""
        return f"{self.guest.DETECTOR.id}: the step at {self.steps * self._dt:.3f} s{where}"

    @property
    def problem(self) -> str:
        """Return what became of the first lane that was dropped, and of how many more; "" when none was."""
        more = len(self.problems) - 1
        return self.problems[0] + (f" (and {more} more lane{'s' * (more > 1)})" if more else "") if more >= 0 else ""

    def _start(self, p, dt):
        if self._status:
            return
        names = [n for n in self.guest.PARAMS.names if n != "limit_s"]
        self._limit, self._dt = float(p["limit_s"][0]) if self.limited else math.inf, dt
        self._status = [GOOD] * len(p)
        for i, own in enumerate(p):
            self._updates.append(None)
            self._since, self._lane = time.perf_counter(), i
            try:
                self._updates[i] = self.guest.cls(dt, **{n: float(own[n]) for n in names}).update
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # whatever user code raises
                self._drop(i, self._why(error), "at its start")
            finally:
                self._since = math.inf

    def _step(self, i, row, values, dt):
        if self._status[i] != GOOD:
            row[:] = (*QUIET, self._status[i])
            return
        t = self.steps * dt
        try:
            self._lane, begin = i, time.perf_counter()
            self._since = begin
            said = self._updates[i](t, self._make(values))
            self._since, took = math.inf, time.perf_counter() - begin
            self.seconds += took
            if said is not None:
                row[:] = self._answer(said, i, t)
        except KeyboardInterrupt:
            self._since = math.inf
            raise
        except BaseException as error:  # whatever user code raises
            self._since = math.inf
            self._drop(i, self._why(error), f"at {t:.3f} s")
            row[:] = (*QUIET, self._status[i])
            return
        if took > self.limit_s:
            said = f"a step took {took:.2f} s, and limit_s is {self._limit:g}"
            self._drop(i, (SLOW, said), f"at {t:.3f} s")
            row[:] = (*QUIET, SLOW)

    def _answer(self, said, i, t):
        if not isinstance(said, Mapping) or not said.keys() <= _KEYS:
            raise Nonsense(f"update returned {said!r:.80}; allowed: a dict of {', '.join(sorted(_KEYS))}, or None")
        r, alarm = _number(said.get("r", 0.0), "r"), _number(said.get("alarm", False), "alarm")
        valid, estimate = _number(said.get("valid", True), "valid"), _number(said.get("estimate", 0.0), "estimate")
        verdict, probability = _verdict(said.get("verdict"), alarm > 0.5)
        if self.keeps and isinstance(said.get("verdict"), Mapping):
            self.told.append((self.steps, i, dict(said["verdict"])))
        culprit = said.get("culprit", "")
        if culprit not in self.guest.CULPRITS:
            raise Nonsense(f"culprit {culprit!r} is not one of its culprits: {', '.join(self.guest.CULPRITS[1:])}")
        if not math.isfinite(r):
            if not self.notes:
                self.notes.append(f"{self.guest.DETECTOR.id}: r = {r} at {t:.3f} s; it counts as not valid while so")
            r, valid = 0.0, 0.0
        code = float(self.guest.CULPRITS.index(culprit))
        on = 1.0 if alarm > 0.5 else 0.0
        return r, on, verdict, code, 1.0 if valid > 0.5 else 0.0, estimate, probability, GOOD

    def _drop(self, i, why, when):
        self._status[i], said = why
        where = f" on {self.lanes[i]}" if i < len(self.lanes) else ""
        self.problems.append(f"{self.guest.DETECTOR.id} is dropped{where} {when}: {said}")

    def _why(self, error):
        """Return (status, sentence) of what ended a step."""
        nonsense, file = isinstance(error, Nonsense), Path(self.guest.file) if self.guest.file else None
        status, said = NONSENSE if nonsense else RAISED, str(error) if nonsense else short_traceback(error, file)
        if isinstance(error, Overdue):
            after = f"{self.limit_s:g} s{said.removeprefix('Overdue')}"
            status, said = SLOW, f"a step was interrupted after {after}, and limit_s is {self._limit:g}"
        if isinstance(error, Overdue | MemoryError):
            self.fatal = f"{self.guest.DETECTOR.id}: {said}"
        return status, said


def _number(value, name):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise Nonsense(f"{name} = {value!r:.60} is no number") from None


def _verdict(verdict, alarm):
    """Return (class code, its probability) of a class, of {class: probability}, or of none given."""
    if verdict is None:
        return (AMBIGUOUS if alarm else NONE), 1.0
    if isinstance(verdict, Mapping):
        if not verdict or not verdict.keys() <= _CODES.keys():
            raise Nonsense(f"verdict {verdict!r:.60}; allowed: {', '.join(NAMES)}")
        best = max(verdict, key=lambda name: _number(verdict[name], f"probability of {name}"))
        p = _number(verdict[best], "probability")
        if not 0.0 <= p <= 1.0 + 1e-6:
            raise Nonsense(f"probability {p} of {best}; allowed: 0 to 1")
        return _CODES[best], p
    if verdict not in _CODES:
        raise Nonsense(f"verdict {verdict!r:.60}; allowed: {', '.join(NAMES)}")
    return _CODES[verdict], 1.0


class GuestBlock:
    """A plain guest in the loop, as `Block` is (cosim/flight/tick.py): `advance()` steps its lanes by one tick."""

    def __init__(
        self, bus: Any, name: str, module: PlainDetector, p: np.ndarray, x0: np.ndarray, dt: float, every: int = 1
    ):
        self.name, self.module, self.p, self.every, self.dt = name, module, p, every, dt * every
        self.x, self.u = bus[name], bus[name + "_in"].reshape(-1, 1)
        self.x[:] = x0
        self.runner = module.runner(limited=True, lanes=bus.lanes[name])
        self.advance = self.runner.bound(self.x, self.u, p, dt * every)
