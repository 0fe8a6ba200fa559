"""A pilot's own inputs over time: `[manoeuvre] kind = "inputs"`, columns of numbers there or in a CSV file beside it.

A file is read once, when the scenario is: the scenario then holds its numbers, and so does the log.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, model_validator

from cosim.errors import ScenarioError, did_you_mean
from cosim.scenario.aircraft import of
from cosim.scenario.problem import Table, problem
from cosim.scenario.user_parts import find as file_of
from cosim.texts import read

TIME = "time_s"
RANGES = {  # column -> least and largest; the stabiliser's are those of the aircraft
    TIME: (0.0, 36000.0),
    "stick": (-1.0, 1.0),  # of its travel, + pulls: a demanded load-factor increment, 2 g at the stop
    "nz_g": (-2.0, 2.0),  # the same in g
    "bank_deg": (-60.0, 60.0),  # demanded bank, right wing down +
    "heading_deg": (-180.0, 180.0),  # demanded change of heading
    "elevator_deg": (-15.0, 15.0),  # added to the elevator command, trailing edge down +
    "throttle": (0.0, 1.0),  # of all engines
    "throttle_change": (-1.0, 1.0),  # the same from the trim on
    "stabiliser_deg": (-math.inf, math.inf),  # trailing edge down +
    "stabiliser_change_deg": (-40.0, 40.0),  # the same from the trim on
}
EITHER = (  # of each pair at most one
    ("stick", "nz_g"), ("bank_deg", "heading_deg"),
    ("throttle", "throttle_change"), ("stabiliser_deg", "stabiliser_change_deg"),
)  # fmt: skip
MOST = 30_000  # numbers of a table: with all their digits they fit into a scenario's megabyte
Column = Annotated[tuple[float, ...], Field(strict=False)]


class Inputs(Table):
    """Fly a table of one's own stick, bank, throttle and stabiliser inputs, or a CSV file with them."""

    kind: Literal["inputs"]
    file: str | None = None  # read by `located`, which puts its columns here
    between: Literal["linear", "hold"] = "linear"  # a value between two rows: on the line, or that of the row before
    hold_altitude: bool = False  # the altitude hold steers while the stick is free; else the path is held
    hold_speed: bool = False  # the speed hold moves the throttles
    time_s: Column
    stick: Column | None = None
    nz_g: Column | None = None
    bank_deg: Column | None = None
    heading_deg: Column | None = None
    elevator_deg: Column | None = None
    throttle: Column | None = None
    throttle_change: Column | None = None
    stabiliser_deg: Column | None = None
    stabiliser_change_deg: Column | None = None

    @model_validator(mode="before")
    @classmethod
    def _a_table(cls, raw: Any, info: ValidationInfo) -> Any:
        if not isinstance(raw, dict):
            return raw
        if raw.get("file") is not None:
            raise problem("was not read", key="file", remedy="Load the scenario by its name or file")
        columns = {name: raw[name] for name in RANGES if raw.get(name) is not None}
        if TIME in columns and (found := mistake(columns, of(info).travels_deg["stabiliser"])):
            name, row, said, allowed = found
            key = name if row is None else f"{name}.{row}"
            raise problem(said, key=key, allowed=allowed)
        return raw

    @model_validator(mode="after")
    def _together(self):
        for pair in EITHER:
            if all(name in self.columns for name in pair):
                raise problem(f"{' and '.join(pair)} are both given", key=pair[1], remedy="Keep one of them")
        if self.hold_speed and {"throttle", "throttle_change"} & self.columns.keys():
            raise problem("the table moves the throttles, too", key="hold_speed", allowed="false")
        return self

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """Return {column: its numbers} of what the table moves, in the units of their names."""
        given = {name: getattr(self, name) for name in RANGES if name != TIME}
        return {name: values for name, values in given.items() if values is not None}


def mistake(columns: Mapping[str, Any], stabiliser: tuple[float, float]) -> tuple[str, int | None, str, str] | None:
    """Return the first mistake of a table as (column, row from 0 or None, what is wrong, what is allowed); None when
    there is none. `stabiliser` are its stops [deg]."""
    spans = {**RANGES, "stabiliser_deg": stabiliser}
    total = sum(len(values) for values in columns.values() if isinstance(values, Sequence))
    if total > MOST:
        return TIME, None, f"the table has {total:,} numbers", f"up to {MOST:,}"
    times = columns[TIME]
    for name, values in columns.items():
        if not isinstance(values, list | tuple) or not values:
            return name, None, "must be a list of numbers", f"as many as {TIME} has"
        low, high = spans[name]
        said = f"{low:g} to {high:g}"
        for row, value in enumerate(values):
            if isinstance(value, bool) or not isinstance(value, int | float):
                return name, row, "must be a valid number", said
            if not math.isfinite(value):
                return name, row, "is not finite", said
            if not low <= value <= high:
                return name, row, "is out of range", said
        if isinstance(times, list | tuple) and len(values) != len(times):
            return name, None, f"has {len(values)} numbers, {TIME} has {len(times)}", "one in each row"
    for row in range(1, len(times)):
        if not times[row] > times[row - 1]:
            return TIME, row, f"does not come after {times[row - 1]:g}", "rising times"
    if len(columns) == 1:
        return TIME, None, "no input beside it", ", ".join(name for name in RANGES if name != TIME)
    return None


def located(table: dict, folder: Path | None, place: str) -> dict:
    """Return the tables of a scenario with the columns of its file of inputs in its place; the file is sought beside
    the scenario's own (`folder`), or from here. Raises ScenarioError with the row."""
    own = table.get("manoeuvre")
    if not (isinstance(own, dict) and own.get("kind") == "inputs" and isinstance(own.get("file"), str)):
        return table
    where = f"{place}: manoeuvre.file"
    twice = [name for name in RANGES if name in own]
    if twice:
        place = f"{where} = {own['file']}"
        raise ScenarioError(f"{twice[0]} is given beside the file", place=place, remedy="Keep one of them")
    path = file_of(own["file"], folder, where)
    text = read(path, error=ScenarioError, what="table of inputs")
    rest = {key: value for key, value in own.items() if key != "file"}
    return {**table, "manoeuvre": {**rest, **_columns(text, path)}}


def _columns(text, place):
    """Return {column: [numbers]} of a CSV text; with semicolons a comma is a decimal point."""
    lines = text.splitlines()
    semicolons = bool(lines) and ";" in lines[0]
    try:
        rows = [(i, row) for i, row in enumerate(csv.reader(lines, delimiter=";" if semicolons else ","), 1) if row]
    except csv.Error as wrong:
        raise ScenarioError(f"is no table: {wrong}", place=place) from None
    names = [name.strip() for name in rows[0][1]] if rows else []
    if TIME not in names:  # whatever file this is: not a word of it is shown
        said = f"no column {TIME}"
        raise ScenarioError(said, place=place, allowed=f"a first line with {TIME} and inputs, and rows of numbers")
    for name in names:
        if name not in RANGES or names.count(name) > 1:
            said = "is no input" if name not in RANGES else "stands twice"
            remedy = did_you_mean(name, RANGES)
            raise ScenarioError(said, place=f"{place}: column {name[:40]!r}", allowed=", ".join(RANGES), remedy=remedy)
    if len(rows) < 2:
        raise ScenarioError("there are no rows", place=place, allowed="rows of numbers below the first line")
    out: dict[str, list[float]] = {name: [] for name in names}
    for i, row in rows[1:]:
        if len(row) != len(names):
            raise ScenarioError(f"{len(row)} values", place=f"{place}: row {i}", allowed=f"{len(names)}, as in row 1")
        for name, word in zip(names, row):
            try:
                out[name].append(float(word.replace(",", ".") if semicolons else word))
            except ValueError:
                at = f"{place}: row {i}, {name} = {word.strip()[:40]!r}"
                raise ScenarioError("is no number", place=at) from None
    if found := mistake(out, RANGES["stabiliser_deg"]):
        name, n, said, allowed = found
        at = place if n is None else f"{place}: row {rows[1 + n][0]}, {name} = {out[name][n]:g}"
        raise ScenarioError(said, place=at, allowed=allowed)
    return out
