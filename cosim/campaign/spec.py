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

from cosim.campaign.draw import draw, unit_cube
from cosim.campaign.worker import Packed
from cosim.errors import CampaignError, CosimError, Mistakes, did_you_mean, joined
from cosim.scenario import Scenario, load_scenario, parse
from cosim.scenario.load import located
from cosim.scenario.override import assigned
from cosim.scenario.problem import Origin
from cosim.scenario.tolerance import toleranced
from cosim.scenario.user_parts import identified, locate
from cosim.texts import read, toml

MOST = 1_000_000  # runs; more is a slip of a grid
EVALUATION_SEED = 1_000_000  # thresholds are trained on seeds below it, what is reported flies on those from there on
TYPES = {
    "title": str, "base": str, "runs": int, "sampling": str, "seed": int, "first_seed": int, "paired": bool,
    "set": dict, "grid": dict, "draw": dict, "part": list,
}  # fmt: skip
OF_A_PART = ("name", "runs", "set", "grid", "draw")


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
        drawn = self.runs if paired else len(self)
        cube = unit_cube(drawn, len(self.draw), sampling=sampling, seed=seed)
        for i in range(len(self)):
            chosen = dict(zip(self.grid, points[i // self.runs]))
            chosen |= {key: one(q) for (key, one), q in zip(self.draw.items(), cube[i % drawn])}
            if "seed" not in chosen:  # one that is drawn comes after the grid's, and wins
                chosen = {"seed": first_seed + i % drawn} | chosen
            yield chosen, {"part": self.name} if self.name else {}

    def __len__(self) -> int:
        return self.size

    @property
    def size(self) -> int:
        """Return the number of runs: of a grid beyond 2^63 points `len` has no answer."""
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
        return sum(map(len, self.parts))

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
    pairs = [(name, value, key) for key, table in each for name, value in table.items()
             if key not in names or name != "name"]  # fmt: skip

    def origin() -> Origin:
        made = dataclasses.replace(part.origin, place=place)
        for name, _, key in pairs:
            made = made.overridden(name, f"{part.lines[key]}{run}" if key in part.lines else place)
        return made

    table, refused = assigned(part.base, ((name, value) for name, value, _ in pairs))
    wrong = Mistakes()
    for key, error in refused:
        error.place = f"{origin().of(key)}: {error.place}"
        wrong.append(error)
    with wrong.caught():
        scenario = identified(parse(locate(table, part.folder, place), place=place, origin=origin))
    for one in (one for error in wrong for one in error.every):
        one.place = one.place if one.place.startswith((place, *origin().where.values())) else f"{place}: {one.place}"
    wrong.check()
    return scenario, names


def builtin_campaigns() -> list[str]:
    """Return the names of the built-in campaigns, sorted."""
    folder = resources.files("cosim").joinpath("campaigns")
    return sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".toml"))


def load_campaign(name_or_path: str | Path) -> Campaign:
    """Return the Campaign of a built-in name or a TOML file. Raises CampaignError, ScenarioError: every mistake."""
    name, folder, text = _read(str(name_or_path))
    table = toml(text, place=name, error=CampaignError)
    return _File(name, folder, Origin.of_toml(text, name)).campaign(table)


class _File:
    """A campaign's file while it is read: where its keys stand, and what is wrong so far."""

    def __init__(self, name, folder, origin):
        self.name, self.folder, self.origin = name, folder, origin
        self.wrong = Mistakes()

    def place(self, path, said=""):
        """Return where the key of these parts stands, with words behind it."""
        return ": ".join(filter(None, (self.origin.of(path), said)))

    def says(self, problem, path, said="", **more):
        self.wrong.append(CampaignError(problem, place=self.place(path, said), **more))

    def campaign(self, table):
        table = self.known(table, TYPES, ())
        if table.get("sampling", "random") not in ("random", "latin_hypercube"):
            self.says(f"sampling = {table['sampling']!r}", ("sampling",), allowed="random, latin_hypercube")
        for key in ("seed", "first_seed"):
            if not 0 <= table.get(key, 0) < 2**31 - MOST:
                self.says(f"{key} = {table[key]}", (key,), allowed=f"0 to {2**31 - MOST - 1}")
        base: dict = {}
        origin = Origin(self.name)
        with self.wrong.caught():
            base, origin = _base(table.get("base", "cruise"), self.folder)
        parts, before = [], len(self.wrong)
        for i, own in enumerate(table.get("part", [{}])):
            with self.wrong.caught():
                parts.append(self.part(base, origin, table, own, ("part", str(i)) if "part" in table else ()))
        kept = {k: v for k, v in table.items() if k in ("title", "sampling", "seed", "first_seed", "paired")}
        made = Campaign(name=self.name, parts=tuple(parts), **kept)
        if self.wrong and base and len(self.wrong) == before:  # its runs can be checked all the same
            with self.wrong.caught():
                dataclasses.replace(made, sampling="random", seed=1, first_seed=EVALUATION_SEED).scenarios()
        self.wrong.check()
        return made

    def known(self, table, known, path):
        """Return what of `table` has a known key and the right kind of value; the rest is wrong."""
        if not isinstance(table, dict):
            self.says("is no table", path)
            return {}
        out = {}
        for key, value in table.items():
            kind = TYPES.get(key, str)
            if key not in known:
                near = did_you_mean(key, known)
                self.says(f"unknown key {key!r}", (*path, key), allowed=", ".join(known), remedy=near)
            elif not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
                word = {str: "text", int: "whole number", dict: "table", list: "list of tables", bool: "true or false"}
                self.says(f"{key} is no {word[kind]}", (*path, key))
            else:
                out[key] = value
        return out

    def part(self, base, origin, table, own, path):
        """Return a Part: what the campaign says for all, and its `own` on top; the common grid changes slowest."""
        own = self.known(own, OF_A_PART, path)
        label = f"part {own['name']!r}: " if own.get("name") else f"part {path[1]}: " if path else ""
        paths = {
            (kind, key): (*at, kind, key)
            for at, given in (((), table), (path, own))
            for kind in ("set", "grid", "draw")
            for key in given.get(kind, {})
        }
        runs = own.get("runs", table.get("runs", 1))
        if not 1 <= runs <= MOST:
            said = (*path, "runs") if "runs" in own else ("runs",)
            self.says(f"runs = {runs}", said, label.removesuffix(": "), allowed=f"1 to {MOST}")
        constant, grid, draws = ({**table.get(k, {}), **own.get(k, {})} for k in ("set", "grid", "draw"))
        for key, values in grid.items():
            if not isinstance(values, list) or not values:
                self.says("is no list of values", paths["grid", key], f"{label}grid.{key}")
        drawn: dict = {}
        lines = {key: self.place(paths["grid", key]) for key in grid}
        for key, value in sorted(draws.items(), key=lambda item: not item[0].endswith("*")):  # a key itself wins over *
            here = self.place(paths["draw", key], f"{label}draw.{key}")
            with self.wrong.caught():
                every = _every(key, here)
                drawn |= dict.fromkeys(every, draw(_listed(value, self.folder, here), here))
                lines |= dict.fromkeys(every, self.place(paths["draw", key]))
        for key in grid.keys() & drawn.keys():
            self.says("is drawn and in the grid", paths["grid", key], f"{label}{key}")
        tables, refused = assigned(base, constant.items())
        for key, error in refused if base else ():
            error.place = self.place(paths["set", key], f"{label}set.{key}")
            self.wrong.append(error)
        for key in constant:
            origin = origin.overridden(key, self.place(paths["set", key]))
        place = self.place(path) if path else self.name
        tables = locate(tables, self.folder, place)
        return Part(tables, own.get("name", ""), runs, grid, drawn, self.folder, origin, lines)


def _listed(table, folder, place):
    """Return a distribution; a `choice` that names a CSV file beside the campaign becomes the list of its rows."""
    name = table.get("choice") if isinstance(table, dict) else None
    if not isinstance(name, str):
        return table
    path = folder / name if folder else resources.files("cosim").joinpath("campaigns", name)
    try:
        rows = list(csv.DictReader(read(str(path)).splitlines()))
    except (CosimError, OSError, csv.Error):
        raise CampaignError(f"{name} is no CSV file that can be read", place=place) from None
    return {**table, "choice": [{key: _value(text) for key, text in row.items()} for row in rows]}


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
    if os.path.isfile(found):
        text = read(found)
        return located(toml(text, place=str(found)), found), Origin.of_toml(text, str(found))
    text = resources.files("cosim").joinpath("scenarios", f"{base}.toml").read_text(encoding="utf-8")
    return toml(text, place=str(base)), Origin.of_toml(text, str(base))


def _read(name):
    """Return (name, folder of the file or None, text)."""
    if name in builtin_campaigns():
        return name, None, resources.files("cosim").joinpath("campaigns", f"{name}.toml").read_text(encoding="utf-8")
    path = Path(name)
    try:
        return name, path.parent, read(path, error=CampaignError, what="campaign file")
    except FileNotFoundError:
        near = did_you_mean(name, builtin_campaigns()) or f"Built in: {', '.join(builtin_campaigns())}"
        raise CampaignError("no built-in campaign and no file of this name", place=name, remedy=near) from None
