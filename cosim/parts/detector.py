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
from collections.abc import Iterable, Mapping
from types import ModuleType, SimpleNamespace
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
GOOD, DROPPED, SLOW = 0.0, 1.0, 3.0  # of status
_CODES = {name: float(code) for code, name in enumerate(NAMES)}
_KEYS = {"r", "alarm", "verdict", "isolated_part", "estimate", "valid"}
_DECLARED = {  # what a class may say of itself, and what holds where it says nothing
    "id": "", "level": "", "technologies": (), "inputs": (), "group": "", "every": 1, "designed_for": (), "may_see": (),
    "blind": (), "estimates": "",
}  # fmt: skip
_ESTIMATED = {"valve": "u", "elevator": "rad", "elevator.left": "rad", "elevator.right": "rad", "thrust": "fraction"}


class PartError(CosimError):
    """A class or module that keeps no detector's contract, or a file whose digest differs from the logged one."""


class TooSlow(PartError):
    """A step that takes longer than its detector may take."""


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
        self.ISOLABLE_PARTS = ("", *_several(getattr(cls, "isolable_parts", ())))
        self.INPUTS = dtype([(field, "f8", vocabulary.find(word).unit) for field, word in own.inputs.items()])
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
                    raise TooSlow(f"a step took {took:.2f} s, and limit_s is {limit:g}")

            return step

        def failed(i, t, error):
            where = f" on {lanes[i]}" if i < len(lanes) else ""
            said = str(error) if isinstance(error, PartError) else sentence(error, self.file)
            made.notes.append(f"{self.DETECTOR.id} is dropped{where} at {t:.3f} s: {said}")
            status = SLOW if isinstance(error, TooSlow) else DROPPED
            return [status if name == "status" else 0.0 for name in OUTPUTS]

        made = PythonBlock(make, failed)
        return made

    def _answer(self, said, t, notes):
        """Return the outputs of an answer; raises PartError for what no detector answers."""
        if not isinstance(said, Mapping) or not said.keys() <= _KEYS:
            allowed = f"a dict of {', '.join(sorted(_KEYS))}, or None"
            raise PartError(f"update returned {said!r:.80}", allowed=allowed)
        given = {"r": 0.0, "alarm": False, "valid": True, "estimate": 0.0, "verdict": None, "isolated_part": "", **said}
        r, alarm, valid, estimate = (_number(given[name], name) for name in ("r", "alarm", "valid", "estimate"))
        verdict, probability = _verdict(given["verdict"], alarm > 0.5)
        if given["isolated_part"] not in self.ISOLABLE_PARTS:
            said = f"isolated_part {given['isolated_part']!r} is not one of its isolable_parts"
            raise PartError(said, allowed=", ".join(self.ISOLABLE_PARTS[1:]))
        if not math.isfinite(r):
            if not notes:
                notes.append(f"{self.DETECTOR.id}: r = {r} at {t:.3f} s; it counts as not valid while so")
            r, valid = 0.0, 0.0
        code = float(self.ISOLABLE_PARTS.index(given["isolated_part"]))
        return r, float(alarm > 0.5), verdict, code, float(valid > 0.5), estimate, probability, GOOD


def _number(value, name):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise PartError(f"{name} = {value!r:.60} is no number") from None


def _verdict(verdict, alarm):
    """Return (class code, its probability) of a class, of {class: probability}, or of none given."""
    if verdict is None:
        return (AMBIGUOUS if alarm else NONE), 1.0
    given = {verdict: 1.0} if isinstance(verdict, str) else verdict
    if not isinstance(given, Mapping) or not given or not given.keys() <= _CODES.keys():
        raise PartError(f"verdict {verdict!r:.60}", allowed=", ".join(NAMES))
    numbers = {name: _number(p, f"probability of {name}") for name, p in given.items()}
    best, p = max(numbers.items(), key=lambda one: one[1])
    if not 0.0 <= p <= 1.0 + 1e-6:
        raise PartError(f"probability {p} of {best}", allowed="0 to 1")
    return _CODES[best], p


def block_detector(module: ModuleType, file: str, sha256: str) -> ModuleType:
    """Return a module that is a block with a detector's record, told where it came from; raises PartError where it is
    none, or does not compile."""
    if not isinstance(module.DETECTOR, Detector):
        raise PartError("DETECTOR is no fdi.common.record.Detector", place=file)
    for word in module.DETECTOR.inputs.values():
        _signal(word, f"{file}: inputs")
    if lacking := {"r", "alarm", "verdict", "isolated_part", "valid"} - set(module.OUTPUTS):
        raise PartError(f"OUTPUTS lacks {', '.join(sorted(lacking))}", place=file)
    if not isinstance(module.rollout, Entry):
        raise PartError("rollout is not compiled", place=file, remedy="rollout = entry(step, STATE, INPUTS, PARAMS)")
    try:
        _ = module.rollout.native.address
    except Exception as error:  # the compiler has dozens of kinds
        said = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise PartError(f"does not compile: {said}", place=file) from None
    vars(module).update(file=file, sha256=sha256)
    return module


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
    said: Any = SimpleNamespace(**{name: getattr(cls, name, default) for name, default in _DECLARED.items()})
    local, inputs = said.level == "local", _several(said.inputs)
    technologies = _several(said.technologies) if local else ()
    every_is = isinstance(said.every, int) and not isinstance(said.every, bool) and said.every >= 1
    for name, good, allowed in (
        ("id", re.fullmatch(r"(?!enabled$)[a-z][a-z0-9_]*", str(said.id)), "lower-case letters, digits and _"),
        ("level", said.level in ("local", "aircraft"), "local, aircraft"),
        ("technologies", bool(technologies) == local and set(technologies) <= {*catalog.TECHNOLOGIES},
         ", ".join(catalog.TECHNOLOGIES)),
        ("inputs", inputs, "words of `cosim list signals`"),
        ("every", every_is, "a whole number of ticks, 1 or more"),
    ):  # fmt: skip
        if not good:
            raise PartError(f"{name} = {getattr(said, name)!r}", place=cls.__name__, allowed=allowed)
    for word in inputs:
        _readable(word, technologies, cls.__name__)
    cases = {name: _cases(getattr(said, name), technologies, f"{cls.__name__}: {name}")
             for name in ("designed_for", "may_see")}  # fmt: skip
    why = said.blind if isinstance(said.blind, str) else ""
    blind_to = ("*",) if why else tuple(_cases(said.blind, technologies, f"{cls.__name__}: blind"))
    of = str(said.estimates)
    unit = _ESTIMATED.get(of) or (of and _signal(of, f"{cls.__name__}: estimates = {of!r}").unit)
    return Detector(
        id=said.id, level=said.level, summary=(inspect.getdoc(cls) or "a user's detector").splitlines()[0].rstrip("."),
        inputs={re.sub(r"\W+", "_", word).strip("_"): word for word in inputs}, technologies=technologies,
        group=str(said.group), **cases, blind=why, blind_to=blind_to,
        estimates=(Estimate(of, "estimate", unit),) if of else (), every=said.every,
    )  # fmt: skip


def _readable(word, technologies, place):
    """Raise PartError unless a detector on these technologies, () at aircraft level, can read a word."""
    signal = _signal(word, place)
    of_actuator = signal.technologies and (signal.kind == "detector" or "." not in word)
    if of_actuator and not technologies:
        where = ".left_inner.".join(word.split(".")) if signal.kind == "detector" else f"left_inner.{word}"
        raise PartError(f"inputs: {word!r} is of an actuator", place=place, remedy=f'Name the segment: "{where}"')
    if signal.technologies and not set(technologies) <= set(signal.technologies):
        said = f"inputs: {word!r} is of {', '.join(signal.technologies)} only"
        raise PartError(said, place=place, remedy="Change technologies")


def _signal(word, place):
    try:
        return vocabulary.find(word)
    except KeyError as error:
        raise PartError(str(error.args[0]), place=place, remedy="`cosim list signals` has them") from None


def _several(words):
    """Return a tuple of one word or of several."""
    return tuple(map(str, [words] if isinstance(words, str) or not isinstance(words, Iterable) else words))


def _cases(given, technologies, place):
    """Return {case pattern: classes that are right} of a tuple of kinds or patterns, or of a mapping to classes."""
    out: dict[str, tuple[str, ...]] = {}
    known = (*catalog.ALL_KINDS, *catalog.ACTUATOR_SENSORS)
    for entry in _several(given):
        classes = _several(given[entry]) if isinstance(given, Mapping) else ()
        if unknown := set(classes) - set(NAMES):
            raise PartError(f"{unknown.pop()!r} is no class", place=place, allowed=", ".join(NAMES[1:]))
        plain = set(entry) & set(".*") or entry in OTHER
        if not plain and entry.partition("@")[0] not in known:
            raise PartError(f"{entry!r} is no kind of fault", place=place, allowed=", ".join(known))
        own = [entry] if plain else [f"{t}.{entry}{at}" for t in technologies or ("*",) for at in ("", "@*")]
        out |= {pattern: classes or (true_class(pattern), "ambiguous") for pattern in own}
    return out
