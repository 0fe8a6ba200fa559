"""The campaign file: a base scenario, a grid, draws; every mistake is a CampaignError or ScenarioError with its place.

    title = "..."
    base = "liquid-ofc"             # built-in scenario or file (beside the campaign file)
    runs = 10                       # draws per point of the grid, default 1
    sampling = "latin_hypercube"    # or "random"
    seed = 1                        # of the draws; the flights' own seeds are first_seed, first_seed + 1, ...
    first_seed = 1000000            # unless grid or draw set `seed`; from 1000000 on seeds are for evaluation

    [set]                           # on top of the base, for every run
    duration_s = 30.0
    [grid]                          # factorial: every value with every other, the last key changes fastest
    "faults.0.frequency_hz" = [0.5, 1, 2]
    point = [{ name = "A", "flight.mass_t" = 260.0, "flight.cg_pct" = 28.0 }, ...]    # several keys at once; any word
    [draw]                          # distributions: cosim/campaign_draw.py
    "flight.mass_t" = { low = 200, high = 300 }
    "tolerances.aero.*" = { mean = 1.0, sigma = 0.02 }    # every coefficient on its own
    [keep]                          # logs of the worst runs per rule and detector: cosim/campaign_keep.py
    missed = 1

Keys are those of a scenario, as with --set. A table's `name` becomes the column label.<key>.
"""

import itertools
import json
import tomllib
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from cosim.campaign import EVALUATION_SEED
from cosim.campaign_draw import draw, unit_cube
from cosim.campaign_keep import RULES
from cosim.campaign_store import CampaignError
from cosim.errors import CosimError, did_you_mean
from cosim.scenario import load_scenario, parse
from cosim.scenario.override import apply
from cosim.scenario.tolerance import toleranced

MOST = 1_000_000  # runs; more is a slip of a grid
TYPES = {
    "title": str, "base": str, "runs": int, "sampling": str, "seed": int, "first_seed": int,
    "set": dict, "grid": dict, "draw": dict, "keep": dict,
}  # fmt: skip


@dataclass(frozen=True)
class Campaign:
    """A campaign as written, checked but for the scenarios that it makes."""

    name: str
    base: dict  # tables of the base scenario, `set` applied
    title: str = ""
    runs: int = 1
    sampling: str = "latin_hypercube"
    seed: int = 1
    first_seed: int = EVALUATION_SEED
    grid: dict = field(default_factory=dict)
    draw: dict = field(default_factory=dict)
    keep: dict = field(default_factory=dict)

    def scenarios(self):
        """Return (scenarios, labels): every run, in order. Raises ScenarioError for one that cannot be."""
        points = list(itertools.product(*self.grid.values()))
        n = len(points) * self.runs
        if not 0 < n <= MOST:
            raise CampaignError(f"has {n} runs", place=self.name, allowed=f"1 to {MOST}")
        cube = unit_cube(n, len(self.draw), sampling=self.sampling, seed=self.seed)
        made, labels = [], []
        for i in range(n):
            values, label = {"seed": self.first_seed + i}, {}
            chosen = dict(zip(self.grid, points[i // self.runs]))
            chosen |= {key: one(u) for (key, one), u in zip(self.draw.items(), cube[i])}
            for key, value in chosen.items():
                _put(values, label, key, value)
            made.append(_scenario(self.base, values, f"{self.name}, run {i}"))
            labels.append(label)
        return made, labels


def _put(values, label, key, value):
    """Put what a grid point or draw says into the scenario's keys; a table holds several, and perhaps a name."""
    if not isinstance(value, dict):
        values[key] = value
        return
    for inner, v in value.items():
        if inner == "name":
            label[key] = v
        else:
            values[inner] = v


def _scenario(base, values, place):
    try:
        return parse(apply(base, [f"{k}={json.dumps(v)}" for k, v in values.items()]), place=place)
    except CosimError as error:
        error.place = error.place if error.place.startswith(place) else f"{place}: {error.place}".replace("--set ", "")
        raise


def builtin_campaigns():
    """Return the names of the built-in campaigns, sorted."""
    folder = resources.files("cosim").joinpath("campaigns")
    return sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".toml"))


def load_campaign(name_or_path):
    """Return the Campaign of a built-in name or a TOML file. Raises CampaignError, ScenarioError."""
    name, folder, text = _read(str(name_or_path))
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CampaignError(f"not valid TOML: {error}", place=name) from None
    for key, value in table.items():
        if key not in TYPES:
            raise CampaignError(
                f"unknown key {key!r}", place=name, allowed=", ".join(TYPES), remedy=did_you_mean(key, TYPES)
            )
        if not isinstance(value, TYPES[key]) or isinstance(value, bool):
            raise CampaignError(f"{key} is no {_word(TYPES[key])}", place=name)
    return _checked(name, folder, table)


def _word(kind):
    return {str: "text", int: "whole number", dict: "table"}[kind]


def _checked(name, folder, table):
    if not 1 <= table.get("runs", 1) <= MOST:
        raise CampaignError(f"runs = {table['runs']}", place=name, allowed=f"1 to {MOST}")
    if table.get("sampling", "random") not in ("random", "latin_hypercube"):
        raise CampaignError(f"sampling = {table['sampling']!r}", place=name, allowed="random, latin_hypercube")
    for key in ("seed", "first_seed"):
        if not 0 <= table.get(key, 0) < 2**31 - MOST:
            raise CampaignError(f"{key} = {table[key]}", place=name, allowed=f"0 to {2**31 - MOST - 1}")
    for rule, count in table.get("keep", {}).items():
        if rule not in RULES:
            near = did_you_mean(rule, RULES)
            raise CampaignError("is no rule", place=f"{name}: keep.{rule}", allowed=", ".join(RULES), remedy=near)
        if isinstance(count, bool) or not isinstance(count, int) or not 0 < count <= 100:
            raise CampaignError(f"{count!r} is no number of logs", place=f"{name}: keep.{rule}", allowed="1 to 100")
    for key, values in table.get("grid", {}).items():
        if not isinstance(values, list) or not values:
            raise CampaignError("is no list of values", place=f"{name}: grid.{key}")
    draws = {}
    for key, value in table.get("draw", {}).items():
        for each in _every(key):
            draws[each] = draw(value, f"{name}: draw.{key}")
    for key in draws:
        if key in table.get("grid", {}):
            raise CampaignError("is drawn and in the grid", place=f"{name}: {key}")
    base = _base(table.get("base", "cruise"), folder)
    constant = [f"{k}={json.dumps(v)}" for k, v in table.get("set", {}).items()]
    kept = {k: v for k, v in table.items() if k not in ("base", "set", "draw")}
    return Campaign(name=name, base=apply(base, constant), draw=draws, **kept)


def _every(key):
    """Return the keys that a trailing .* stands for: tolerances.aero.*, .hydraulic.*, .ema.*"""
    group, star = key.removesuffix(".*").removeprefix("tolerances."), key.endswith(".*")
    if not star:
        return [key]
    if group not in ("aero", "hydraulic", "ema") or not key.startswith("tolerances."):
        allowed = "tolerances.aero.*, tolerances.hydraulic.*, tolerances.ema.*"
        raise CampaignError("* stands for nothing here", place=f"draw.{key}", allowed=allowed)
    return [f"tolerances.{group}.{name}" for name in toleranced(group)]


def _base(base, folder):
    """Return the tables of the base scenario as written, so that defaults that follow from other keys still follow."""
    beside = folder / base if folder else Path(base)
    found = beside if beside.is_file() else Path(base)
    load_scenario(str(found))  # says what is wrong with the base itself
    if found.is_file():
        return tomllib.loads(found.read_text(encoding="utf-8-sig"))
    return tomllib.loads(resources.files("cosim").joinpath("scenarios", f"{base}.toml").read_text(encoding="utf-8"))


def _read(name):
    """Return (name, folder of the file or None, text)."""
    builtin = resources.files("cosim").joinpath("campaigns", f"{name}.toml")
    if "/" not in name and "." not in name and builtin.is_file():
        return name, None, builtin.read_text(encoding="utf-8")
    path = Path(name)
    try:
        return name, path.parent, path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        near = did_you_mean(name, builtin_campaigns()) or f"Built in: {', '.join(builtin_campaigns())}"
        raise CampaignError("no built-in campaign and no file of this name", place=name, remedy=near) from None
    except IsADirectoryError:
        raise CampaignError("is a folder, not a campaign file", place=name) from None
    except UnicodeDecodeError as error:
        raise CampaignError(f"is not UTF-8 text (byte {error.start})", place=name) from None
