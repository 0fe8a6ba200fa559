"""What is wrong with a file of a user's: each mistake with where it was written.

Pydantic collects what is wrong with the fields of every table. What no field can say, a table's validator says with
`problem`, or with `Mistakes` where several can be wrong; `Origin` knows the line or the override that a key stands in;
`cosim.scenario.load.explained` makes one error of them.
"""

from collections.abc import Iterable, Mapping
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


class Mistakes(list[PydanticCustomError]):
    """What is wrong with one table: a `problem` each."""

    def add(self, text: str, **where: str) -> None:
        """Add the `problem` of these words."""
        self.append(problem(text, **where))

    def number(self, value: Any, key: Key, path: str = "", unit: str = "") -> None:
        """Add what is wrong with `value` of `key`, the path of which is its own name where none is given."""
        where = {"key": path or key.name, "allowed": f"{key.range} {unit}".rstrip()}
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.add("must be a valid number", **where)
        elif not key.accepts(value):
            self.add("is out of range", **where)

    def numbers(
        self, numbers: Mapping[str, Any], keys: Mapping[str, Key], what: str, path: str,
        units: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        """Add what is wrong with `numbers` {name: value} of `keys`; an unknown name is called a `what`, `path` is put
        before each, `units[name]` is that of a range."""
        for name, value in numbers.items():
            if name in keys:
                self.number(value, keys[name], f"{path}.{name}", (units or {}).get(name, ""))
            else:
                self.append(choice(name, keys, what, key=f"{path}.{name}"))

    def unknown(self, table: Iterable[str], known: Iterable[str], path: str = "") -> None:
        """Add each key of `table` that is not `known`; `path` stands before it in what is said."""
        known = tuple(known)
        for key in (key for key in table if key not in known):
            near = did_you_mean(key, known)
            self.add("unknown key", key=f"{path}{key}", allowed=", ".join(known), remedy=near)

    def check(self) -> None:
        """Raise what was found, if anything, as pydantic's error."""
        if self:
            details = [InitErrorDetails(type=one, loc=(), input=None) for one in self]
            raise ValidationError.from_exception_data("table", details)


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
