"""A user detector: what a plain Python class must have, its record, and how it becomes a block.

    class Parity:
        id, level, technologies = "parity", "local", ("hydraulic",)   # level "aircraft": no technologies
        inputs = ("valve_command", "rod")                             # words of `cosim list signals`, or outputs of
                                                                      # detectors: "iotsekf.left_inner.alarm"
        designed_for = ("ofc_liquid",)                                # optional, as may_see, blind, estimates,
                                                                      # isolable_parts

        def __init__(self, dt, threshold=0.003): ...                  # one object per lane; numbers with a default are
                                                                      # parameters that a scenario sets
        def update(self, t, y):                                       # y.rod, y.valve_command: SI, NaN while invalid
            return {"r": 0.3, "alarm": False}

`update` gets the time [s] and the measurements of that time, as a tuple that nobody can write to, and returns a mapping
of some of: r (1 at the threshold), alarm, verdict (a class, or {class: probability}; `cosim list classes`),
isolated_part, estimate, valid. None says that nothing is new.

A kind of fault (`ofc_liquid`, `rod`) in designed_for, may_see or blind stands for that kind on the detector's own
technologies; what holds a dot or a * is a case pattern as in cosim/judge/coverage.py. What is not declared is called
"not declared".
"""

import inspect
import math
import re
import time
from collections import namedtuple
from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np

from actuators.block import Entry, dtype, record
from actuators.exception_text import sentence
from actuators.python_block import PythonBlock
from cosim.errors import CosimError
from cosim.judge.coverage import true_class
from cosim.scenario import catalog, vocabulary
from fdi.common.record import Detector, Estimate
from fdi.common.verdict import AMBIGUOUS, NAMES, NONE

BLOCK = ("PARAMS", "INPUTS", "STATE", "OUTPUTS", "ISOLABLE_PARTS", "DETECTOR", "init", "rollout")
OTHER = ("aileron", "rudder", "stabiliser", "engine")  # cases without a technology
LIMIT_S = 0.5  # for one step, by default; a detector's own parameter limit_s changes it
FIRST = 20.0  # so many times as long may the first step of a lane take: models load
OUTPUTS = ("r", "alarm", "verdict", "isolated_part", "valid", "estimate", "probability", "status")
GOOD, RAISED, NONSENSE, SLOW = 0.0, 1.0, 2.0, 3.0  # of status
_CODES = {name: float(code) for code, name in enumerate(NAMES)}
_KEYS = {"r", "alarm", "verdict", "isolated_part", "estimate", "valid"}


class PartError(CosimError):
    """A class or module that keeps no detector's contract, or a file whose digest differs from the logged one."""


class _Drop(Exception):
    """Why a lane is dropped that raised nothing itself: its status, and a sentence."""

    def __init__(self, status: float, said: str):
        super().__init__(said)
        self.status = status


def is_block(module: Any) -> bool:
    """Tell whether a module is a block with a detector's record."""
    return all(hasattr(module, name) for name in BLOCK)


def is_detector_class(value: Any) -> bool:
    """Tell whether `value` is a class that means to be a detector."""
    return inspect.isclass(value) and callable(getattr(value, "update", None)) and hasattr(value, "id")


class PlainDetector:
    """A class as the module of a block."""

    OUTPUTS = OUTPUTS

    def __init__(self, cls: type, file: str, sha256: str):
        """`cls` is a class by the contract; raises PartError where it is not."""
        self.cls, self.file, self.sha256 = cls, file, sha256
        own, self._defaults = record_of(cls), parameters(cls)
        self.ISOLABLE_PARTS = ("", *getattr(cls, "isolable_parts", ()))
        units = {field: vocabulary.find(word).unit for field, word in own.inputs.items()}
        self.INPUTS = dtype([(field, "f8", unit) for field, unit in units.items()])
        self.PARAMS = dtype([("limit_s", "f8", "s"), *((name, "f8") for name in self._defaults)])
        estimate = own.estimates[0].unit if own.estimates else "-"
        self.STATE = dtype([(n, "f8", estimate if n == "estimate" else "-") for n in OUTPUTS])
        self.DETECTOR = Detector(**{**vars(own), "fit": lambda site: self.params()})

    def params(self, **values: Any) -> np.ndarray:
        """Return PARAMS: the defaults of __init__, `values` instead."""
        return record(self.PARAMS, **{"limit_s": LIMIT_S, **self._defaults, **values})

    def init(self, p: np.ndarray) -> Any:
        """Return STATE of p's shape: nothing said."""
        return np.zeros(p.shape, self.STATE)

    def runner(self, lanes: tuple = (), *, limited: bool = False) -> PythonBlock:
        """Return the rollout of one flight, on `lanes`: one object each; `limited`, a step that takes longer than the
        detector's limit_s [s] drops its lane."""
        measured: Any = namedtuple("Measured", tuple(self.INPUTS.names or ()))  # type: ignore[misc]

        def make(p, dt):
            given = {name: type(own)(p[name]) if p[name] % 1 == 0 else float(p[name])  # as its default is
                     for name, own in self._defaults.items()}  # fmt: skip
            update = self.cls(dt, **given).update
            limit = float(p["limit_s"]) if limited else math.inf

            def step(t, x, u):
                begin = time.perf_counter()
                said = update(t, measured._make(u.tolist()))
                took = time.perf_counter() - begin
                made.seconds += took
                if said is not None:
                    x[:] = self._answer(said, t, made.notes)
                if took > limit and (t > 0.0 or took > FIRST * limit):
                    raise _Drop(SLOW, f"a step took {took:.2f} s, and limit_s is {limit:g}")

            return step

        def failed(i, t, error):
            where = f" on {lanes[i]}" if i < len(lanes) else ""
            said = str(error) if isinstance(error, _Drop) else sentence(error, self.file)
            made.notes.append(f"{self.DETECTOR.id} is dropped{where} at {t:.3f} s: {said}")
            return [getattr(error, "status", RAISED) if name == "status" else 0.0 for name in OUTPUTS]

        made = PythonBlock(make, failed)
        return made

    def _answer(self, said, t, notes):
        """Return the outputs of an answer; raises _Drop for nonsense."""
        if not isinstance(said, Mapping) or not said.keys() <= _KEYS:
            allowed = f"a dict of {', '.join(sorted(_KEYS))}, or None"
            raise _Drop(NONSENSE, f"update returned {said!r:.80}; allowed: {allowed}")
        r, alarm, valid, estimate = (
            _number(said.get(name, other), name)
            for name, other in (("r", 0.0), ("alarm", False), ("valid", True), ("estimate", 0.0))
        )
        verdict, probability = _verdict(said.get("verdict"), alarm > 0.5)
        isolated_part = said.get("isolated_part", "")
        if isolated_part not in self.ISOLABLE_PARTS:
            allowed = ", ".join(self.ISOLABLE_PARTS[1:])
            raise _Drop(NONSENSE, f"isolated_part {isolated_part!r} is not one of its isolable_parts: {allowed}")
        if not math.isfinite(r):
            if not notes:
                notes.append(f"{self.DETECTOR.id}: r = {r} at {t:.3f} s; it counts as not valid while so")
            r, valid = 0.0, 0.0
        code, on = float(self.ISOLABLE_PARTS.index(isolated_part)), float(alarm > 0.5)
        return r, on, verdict, code, float(valid > 0.5), estimate, probability, GOOD


def _number(value, name):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise _Drop(NONSENSE, f"{name} = {value!r:.60} is no number") from None


def _verdict(verdict, alarm):
    """Return (class code, its probability) of a class, of {class: probability}, or of none given."""
    if verdict is None:
        return (AMBIGUOUS if alarm else NONE), 1.0
    given = {verdict: 1.0} if isinstance(verdict, str) else verdict
    if not isinstance(given, Mapping) or not given or not given.keys() <= _CODES.keys():
        raise _Drop(NONSENSE, f"verdict {verdict!r:.60}; allowed: {', '.join(NAMES)}")
    best = max(given, key=lambda name: _number(given[name], f"probability of {name}"))
    p = _number(given[best], "probability")
    if not 0.0 <= p <= 1.0 + 1e-6:
        raise _Drop(NONSENSE, f"probability {p} of {best}; allowed: 0 to 1")
    return _CODES[best], p


class BlockDetector:
    """A module that is a block with a detector's record, and where it came from."""

    def __init__(self, module: ModuleType, file: str, sha256: str):
        """Raises PartError where it is none, or does not compile."""
        self._module, self.file, self.sha256 = module, file, sha256
        if not isinstance(module.DETECTOR, Detector):
            raise PartError("DETECTOR is no fdi.common.record.Detector", place=file)
        for word in module.DETECTOR.inputs.values():
            _signal(word, f"{file}: inputs")
        if lacking := {"r", "alarm", "verdict", "isolated_part", "valid"} - set(module.OUTPUTS):
            raise PartError(f"OUTPUTS lacks {', '.join(sorted(lacking))}", place=file)
        if not isinstance(module.rollout, Entry):
            remedy = "rollout = entry(step, STATE, INPUTS, PARAMS)"
            raise PartError("rollout is not compiled", place=file, remedy=remedy)
        try:
            _ = module.rollout.native.address
        except Exception as error:  # the compiler has dozens of kinds
            said = " ".join(f"{type(error).__name__}: {error}".split())[:300]
            raise PartError(f"does not compile: {said}", place=file) from None

    def __getattr__(self, name):
        return getattr(self._module, name)


def rollout_of(module: Any, lanes: tuple = (), *, limited: bool = False) -> Any:
    """Return what steps the lanes of a detector in one flight or replay: its rollout, or objects of its own."""
    return module.runner(lanes, limited=limited) if hasattr(module, "runner") else module.rollout


def parameters(cls: type) -> dict[str, float]:
    """Return {parameter: default} of a detector's __init__ beside `dt`; raises PartError for a signature that lacks dt
    or has a parameter without a default."""
    own = list(inspect.signature(cls).parameters.values())
    free = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    if not own or (own[0].name != "dt" and own[0].kind not in free):
        raise PartError("__init__ does not take dt", place=cls.__name__, remedy="def __init__(self, dt): ...")
    rest = [p for p in own[1:] if p.kind not in free]
    if bare := [p.name for p in rest if p.default is p.empty]:
        raise PartError(f"__init__ has no default for {bare[0]}", place=cls.__name__)
    return {p.name: p.default for p in rest if isinstance(p.default, int | float)}


def record_of(cls: type) -> Detector:
    """Return the record of a plain class; raises PartError with what is wrong and what is allowed."""

    def wrong(what, **more):
        return PartError(what, place=cls.__name__, **more)

    name, level = getattr(cls, "id", None), getattr(cls, "level", None)
    if not isinstance(name, str) or not re.fullmatch(r"[a-z][a-z0-9_]*", name) or name == "enabled":
        raise wrong(f"id = {name!r}", allowed="lower-case letters, digits and _")
    if level not in ("local", "aircraft"):
        raise wrong(f"level = {level!r}", allowed="local, aircraft")
    technologies = _words(cls, "technologies") if level == "local" else ()
    if level == "local" and (not technologies or set(technologies) - set(catalog.TECHNOLOGIES)):
        raise wrong(f"technologies = {technologies!r}", allowed=", ".join(catalog.TECHNOLOGIES))
    inputs = _words(cls, "inputs")
    if not inputs:
        raise wrong("inputs is empty", allowed="words of `cosim list signals`")
    for word in inputs:
        signal = _signal(word, cls.__name__)
        of_actuator = signal.kind == "detector" or "." not in word  # where it has technologies
        if signal.technologies and level == "aircraft" and of_actuator:
            where = ".left_inner.".join(word.split(".")) if signal.kind == "detector" else f"left_inner.{word}"
            raise wrong(f"inputs: {word!r} is of an actuator", remedy=f'Name the segment: "{where}"')
        if signal.technologies and level == "local" and not set(technologies) <= set(signal.technologies):
            raise wrong(f"inputs: {word!r} is of {', '.join(signal.technologies)} only", remedy="Change technologies")
    blind, every = getattr(cls, "blind", ()), getattr(cls, "every", 1)
    if not isinstance(every, int) or isinstance(every, bool) or every < 1:
        raise wrong(f"every = {every!r}", allowed="a whole number of ticks, 1 or more")
    doc = (inspect.getdoc(cls) or "").strip().splitlines()
    return Detector(
        id=name,
        level=level,
        summary=doc[0].rstrip(".") if doc else "a user's detector",
        inputs={re.sub(r"\W+", "_", word).strip("_"): word for word in inputs},
        technologies=technologies,
        group=str(getattr(cls, "group", "")),
        designed_for=_cases(cls, "designed_for", technologies),
        may_see=_cases(cls, "may_see", technologies),
        blind=blind if isinstance(blind, str) else "",
        blind_to=("*",) if isinstance(blind, str) and blind else tuple(_cases(cls, "blind", technologies)),
        estimates=_estimates(cls),
        every=every,
    )


def _signal(word, place):
    try:
        return vocabulary.find(word)
    except KeyError as error:
        raise PartError(str(error.args[0]), place=place, remedy="`cosim list signals` has them") from None


def _words(cls, name):
    given = getattr(cls, name, ())
    out = (given,) if isinstance(given, str) else tuple(given)
    if not all(isinstance(word, str) for word in out):
        raise PartError(f"{name} = {given!r}", place=cls.__name__, allowed="words")
    return out


def _cases(cls, name, technologies):
    """Return {case pattern: classes that are right} of a tuple of kinds or patterns, or of a mapping to classes."""
    given, out = getattr(cls, name, ()), {}
    if isinstance(given, str):
        return {} if name == "blind" else _cases(type(cls.__name__, (), {name: (given,)}), name, technologies)
    for entry in given:
        classes = given[entry] if isinstance(given, dict) else None
        classes = (classes,) if isinstance(classes, str) else classes
        if classes and (unknown := set(classes) - set(NAMES)):
            raise PartError(f"{name}: {unknown.pop()!r} is no class", place=cls.__name__, allowed=", ".join(NAMES[1:]))
        known = (*catalog.ALL_KINDS, *catalog.ACTUATOR_SENSORS)
        if not (set(entry) & set(".*@") or entry in OTHER or entry in known):
            raise PartError(f"{name}: {entry!r} is no kind of fault", place=cls.__name__, allowed=", ".join(known))
        plain = set(entry) & set(".*") or entry in OTHER
        patterns = [entry] if plain else [f"{t}.{entry}{at}" for t in technologies or ("*",) for at in ("", "@*")]
        for pattern in patterns:
            out[pattern] = tuple(classes) if classes else (true_class(pattern), "ambiguous")
    return out


def _estimates(cls):
    of = getattr(cls, "estimates", "")
    if not of:
        return ()
    units = {"valve": "u", "elevator": "rad", "elevator.left": "rad", "elevator.right": "rad", "thrust": "fraction"}
    try:
        unit = units[of] if of in units else vocabulary.find(of).unit
    except (KeyError, TypeError):
        raise PartError(f"estimates = {of!r}", place=cls.__name__,
                         allowed=f"{', '.join(units)}, or a word of `cosim list signals`") from None  # fmt: skip
    return (Estimate(of, "estimate", unit),)
