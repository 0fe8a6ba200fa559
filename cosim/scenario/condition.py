"""When a fault begins: `when = "n_z > 1.2 and t > 5"`. Parsed here, never evaluated as code.

    condition   = comparison, joined by `and` and `or`; `and` binds first, parentheses group
    comparison  = signal (< | <= | > | >=) number

A signal is `t` [s], a word of `cosim list signals` ("n_z", "left_inner.rod": what is measured), a name of the bus
("truth.aircraft.nz", "iotsekf.left_inner.alarm"), or another fault's: `fault.0.active` is 1 while fault 0 is there,
`fault.0.since` the seconds since it began. SI units and radians. A signal that is not valid fulfils nothing, nor does
a fault that has not begun.
"""

import functools
import itertools
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario import vocabulary

if TYPE_CHECKING:
    import numpy as np

TIME = "t"
OF_FAULT = re.compile(r"fault\.(\d{1,4})\.(active|since)")
LONGEST, DEPTH = 2000, 50  # letters; parentheses
COMPARE: dict[str, Callable] = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_TOKEN = re.compile(r"\s*(?:(<=|>=|<|>|\(|\))|([A-Za-z_][\w.\[\]]*)|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))")


@dataclass(frozen=True)
class Comparison:
    """A signal against a number."""

    signal: str
    compare: str
    number: float

    def true(self, values: "Mapping[str, np.ndarray]") -> "np.ndarray":
        """Return at which ticks it holds (ticks,), from {signal: values (ticks,)}."""
        return COMPARE[self.compare](values[self.signal], self.number)

    def signals(self) -> tuple[str, ...]:
        """Return the names of its signals."""
        return (self.signal,)


@dataclass(frozen=True)
class Joined:
    """Conditions of which all ("and") or any ("or") must hold."""

    word: str
    parts: tuple

    def true(self, values: "Mapping[str, np.ndarray]") -> "np.ndarray":
        """Return at which ticks it holds (ticks,)."""
        join = operator.and_ if self.word == "and" else operator.or_
        return functools.reduce(join, (part.true(values) for part in self.parts))

    def signals(self) -> tuple[str, ...]:
        """Return the names of its signals."""
        return tuple(dict.fromkeys(name for part in self.parts for name in part.signals()))


Condition = Comparison | Joined


def condition(text: str) -> Condition:
    """Return the condition that `text` says. Raises ScenarioError with what is wrong."""
    if len(text) > LONGEST:
        place = f"when = {text[:40]!r}..."
        raise ScenarioError(f"is {len(text)} letters long", place=place, allowed=f"up to {LONGEST}")
    tokens, at = [], 0
    while text[at:].strip():
        found = _TOKEN.match(text, at)
        if not found:
            raise _wrong(text, f"{text[at:].strip()[:20]!r} is not understood")
        word = found.group().strip()
        tokens.append(word.lower() if word in ("AND", "OR") else word)
        at = found.end()
    steps = itertools.accumulate({"(": 1, ")": -1}.get(token, 0) for token in tokens)
    if max(steps, default=0) > DEPTH:
        raise _wrong(text, f"more than {DEPTH} parentheses within each other")
    made, rest = _joined("or", tokens, text)
    if rest:
        raise _wrong(text, f"unexpected {rest[0]!r}")
    return made


def _joined(word, tokens, text):
    parts = []
    while True:
        part, tokens = _joined("and", tokens, text) if word == "or" else _single(tokens, text)
        parts.append(part)
        if not tokens or tokens[0] != word:
            return (parts[0] if len(parts) == 1 else Joined(word, tuple(parts))), tokens
        tokens = tokens[1:]


def _single(tokens, text):
    if tokens[:1] == ["("]:
        made, rest = _joined("or", tokens[1:], text)
        if rest[:1] != [")"]:
            raise _wrong(text, "a parenthesis is not closed")
        return made, rest[1:]
    if len(tokens) < 3 or tokens[1] not in COMPARE:
        raise _wrong(text, "a comparison is missing" if not tokens else f"no comparison follows {tokens[0]!r}")
    name, compare, number = tokens[:3]
    try:
        limit = float(number)
    except ValueError:
        raise _wrong(text, f"{number!r} is no number") from None
    return Comparison(_signal(name, text), compare, limit), tokens[3:]


def _signal(name, text):
    if name.startswith("fault.") and not OF_FAULT.fullmatch(name):
        raise _wrong(text, f"{name!r} is no signal", "Say fault.0.active or fault.0.since")
    if name == TIME or name.count(".") > 1:
        return name
    try:
        vocabulary.find(name)
    except KeyError:
        near = did_you_mean(name, [TIME, *vocabulary.words()])
        raise _wrong(text, f"{name!r} is no signal", near or "`cosim list signals` has them") from None
    if vocabulary.words()[name.rpartition(".")[2]].technologies and "." not in name:
        raise _wrong(text, f"{name!r} needs a segment", f"For example left_inner.{name}")
    return name


def other_fault(name: str) -> int | None:
    """Return the number of the fault that a condition's signal is of, None for other signals."""
    found = OF_FAULT.fullmatch(name)
    return int(found[1]) if found else None


def source(name: str) -> str:
    """Return the place on the bus of a condition's signal: of a measured one its value."""
    if name == TIME:
        return "clock.clock.t"
    return name if name.count(".") > 1 else vocabulary.find(name).source


def _wrong(text, problem, remedy=""):
    allowed = "comparisons such as 'n_z > 1.2', joined by and, or"
    return ScenarioError(problem, place=f"when = {text!r}", allowed=allowed, remedy=remedy)
