"""Errors a user can cause and mend: each says where, what, what is allowed, and what to do.

Library functions raise them, only the command line prints them (exit status 2) and nobody sees a traceback.
"""

import difflib
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

FULL = "COSIM_TRACEBACK"  # set in the environment: tracebacks of CosimErrors are whole
P = ParamSpec("P")
R = TypeVar("R")
Raised = TypeVar("Raised", bound="CosimError")

MANY = 20  # allowed values that are told
LONGEST = 1000  # characters of a part of a message: a value of a megabyte is not repeated


def shortened(text: str) -> str:
    """Return a text of at most LONGEST letters: its beginning, and its end with what to do."""
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 300]} … {text[-297:]}"


def few(allowed: str) -> str:
    """Return a list of allowed values, of more than MANY the first."""
    values = allowed.split(", ")
    return allowed if len(values) <= MANY else f"{', '.join(values[:MANY])}, ... {len(values) - MANY} more"


class CosimError(Exception):
    """Carry one message: `place` (file, key), `problem`, `allowed` (range, choices), `remedy`; each may be empty.

    `more` holds the errors found beside it: a file with four mistakes is one error of four lines.
    """

    more: tuple["CosimError", ...] = ()

    def __init__(self, problem: str, *, place: str = "", allowed: str = "", remedy: str = ""):
        super().__init__(problem, place, allowed, remedy)
        self.problem, self.place, self.allowed, self.remedy = problem, place, allowed, remedy

    def __str__(self):
        return "\n".join(error.line for error in self.every)

    @property
    def every(self) -> tuple["CosimError", ...]:
        """Return this error and those beside it."""
        return self, *self.more

    @property
    def line(self) -> str:
        """Return this error alone as one line, whatever a library's message holds."""
        place, problem, allowed, remedy = map(shortened, (self.place, self.problem, few(self.allowed), self.remedy))
        text = f"{place}: {problem}" if place else problem
        if allowed:
            text += f"; allowed: {allowed}"
        if remedy:
            text += f"{'' if text.endswith('?') else '.'} {remedy}"
        return " ".join(text.split())

    def __reduce__(self):  # keyword-only arguments would be lost on the way back from a worker process
        return _rebuild, (type(self), self.problem, self.place, self.allowed, self.remedy, self.more)


def _rebuild(kind, problem, place, allowed, remedy, more):
    return joined([kind(problem, place=place, allowed=allowed, remedy=remedy), *more])


def joined(errors: Sequence["Raised"]) -> "Raised":
    """Return the first of `errors` with the others, and what stands beside them, as its `more`; each is said once."""
    first, *others = {one.line: one for error in errors for one in error.every}.values()
    for one in others:
        one.more = ()
    first.more = tuple(others)
    return first  # type: ignore[return-value]


class Mistakes(list[CosimError]):
    """Errors of one file: `with mistakes.caught():` around each check, `mistakes.check()` after the last."""

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Keep what a check raises, and go on behind it."""
        try:
            yield
        except CosimError as error:
            self.append(error)

    def check(self) -> None:
        """Raise what was found, if anything, as one error."""
        if self:
            raise joined(self)


class ScenarioError(CosimError):
    """A scenario, or an override of one of its keys, that cannot be flown."""


class TrimError(CosimError):
    """A flight point at which the aircraft has no steady flight."""


class DesignError(CosimError):
    """A stored design or threshold that is missing or does not belong to the aircraft in the tree."""


class LogError(CosimError):
    """A log that cannot be read, or is not one."""


class CampaignError(CosimError):
    """A campaign that cannot be read, started or resumed."""


class OutputError(CosimError):
    """A place that cannot be written to."""


def told_at_call(function: Callable[P, R]) -> Callable[P, R]:
    """Let a CosimError of a public function show the caller's line, not the library's own; its cause stays.

    With COSIM_TRACEBACK in the environment the traceback stays whole.
    """

    @wraps(function)
    def called(*args: P.args, **more: P.kwargs) -> R:
        try:
            return function(*args, **more)
        except CosimError as error:
            if os.environ.get(FULL):
                raise
            error.__suppress_context__ = True
            raise error.with_traceback(None)  # noqa: B904

    return called


def did_you_mean(word: Any, choices: Any) -> str:
    """Return "Did you mean ...?" with the nearest of `choices`, or an empty string."""
    near = difflib.get_close_matches(str(word), list(choices), n=1, cutoff=0.6)
    return f"Did you mean {near[0]!r}?" if near else ""


def among(
    word: Any, known: Collection[str], said: str, *, error: type[CosimError] = ScenarioError, place: str = ""
) -> None:
    """Raise an error that says what is allowed, and what is near, unless `word` is one of those known."""
    if word not in known:
        raise error(said, place=place, allowed=", ".join(known), remedy=did_you_mean(word, known))
