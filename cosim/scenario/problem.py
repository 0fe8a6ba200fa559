"""What is wrong with a file of a user's: every mistake at once, each with where it was written.

A validator says `problem`; `Mistakes` collects several; `Origin` knows the line or the override that a key stands in;
`cosim.scenario.load.explained` makes one error of them.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from actuators.technology import Key
from cosim.errors import did_you_mean
from cosim.texts import toml_lines

Seconds = Annotated[float, Field(ge=0.0, le=36000.0)]  # of a flight, at the most as long as one may last
Duration = Annotated[float, Field(gt=0.0, le=36000.0)]
MULTIPLIER = Key("multiplier", 0.2, 5.0)


def problem(text: str, *, key: str = "", allowed: str = "", remedy: str = "") -> PydanticCustomError:
    """Return the exception a validator raises; `key` is the path below the validated table."""
    return PydanticCustomError("cosim", "{text}", {"text": text, "key": key, "allowed": allowed, "remedy": remedy})


def choice(value: Any, choices: Iterable[str], what: str, *, key: str = "") -> PydanticCustomError:
    """Return the exception for a word that is not one of `choices`."""
    return problem(f"{value!r} is no {what}", key=key, allowed=", ".join(choices), remedy=did_you_mean(value, choices))


class Mistakes:
    """Every mistake of one table of pydantic's, as cosim.errors.Mistakes collects those of a file."""

    def __init__(self) -> None:
        self.found: list[InitErrorDetails] = []

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Keep what a check raises, and go on behind it."""
        try:
            yield
        except PydanticCustomError as error:
            self.found.append(InitErrorDetails(type=error, loc=(), input=None))
        except ValidationError as error:
            self.found += [_again(one) for one in error.errors(include_url=False)]

    def add(self, text: str, **where: str) -> None:
        """Add the `problem` of these words."""
        self.found.append(InitErrorDetails(type=problem(text, **where), loc=(), input=None))

    def last(self, handler: Callable[[Any], Any], raw: Any) -> Any:
        """Return what pydantic makes of `raw`, or raise what it finds with what was found before."""
        with self.caught():
            made = handler(raw)
        self.check()
        return made

    def check(self) -> None:
        """Raise what was found, if anything, as pydantic's error."""
        if self.found:
            raise ValidationError.from_exception_data("table", self.found)


def _again(one):
    """Return an error that pydantic told as one that it can be given again."""
    own = one["type"] == "cosim"
    kind = PydanticCustomError("cosim", "{text}", one["ctx"]) if own else one["type"]
    return InitErrorDetails(type=kind, loc=one["loc"], input=one["input"], ctx={} if own else one.get("ctx", {}))


@dataclass(frozen=True)
class Origin:
    """Where each key of a file's tables was written: {parts of the key: "file:line" or "file: --set key=value"}."""

    place: str  # of a key that none of them tells
    where: dict[tuple[str, ...], str] = field(default_factory=dict)

    @classmethod
    def of_toml(cls, text: str, place: str) -> "Origin":
        """Return that of a file's TOML text, which has been read before."""
        return cls(place, {key: f"{place}:{line}" for key, line in toml_lines(text).items()})

    def overridden(self, key: str, where: str) -> "Origin":
        """Return this one with `key`, and all below it, written at `where`."""
        path = tuple(key.split("."))
        kept = {k: v for k, v in self.where.items() if k[: len(path)] != path}
        return Origin(self.place, {**kept, path: where})

    def of(self, key: str | tuple[str, ...]) -> str:
        """Return where `key` (dotted, or its parts) was written, or the nearest table around it."""
        path = tuple(key.split(".")) if isinstance(key, str) else key
        found = (self.where.get(path[:n]) for n in range(len(path), 0, -1))
        return next((where for where in found if where), self.place)


class Table(BaseModel):
    """A frozen table of a scenario: unknown keys, wrong types and numbers that are not finite are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def check_numbers(numbers: Mapping[str, Any], keys: Mapping[str, Key], what: str, path: str, wrong: Mistakes) -> None:
    """Collect in `wrong` an error for each of `numbers` {name: value} of unknown name or with a value out of range.

    `keys` has the known names; the message calls such a name a `what` and puts `path` before it.
    """
    for name, value in numbers.items():
        with wrong.caught():
            if name not in keys:
                raise choice(name, keys, what, key=f"{path}.{name}")
            if not keys[name].accepts(value):
                raise problem("is out of range", key=f"{path}.{name}", allowed=keys[name].range)


def known_keys(table: Iterable[str], known: Iterable[str], path: str = "") -> None:
    """Raise for each key of `table` that is not `known`; `path` stands before it in what is said."""
    known, wrong = tuple(known), Mistakes()
    for key in table:
        if key not in known:
            near = did_you_mean(key, known)
            wrong.add("unknown key", key=f"{path}{key}", allowed=", ".join(known), remedy=near)
    wrong.check()
