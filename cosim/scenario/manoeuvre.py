"""[manoeuvre]: what the pilot does. Each kind has its own few numbers, as a kind of fault has.

A pilot's own inputs over time, `kind = "inputs"`, are columns of numbers there or in a CSV file beside the scenario.
The file is read once, when the scenario is: the scenario then holds its numbers, and so does the log.
"""

import csv
import itertools
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, ValidationError, ValidationInfo

from actuators.technology import Key, Kind
from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario.problem import Problems, Table, accepted, problem
from cosim.texts import read

_START = Key("start_s", 0.0, 36000.0, default=5.0)
_GENTLE = Key("amplitude_g", -1.5, 1.5, default=0.15)  # stays inside the load factor that Alwi14's point C has left


def _length(name: str, default: float) -> Key:
    return Key(name, 0.0, 3600.0, open_low=True, default=default)


KINDS = {
    "cruise": Kind("Hold the trimmed flight, hands off"),
    "aoa_protection": Kind(
        "Pull the stick (a share of full travel) and hold it: the angle-of-attack protection takes over",
        keys=(_START, _length("duration_s", 20.0), Key("stick", 0.1, 1.0, default=1.0))),
    "nose_up": Kind(
        "Pull abruptly for a short time",
        keys=(_START, _length("duration_s", 2.0), Key("amplitude_g", 0.05, 1.5, default=0.5))),
    "pitch_protection": Kind(
        "Pull gently for long, until the pitch-attitude protection takes over",
        keys=(_START, _length("duration_s", 20.0), Key("amplitude_g", 0.05, 1.0, default=0.3))),
    "coordinated_turn": Kind(
        "Bank, hold, and roll out",
        keys=(_START, _length("duration_s", 60.0), Key("bank_deg", -60.0, 60.0, default=30.0))),
    "yaw_angle": Kind(
        "Change the heading by an angle and hold it (heading-hold mode)",
        keys=(_START, Key("heading_deg", -180.0, 180.0, default=10.0))),
    "nz_doublet": Kind(
        "Demand load factor up and down, each for a width", keys=(_START, _length("width_s", 3.0), _GENTLE)),
    "three_two_one_one": Kind(
        "Alternate pulses of 3, 2, 1 and 1 units, as a load-factor demand or added to the elevator command",
        keys=(_START, _length("unit_s", 1.0)), one_of=(_GENTLE, Key("amplitude_deg", -15.0, 15.0))),
    "inputs": Kind("Fly a table of one's own stick, bank, throttle and stabiliser inputs, or a CSV file with them"),
}  # fmt: skip
HOLD_SPEED = ("coordinated_turn", "yaw_angle")  # where nothing else is said


TIME = "time_s"
RANGES = {  # column -> least and largest
    TIME: (0.0, 36000.0),
    "stick": (-1.0, 1.0),  # of its travel, + pulls: a demanded load-factor increment, 2 g at the stop
    "nz_g": (-2.0, 2.0),  # the same in g
    "bank_deg": (-60.0, 60.0),  # demanded bank, right wing down +
    "heading_deg": (-180.0, 180.0),  # demanded change of heading
    "elevator_deg": (-15.0, 15.0),  # added to the elevator command, trailing edge down +
    "throttle": (0.0, 1.0),  # of all engines
    "throttle_change": (-1.0, 1.0),  # the same from the trim on
    "stabiliser_deg": (-40.0, 40.0),  # trailing edge down +, within the stops of the aircraft
    "stabiliser_change_deg": (-40.0, 40.0),  # the same from the trim on
}
EITHER = (  # of each pair at most one
    ("stick", "nz_g"), ("bank_deg", "heading_deg"),
    ("throttle", "throttle_change"), ("stabiliser_deg", "stabiliser_change_deg"),
)  # fmt: skip
MOST = 30_000  # numbers of a table: with all their digits they fit into a scenario's megabyte
Column = Annotated[tuple[float, ...], Field(strict=False)]


def keys_of(kind: str) -> tuple[str, ...]:
    """Return the keys of a kind of manoeuvre."""
    if kind == "inputs":
        return tuple({**Inputs.model_fields, **RANGES})
    return "kind", "hold_speed", *(key.name for key in (*KINDS[kind].keys, *KINDS[kind].one_of))


class Inputs(Table, extra="allow"):
    """Fly a table of one's own stick, bank, throttle and stabiliser inputs, or a CSV file with them."""

    __pydantic_extra__: dict[str, Column]

    kind: Literal["inputs"]
    file: str | None = None  # its columns take its place
    between: Literal["linear", "hold"] = "linear"  # a value between two rows: on the line, or that of the row before
    hold_altitude: bool = False  # the altitude hold steers while the stick is free; else the path is held
    hold_speed: bool = False  # the speed hold moves the throttles
    time_s: Column

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Put the columns of a file in its place; name the first number that is wrong."""
        if isinstance(raw.get("file"), str):
            raise problem("was not read", key="file", remedy="Load the scenario by its name or file")
        if isinstance(raw.get("file"), Path):  # found beside a scenario of this machine
            for name in RANGES.keys() & raw.keys():
                wrong.add(f"{name} is given beside the file", key=name, remedy="Keep one of them")
            columns = _columns(raw["file"], info.context)
            raw = {**{key: value for key, value in raw.items() if key != "file"}, **columns}
        wrong.unknown(raw, (*cls.model_fields, *RANGES))
        own = {"stabiliser_deg": info.context["aircraft"].travels_deg["stabiliser"]} if info.context else {}
        keys = {name: Key(name, *span) for name, span in {**RANGES, **own}.items()}
        columns = {name: values for name, values in raw.items() if name in keys and isinstance(values, list | tuple)}
        checked = {name: tuple(accepted(x, keys[name], f"{name}.{row}") for row, x in enumerate(values))
                   for name, values in columns.items()}  # fmt: skip
        return {**raw, **checked}

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that the columns make a table."""
        times, columns = self.time_s, self.columns
        total = len(times) + sum(map(len, columns.values()))
        wrong.require(total <= MOST, f"the table has {total:,} numbers", key=TIME, allowed=f"up to {MOST:,}")
        said = "no input beside it" if times else "there are no rows"
        rows = f"rows of numbers for {TIME} and {', '.join([*RANGES][1:])}"
        wrong.require(columns and times, said, key=TIME, allowed=rows)
        for row, (before, after) in enumerate(itertools.pairwise(times), 1):
            wrong.require(after > before, f"does not come after {before:g}", key=f"{TIME}.{row}",
                          allowed="rising times")
        for name, values in columns.items():
            wrong.require(len(values) == len(times), f"has {len(values)} numbers, {TIME} has {len(times)}", key=name,
                          allowed="one in each row")
        for pair in EITHER:
            wrong.one_of(pair, columns)
        idle = not self.hold_speed or columns.keys().isdisjoint({"throttle", "throttle_change"})
        wrong.require(idle, "the table moves the throttles, too", key="hold_speed", allowed="false")

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """Return {column: its numbers} of what the table moves, in the units of their names."""
        return dict(self.model_extra or {})


def _columns(place, context):
    """Return {column: [numbers]} of a CSV file, checked in a validator's `context`; with semicolons a comma is a
    decimal point. Raises ScenarioError with the row."""
    text = read(place, error=ScenarioError, what="table of inputs")
    semicolons = ";" in text.partition("\n")[0]
    reader = csv.reader(text.splitlines(), delimiter=";" if semicolons else ",")
    try:
        rows = [(reader.line_num, [word.strip() for word in row]) for row in reader if row]
    except csv.Error as wrong:
        raise ScenarioError(f"is no table: {wrong}", place=place) from None
    names = rows[0][1] if rows else []
    if TIME not in names:  # whatever file this is: not a word of it is shown
        said = f"no column {TIME}"
        raise ScenarioError(said, place=place, allowed=f"a first line with {TIME} and inputs, and rows of numbers")
    if odd := next((name for name in names if name not in RANGES or names.count(name) > 1), None):
        where, near = f"{place}: column {odd[:40]!r}", did_you_mean(odd, RANGES.keys() - names)
        raise ScenarioError("is no input, or stands twice", place=where, allowed=", ".join(RANGES), remedy=near)
    for i, row in rows:
        if len(row) != len(names):
            raise ScenarioError(f"{len(row)} values", place=f"{place}: row {i}", allowed=f"{len(names)}, as in row 1")
    words = {name: [row[i] for _, row in rows[1:]] for i, name in enumerate(names)}
    out = {name: [_number(word.replace(",", ".") if semicolons else word) for word in column]
           for name, column in words.items()}  # fmt: skip
    try:
        Inputs.model_validate({"kind": "inputs", **out}, context=context)
    except ValidationError as error:
        about = error.errors()[0]["ctx"]
        name, _, at = about["key"].partition(".")
        where = f"row {rows[1 + int(at)][0]}, {name} = {str(out[name][int(at)])[:40]}" if at else name
        raise ScenarioError(about["text"], place=f"{place}: {where}", allowed=about["allowed"]) from None
    return out


def _number(word):
    try:
        return float(word)
    except ValueError:
        return word


class Manoeuvre(Table, extra="allow"):
    """What the pilot does: a kind of KINDS with its numbers."""

    __pydantic_extra__: dict[str, Any]

    hold_speed: bool  # the throttles hold the speed; a climb, descent or turn from the start has it anyway
    kind: str

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Add the defaults of its kind."""
        given = KINDS[raw["kind"]].filled({"hold_speed": raw["kind"] in HOLD_SPEED, **raw})
        return {**{key: given[key] for key in keys_of(raw["kind"]) if key in given}, **given}

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check the kind's own numbers."""
        wrong.of_kind(KINDS[self.kind], self.model_extra or {}, self.kind, Manoeuvre.model_fields)


def _of_its_kind(raw: Any, info: ValidationInfo) -> Any:
    """Return the manoeuvre of a table, of the class that its kind names."""
    kind = str(raw.get("kind", "")) if isinstance(raw, dict) else "cruise"  # which refuses what is no table
    if kind not in KINDS:
        raise problem("is no manoeuvre" if kind else "is missing", key="kind", allowed=", ".join(KINDS),
                      remedy=did_you_mean(kind, KINDS))  # fmt: skip
    return (Inputs if kind == "inputs" else Manoeuvre).model_validate(raw, context=info.context)


AnyManoeuvre = Annotated[Any, PlainValidator(_of_its_kind)]
CRUISE = Manoeuvre.model_validate({"kind": "cruise"})
