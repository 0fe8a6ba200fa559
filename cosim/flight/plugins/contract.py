"""What a plain class must have to be a detector, and its record.

    class Parity:
        id, level, technologies = "parity", "local", ("hydraulic",)   # level "aircraft": no technologies
        inputs = ("valve_command", "rod")                             # words of `cosim list signals`, or outputs of
                                                                      # detectors: "iotsekf.left_inner.alarm"
        designed_for = ("ofc_liquid",)                                # optional, as may_see, blind, estimates, culprits

        def __init__(self, dt, threshold=0.003): ...                  # one object per lane; numbers with a default are
                                                                      # parameters that a scenario sets
        def update(self, t, y):                                       # y.rod, y.valve_command: SI, NaN while invalid
            return {"r": 0.3, "alarm": False}

`update` gets the time [s] and the measurements of that time, as a tuple that nobody can write to, and returns a mapping
of some of: r (1 at the threshold), alarm, verdict (a class, or {class: probability}; `cosim list classes`), culprit,
estimate, valid. None says that nothing is new.

A kind of fault (`ofc_liquid`, `rod`) in designed_for, may_see or blind stands for that kind on the detector's own
technologies; what holds a dot or a * is a case pattern as in cosim/judge/coverage.py. What is not declared is called
"not declared".
"""

import inspect
import re
from typing import Any

from cosim.errors import CosimError
from cosim.judge.coverage import true_class
from cosim.scenario import catalog, vocabulary
from fdi.common.record import Detector, Estimate
from fdi.common.verdict import NAMES

BLOCK = ("PARAMS", "INPUTS", "STATE", "OUTPUTS", "CULPRITS", "DETECTOR", "init", "rollout")
OTHER = ("aileron", "rudder", "stabiliser", "engine")  # cases without a technology


class GuestError(CosimError):
    """A guest that is no detector, or a file that is not the one that was meant; `fatal`: it ended its process."""

    fatal = False


def is_block(module: Any) -> bool:
    """Tell whether a module is a block with a detector's record."""
    return all(hasattr(module, name) for name in BLOCK)


def is_guest(value: Any) -> bool:
    """Tell whether `value` is a class that means to be a detector."""
    return inspect.isclass(value) and callable(getattr(value, "update", None)) and hasattr(value, "id")


def parameters(cls: type) -> dict[str, float]:
    """Return {parameter: default} of a guest's __init__ beside `dt`; raises GuestError for a signature that lacks dt or
    has a parameter without a default."""
    own = list(inspect.signature(cls).parameters.values())
    free = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    if not own or (own[0].name != "dt" and own[0].kind not in free):
        raise GuestError("__init__ does not take dt", place=cls.__name__, remedy="def __init__(self, dt): ...")
    rest = [p for p in own[1:] if p.kind not in free]
    if bare := [p.name for p in rest if p.default is p.empty]:
        raise GuestError(f"__init__ has no default for {bare[0]}", place=cls.__name__)
    return {p.name: float(p.default) for p in rest if isinstance(p.default, int | float)}


def record(cls: type) -> Detector:
    """Return the record of a plain class; raises GuestError with what is wrong and what is allowed."""

    def wrong(what, **more):
        return GuestError(what, place=cls.__name__, **more)

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
        try:
            signal = vocabulary.find(word)
        except KeyError as error:
            raise wrong(str(error.args[0]), remedy="`cosim list signals` has them") from None
        if signal.kind == "detector" and signal.technologies and level == "aircraft":
            where = ".left_inner.".join(word.split("."))
            raise wrong(f"inputs: {word!r} is of an actuator", remedy=f'Name the segment: "{where}"')
        if signal.technologies and level == "aircraft" and "." not in word:
            raise wrong(f"inputs: {word!r} is of an actuator", remedy=f'Name the segment: "left_inner.{word}"')
        if signal.technologies and level == "local" and not set(technologies) <= set(signal.technologies):
            raise wrong(f"inputs: {word!r} is of {', '.join(signal.technologies)} only", remedy="Change technologies")
    blind = getattr(cls, "blind", ())
    every = getattr(cls, "every", 1)
    if not isinstance(every, int) or isinstance(every, bool) or every < 1:
        raise wrong(f"every = {every!r}", allowed="a whole number of ticks, 1 or more")
    doc = (inspect.getdoc(cls) or "").strip().splitlines()
    return Detector(
        id=name,
        level=level,
        summary=doc[0].rstrip(".") if doc else "a guest",
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


def _words(cls, name):
    given = getattr(cls, name, ())
    out = (given,) if isinstance(given, str) else tuple(given)
    if not all(isinstance(word, str) for word in out):
        raise GuestError(f"{name} = {given!r}", place=cls.__name__, allowed="words")
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
            raise GuestError(f"{name}: {unknown.pop()!r} is no class", place=cls.__name__, allowed=", ".join(NAMES[1:]))
        known = (*catalog.ALL_KINDS, *catalog.ACTUATOR_SENSORS)
        if not (set(entry) & set(".*@") or entry in OTHER or entry in known):
            raise GuestError(f"{name}: {entry!r} is no kind of fault", place=cls.__name__, allowed=", ".join(known))
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
        raise GuestError(f"estimates = {of!r}", place=cls.__name__,
                         allowed=f"{', '.join(units)}, or a word of `cosim list signals`") from None  # fmt: skip
    return (Estimate(of, "estimate", unit),)
