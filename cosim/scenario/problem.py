"""What is wrong with a file of a user's: each mistake with where it was written.

Pydantic collects what is wrong with the fields of every `Table`, which says it in our words; a number that is `within`
a range says its range. What no field can say, a table adds in its `mistakes`; `Origin` knows the line or the override
that a key stands in; `explained` makes one error of them.
"""

import functools
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from actuators.technology import Key, Kind
from cosim.errors import CosimError, ScenarioError, did_you_mean, joined
from cosim.scenario.toml import inline
from cosim.texts import toml_lines

MULTIPLIER = Key("multiplier", 0.2, 5.0)
WORDS = {  # what pydantic calls by the names of Python
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "must be a table"),
    **dict.fromkeys(("tuple_type", "list_type"), "must be a list"),
    "string_type": "must be text",
    "bool_type": "must be true or false",
    "missing": "is missing",
    **dict.fromkeys(("too_short", "string_too_short"), "must not be empty"),
}


def problem(
    text: str, *, key: str = "", allowed: str = "", remedy: str = "", lacks: Sequence[str] = ()
) -> PydanticCustomError:
    """Return the exception a validator raises; `key` is the path below the validated table, `lacks` are the keys of
    which one would mend it."""
    about = {"text": text, "key": key, "allowed": allowed, "remedy": remedy, "lacks": lacks}
    return PydanticCustomError("cosim", "{text}", about)


def choice(value: Any, choices: Iterable[str], what: str, *, key: str = "") -> PydanticCustomError:
    """Return the exception for a word that is not one of `choices`."""
    return problem(f"{value!r} is no {what}", key=key, allowed=", ".join(choices), remedy=did_you_mean(value, choices))


def accepted(value: Any, key: Key, path: str = "", unit: str = "") -> Any:
    """Return `value` where it is a number that `key` accepts, or raise a `problem` at `path` with the range."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not key.accepts(value):
        said = "is out of range" if is_number else "must be a valid number"
        raise problem(said, key=path, allowed=f"{key.range} {unit}".rstrip())
    return value


class Within(Key):
    """A Key as the annotation of a field, a number of its range: Annotated[float, within(0.0, 1.0)]."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Check the number before pydantic makes a float or an integer of it."""
        return core_schema.no_info_before_validator_function(lambda value: accepted(value, self), handler(source))


def within(low: float, high: float = math.inf, *, open_low: bool = False) -> Within:
    """Return the annotation of a number from `low` (or above it) to `high`."""
    return Within("", low, high, open_low=open_low)


Seconds = Annotated[float, within(0.0, 36000.0)]  # of a flight, at the most as long as one may last
Duration = Annotated[float, within(0.0, 36000.0, open_low=True)]


class Problems(list[PydanticCustomError]):
    """What is wrong with one table: a `problem` each."""

    def add(self, text: str, **where: Any) -> None:
        """Add the `problem` of these words."""
        self.append(problem(text, **where))

    def require(self, holds: Any, text: str, **where: Any) -> None:
        """Add the `problem` of these words unless it `holds`."""
        if not holds:
            self.add(text, **where)

    def unknown(self, table: Iterable[str], known: Collection[str], path: str = "", *, of: str = "") -> None:
        """Add each key of `table` that is not `known`. `path` stands before it in what is said, `of` what has no such
        key behind it."""
        for key in (key for key in table if key not in known):
            said, allowed = f"unknown key{' for ' * bool(of)}{of}", ", ".join(known) or "no further key"
            self.add(said, key=f"{path}{key}", allowed=allowed, remedy=did_you_mean(key, known))

    def numbers(
        self, numbers: Mapping[str, Any], keys: Mapping[str, Key], what: str, path: str = "",
        units: Mapping[str, str] | None = None, others: Iterable[str] = (),
    ) -> None:  # fmt: skip
        """Add what is wrong with `numbers` {name: value} of `what`, which has `keys`, and whose table has `others`;
        `path` is put before each, `units[name]` is that of a range."""
        self.unknown(numbers, (*keys, *others), path, of=what)
        for name in (name for name in numbers if name in keys):
            try:
                accepted(numbers[name], keys[name], f"{path}{name}", (units or {}).get(name, ""))
            except PydanticCustomError as wrong:
                self.append(wrong)

    def one_of(self, names: Sequence[str], given: Iterable[str], *, who: str = "", allowed: str = "") -> None:
        """Add that more than one of `names` is in `given`, or none where `who` needs one of them."""
        both = [name for name in names if name in given]
        if len(both) > 1:
            self.add(f"{' and '.join(both)} exclude each other", key=both[1], remedy="Keep one of them")
        elif who and not both:
            said = f"{who} needs {'one of ' if len(names) > 1 else ''}{', '.join(names)}"
            self.add(said, key=names[0], allowed=allowed, lacks=names)

    def of_kind(
        self, kind: Kind, numbers: Mapping[str, Any], what: str, others: Iterable[str], optional: Sequence[Key] = ()
    ) -> None:
        """Add what is wrong with `numbers` {name: value} of a `kind`: one of its `one_of`, all of its `keys`, perhaps
        some of `optional`, no other. It is called `what`; `others` are further keys of the table."""
        for group in (kind.one_of, *((key,) for key in kind.keys)):
            if group:
                self.one_of([key.name for key in group], numbers, who=what, allowed=group[0].range)
        every = {key.name: key for key in (*kind.one_of, *kind.keys, *optional)}
        self.numbers(numbers, every, what, others=others)

    def check(self) -> None:
        """Raise what was found, if anything, as pydantic's error."""
        if self:
            details = [InitErrorDetails(type=one, loc=(), input=None) for one in self]
            raise ValidationError.from_exception_data("table", details)


@dataclass(frozen=True)
class Origin:
    """Where the keys of a file's tables were written: in its `text`, TOML that has been read before, or elsewhere."""

    place: str
    text: str = ""
    elsewhere: tuple[tuple[str, str], ...] = ()  # (key, "file: --set key=value") of what came after the text

    @functools.cached_property
    def where(self) -> dict[tuple[str, ...], str]:
        """Return {parts of a key: "file:line", or where else}; a key in quotes may have dots of its own."""
        lines = toml_lines(self.text).items()
        out = {tuple(".".join(key).split(".")): f"{self.place}:{line}" for key, line in lines}
        for key, where in self.elsewhere:
            path = tuple(key.split("."))
            out = {k: v for k, v in out.items() if k[: len(path)] != path} | {path: where}
        return out

    def of(self, key: str) -> str:
        """Return where a dotted `key` was written, or the nearest table around it."""
        path = tuple(key.split("."))
        found = (self.where.get(path[:n]) for n in range(len(path), 0, -1))
        return next((where for where in found if where), self.place)


def explained(
    error: ValidationError, table: dict[str, Any], origin: Origin, kind: type[CosimError] = ScenarioError
) -> CosimError:
    """Return pydantic's `error` about `table`, a file whose model is a Table, as an error of `kind` that names every
    mistake, in the order of the file. Of two about one key the first is told, and none that an unknown key explains."""
    found: dict[str, dict] = {}
    for one in error.errors(include_url=False):
        found.setdefault(".".join(map(str, (*one["loc"], *filter(None, [one["ctx"]["key"]])))), one["ctx"])
    slips = {_beside(key, ctx["remedy"].split("'")[1]) for key, ctx in found.items() if "mean '" in ctx["remedy"]}
    order = {where: n for n, where in enumerate(origin.where.values())}
    made = []
    for key, ctx in sorted(found.items(), key=lambda one: order.get(origin.of(one[0]), -1)):
        if slips.isdisjoint(_beside(key, name) for name in ctx["lacks"]):
            place = _place(origin.of(key), key, table)
            made.append(kind(ctx["text"], place=place, allowed=ctx["allowed"], remedy=ctx["remedy"]))
    return joined(made)


def checked(
    model: type[BaseModel], table: dict[str, Any], origin: Origin, kind: type[CosimError] = ScenarioError
) -> Any:
    """Return the Table, of class `model`, of the tables of a file. Raises an error of `kind` that names every mistake;
    see `explained`."""
    try:
        return model.model_validate(table)
    except ValidationError as error:
        raise explained(error, table, origin, kind) from None


def _beside(key, name):
    """Return the dotted key of `name` in the table of `key`."""
    return f"{key.rpartition('.')[0]}.{name}"


def _place(where, key, table):
    """Return "where: key = value" of a key of the tables, of a table its key alone; an override of just this key is
    said once."""
    file, set_, text = where.partition("--set ")
    exact = text.partition("=")[0].strip() == key
    value: Any = table
    try:
        for part in key.split("."):
            value = value[int(part) if isinstance(value, list) else part]
    except (KeyError, IndexError, ValueError, TypeError):
        said = key
    else:
        said = key if isinstance(value, dict) else f"{key} = {inline(value)[:60]}"
    return f"{file}{set_}{said}" if exact else ": ".join(filter(None, (where, said)))


class Table(BaseModel):
    """A frozen table of a file: unknown keys, wrong types and numbers that are not finite are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @classmethod
    def filled(cls, table: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Return a table as written with what follows from it; where something is `wrong` its fields are not read."""
        return table

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Add to `wrong` what no field can say."""

    @model_validator(mode="wrap")
    @classmethod
    def _checked(cls, raw: Any, handler: Any, info: ValidationInfo) -> Any:
        """Say in our words what pydantic finds wrong with the keys of this table; those below have been said."""
        wrong = Problems()
        try:
            given = cls.filled(raw, wrong, info) if isinstance(raw, dict) else raw
            wrong.check()
            made = handler(given)
            made.mistakes(wrong, info)
            wrong.check()
            return made
        except ValidationError as error:
            found = error.errors(include_url=False)
        told = [InitErrorDetails(type=_in_words(one, cls.model_fields), loc=one["loc"], input=None) for one in found]
        raise ValidationError.from_exception_data(cls.__name__, told)


def _in_words(one, fields):
    """Return the `problem` of one error of pydantic's about a table of `fields`."""
    ctx, wrong, name = one.get("ctx", {}), one["type"], next(iter(one["loc"]), "")
    if wrong == "cosim":
        return problem(**ctx)
    if wrong == "extra_forbidden":
        return problem("unknown key", allowed=", ".join(fields), remedy=did_you_mean(name, fields))
    if wrong == "literal_error":
        allowed = ctx["expected"].replace("''", '""').replace("'", "").replace(" or ", ", ")
        return problem("is not one of the choices", allowed=allowed)
    said = WORDS.get(wrong) or re.sub(r"^\w+ should", "must", one["msg"].removeprefix("Value error, "))
    known = fields[name].metadata if name in fields else ()
    allowed = "".join(each.range for each in known if isinstance(each, Key))
    return problem(said, allowed=allowed, lacks=[name] if wrong == "missing" else [])
