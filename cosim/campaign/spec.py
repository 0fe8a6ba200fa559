"""The campaign file: a base scenario, a grid, draws; every mistake is a CampaignError or ScenarioError with its place.

    title = "..."
    base = "liquid-ofc"             # built-in scenario or file (beside the campaign file)
    runs = 10                       # draws per point of the grid, default 1
    sampling = "latin_hypercube"    # or "random"
    seed = 1                        # of the draws; the flights' own seeds are first_seed, first_seed + 1, ...
    first_seed = 1000000            # unless grid or draw set `seed`; from 1000000 on seeds are for evaluation
    paired = true                   # the same draws and seeds at every point of the grid, which then differ in it alone

    [set]                           # on top of the base, for every run
    duration_s = 30.0
    [grid]                          # factorial: every value with every other, the last key changes fastest
    "faults.0.frequency_hz" = [0.5, 1, 2]
    point = [{ name = "A", "flight.mass_t" = 260.0, "flight.cg_pct" = 28.0 }, ...]    # several keys at once; any word
    [draw]                          # distributions: cosim/campaign/draw.py
    "flight.mass_t" = { low = 200, high = 300 }
    "tolerances.aero.*" = { mean = 1.0, sigma = 0.02 }    # every coefficient on its own
    [[part]]                        # if any: the campaign is its parts, each with all of the above and its own on top
    name = "jams"                   # column label.part
    set = { "faults.0.kind" = "jam_solid" }
    grid = { ... }                  # also draw, runs

Keys are those of a scenario, as with --set. A table's `name` becomes the column label.<key>.
"""

import contextlib
import csv
import dataclasses
import itertools
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from cosim.campaign.draw import Draw, unit_cube
from cosim.campaign.worker import Packed
from cosim.errors import CampaignError, CosimError, Mistakes, joined
from cosim.scenario import Scenario, load_scenario, parse
from cosim.scenario.catalog import toleranced
from cosim.scenario.load import assigned, text_of
from cosim.scenario.problem import Origin, Table, explained, within
from cosim.scenario.toml import inline
from cosim.scenario.user_parts import identified, locate
from cosim.texts import read, toml

MOST = 1_000_000  # runs; more is a slip of a grid
EVALUATION_SEED = 1_000_000  # thresholds are trained on seeds below it, what is reported flies on those from there on
Runs = Annotated[int, within(1, MOST)]
Seed = Annotated[int, within(0, 2**31 - MOST - 1)]
Values = Annotated[list[Any], Field(min_length=1)]


class _Flights(Table):
    """What flies: of a part, or of the whole file for all of its parts."""

    runs: Runs = 1
    set: dict[str, Any] = Field(default_factory=dict)
    grid: dict[str, Values] = Field(default_factory=dict)
    draw: dict[str, Draw] = Field(default_factory=dict)


class _PartTable(_Flights):
    name: str = ""


class _File(_Flights):
    title: str = ""
    base: str = "cruise"
    sampling: Literal["latin_hypercube", "random"] = "latin_hypercube"
    seed: Seed = 1
    first_seed: Seed = EVALUATION_SEED
    paired: bool = False
    part: list[_PartTable] = Field(default_factory=lambda: [_PartTable()])


@dataclass(frozen=True)
class Part:
    """A grid with draws over one base."""

    base: dict  # tables of the scenario, `set` applied
    name: str = ""
    runs: int = 1
    grid: dict = field(default_factory=dict)
    draw: dict = field(default_factory=dict)
    folder: Path | None = None  # of the campaign's file: what it names may lie beside it
    origin: Origin = field(default_factory=lambda: Origin(""))  # of the keys of `base`
    lines: dict = field(default_factory=dict)  # {key of grid or draw: "file:line"}

    def values(self, sampling: str, seed: int, first_seed: int, paired: bool) -> Iterator[tuple[dict, dict]]:
        """Yield ({key or label: value of the grid or draw}, labels) of every run."""
        points = list(itertools.product(*self.grid.values()))
        drawn = self.runs if paired else self.size
        cube = unit_cube(drawn, len(self.draw), sampling=sampling, seed=seed)
        for i in range(self.size):
            chosen = dict(zip(self.grid, points[i // self.runs]))
            chosen |= {key: one(q) for (key, one), q in zip(self.draw.items(), cube[i % drawn])}
            if "seed" not in chosen:  # one that is drawn comes after the grid's, and wins
                chosen = {"seed": first_seed + i % drawn} | chosen
            yield chosen, {"part": self.name} if self.name else {}

    @property
    def size(self) -> int:
        """Return the number of runs, perhaps of a grid beyond 2^63 points."""
        return math.prod(map(len, self.grid.values())) * self.runs


@dataclass(frozen=True)
class Campaign:
    """A campaign as written, checked but for the scenarios that it makes."""

    name: str
    parts: tuple
    title: str = ""
    sampling: str = "latin_hypercube"
    seed: int = 1
    first_seed: int = EVALUATION_SEED
    paired: bool = False

    def __len__(self) -> int:
        return sum(part.size for part in self.parts)

    def scenarios(self) -> tuple[Packed, list[dict]]:
        """Return (scenarios, labels): every run, in order. Raises ScenarioError for one that cannot be."""
        runs = sum(part.size for part in self.parts)
        if runs > MOST:
            raise CampaignError(f"has {runs} runs", place=self.name, allowed=f"1 to {MOST}")
        made = Packed()
        labels = []
        wrong: dict = {}  # of what every run has in common once
        n = -1
        for i, part in enumerate(self.parts):
            for chosen, label in part.values(self.sampling, self.seed + i, self.first_seed + n + 1, self.paired):
                n += 1
                try:
                    scenario, names = scenario_of(part, chosen, f"{self.name}, run {n}", f", run {n}")
                except CosimError as error:
                    for one in error.every:
                        wrong.setdefault((re.sub(r", run \d+(:.*)?$", "", one.place), one.problem), one)
                    continue
                made.append(scenario)
                labels.append(label | names)
        if wrong:
            raise joined(list(wrong.values()))
        return made, labels


def scenario_of(part: Part, chosen: dict, place: str, run: str = "") -> tuple[Scenario, dict]:
    """Return (Scenario, {label: name}) of a Part with `chosen` keys; a table sets several, and perhaps has a name. A
    file of a user's lies beside the campaign, or where its path leads from here. `run` stands behind the line of a
    chosen key in what is said of it."""
    each = [(key, value if isinstance(value, dict) else {key: value}) for key, value in chosen.items()]
    names = {key: table["name"] for key, table in each if "name" in table and isinstance(chosen[key], dict)}
    # in order: a later kind drops the numbers of an earlier one
    pairs = [(name, value, f"{part.lines[key]}{run}" if key in part.lines else place)
             for key, table in each for name, value in table.items() if key not in names or name != "name"]  # fmt: skip
    elsewhere = (*part.origin.elsewhere, *((name, where) for name, _, where in pairs))
    origin, wrong = dataclasses.replace(part.origin, elsewhere=elsewhere), Mistakes()
    told = ((name, value, f"{where}: {name} = {inline(value)}") for name, value, where in pairs)
    table = assigned(part.base, told, wrong)
    with wrong.caught():
        scenario = identified(parse(locate(table, part.folder, place), place=place, origin=origin))
    for one in (one for error in wrong for one in error.every):
        one.place = one.place if one.place.startswith((place, *origin.where.values())) else f"{place}: {one.place}"
    wrong.check()
    return scenario, names


def load_campaign(name_or_path: str | Path) -> Campaign:
    """Return the Campaign of a built-in name or a TOML file. Raises CampaignError, ScenarioError: every mistake."""
    name = str(name_or_path)
    text, folder = text_of(name, "campaign", CampaignError)
    table = toml(text, place=name, error=CampaignError)
    origin = Origin(name, text)
    wrong = Mistakes()
    try:
        file = _File.model_validate(table)
    except ValidationError as error:
        wrong.append(explained(error, table, origin, CampaignError))
        slips = {one["loc"][0] for one in error.errors()}
        if "part" in slips:
            wrong.check()
        file = _File.model_validate({key: value for key, value in table.items() if key not in slips})
    slips_only = len(wrong)
    with wrong.caught():
        base, written_at = _base(file.base, folder)
        parts = [_part(file, i, base, written_at, folder, origin, wrong) for i in range(len(file.part))]
        about = file.model_dump(include={"title", "sampling", "seed", "first_seed", "paired"})
        made = Campaign(name, tuple(parts), **about)
        if wrong and len(wrong) == slips_only:  # its runs can be checked all the same
            dataclasses.replace(made, sampling="random").scenarios()
    wrong.check()
    return made


def _part(file, i, base, base_origin, folder, origin, wrong):
    """Return Part `i` of a campaign's file: what the file says for all, and its own on top; the common grid changes
    slowest. Keys that cannot be are put to the `wrong` ones."""
    own = file.part[i]

    def line(kind, key):
        """Return where a key was written: of the part's own, or of what is common to all."""
        at = f"part.{i}.{kind}" if key in getattr(own, kind) else kind
        return origin.of(f"{at}.{key}")

    constant, grid, draws = ({**getattr(file, kind), **getattr(own, kind)} for kind in ("set", "grid", "draw"))
    lines = {key: line("grid", key) for key in grid}
    drawn: dict[str, Draw] = {}
    for key, one in sorted(draws.items(), key=lambda item: not item[0].endswith("*")):  # a key itself wins over *
        here = line("draw", key)
        with wrong.caught():
            every = _every(key, f"{here}: draw.{key}")
            drawn |= dict.fromkeys(every, _listed(one, folder, f"{here}: draw.{key}"))
            lines |= dict.fromkeys(every, here)
    for key in grid.keys() & drawn.keys():
        wrong.append(CampaignError("is drawn and in the grid", place=f"{line('grid', key)}: {key}"))
    written = {key: line("set", key) for key in constant}
    whole = {key: set(value) for key, value in constant.items() if isinstance(value, dict)}
    for key in (key for key in whole if not whole[key].issuperset(map(str, base.get(key, ())))):
        said = "is a table, as a key with a dot is without quotes, and drops what the base has there"
        wrong.append(CampaignError(said, place=f"{written[key]}: set.{key}", allowed=f'"{key}.KEY" = ...'))
    tables = assigned(base, ((key, value, f"{written[key]}: set.{key}") for key, value in constant.items()), wrong)
    return Part(
        locate(tables, folder, origin.of(f"part.{i}")), own.name,
        own.runs if "runs" in own.model_fields_set else file.runs, grid, drawn, folder,
        dataclasses.replace(base_origin, elsewhere=tuple(written.items())), lines,
    )  # fmt: skip


def _listed(drawn, folder, place):
    """Return a Draw; a `choice` that names a CSV file beside the campaign becomes the list of its rows."""
    name = drawn.choice
    if not isinstance(name, str):
        return drawn
    path = folder / name if folder else resources.files("cosim").joinpath("campaigns", name)
    rows: list[dict] = []
    with contextlib.suppress(CosimError, OSError, csv.Error):
        rows = list(csv.DictReader(read(str(path)).splitlines()))
    if not rows:
        raise CampaignError(f"{name} is no CSV file of rows that can be read", place=place)
    return Draw(choice=[{key: _value(text) for key, text in row.items()} for row in rows])


def _value(text):
    with contextlib.suppress(TypeError, ValueError):
        return float(text)
    return text


def _every(key, place):
    """Return the keys that a trailing .* stands for: tolerances.aero.*, .hydraulic.*, .ema.*"""
    groups = {f"tolerances.{group}.*": group for group in ("aero", "hydraulic", "ema")}
    if not key.endswith(".*"):
        return [key]
    if key not in groups:
        raise CampaignError("* stands for nothing here", place=place, allowed=", ".join(groups))
    return [f"{key[:-1]}{name}" for name in toleranced(groups[key])]


def _base(base, folder):
    """Return (tables, Origin) of the base scenario as written, so that defaults that follow from other keys still
    follow."""
    beside = folder / base if folder else Path(base)
    found = beside if os.path.isfile(beside) else Path(base)
    load_scenario(str(found))  # says what is wrong with the base itself
    place = str(found)
    text, home = text_of(place, "scenario", CampaignError)
    return locate(toml(text, place=place), home, place), Origin(place, text)
