"""Read a scenario: a built-in name or a path, overrides on top; every mistake is named, with its line and key.

Overrides `--set key=value` have the keys of the file, lists by index; they are applied in order on a copy of the file's
tables. The index after the last one appends. What excludes another key replaces it: a speed, an amplitude, a bias in
another unit. A new `kind` of manoeuvre or fault drops the numbers that belonged to the old one.
"""

import copy
import os
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cosim.errors import CosimError, Mistakes, ScenarioError, did_you_mean, told_at_call
from cosim.scenario.aircraft import aircraft_of
from cosim.scenario.elevator import OwnActuators, register
from cosim.scenario.flight import PATHS, SPEEDS
from cosim.scenario.manoeuvre import KINDS, RANGES, keys_of
from cosim.scenario.model import Scenario
from cosim.scenario.problem import Origin, explained
from cosim.scenario.user_parts import locate
from cosim.texts import read, toml, unpaired_surrogate

DEFAULT = "liquid-ofc"
UNTITLED = {"duration_s", "seed", "rate_hz", "log_profile", "detectors"}  # no title tells of these
LISTS = ("faults", "flight.air", "flight.gusts")
FORM, EXAMPLE = "is not of the form key=value", "Example: --set faults.0.frequency_hz=3"
KEPT = ("target", "kind", "start_s", "end_s", "ramp_s", "path")
Assignment = tuple[str, Any, str]  # key, value, place in what is said of it


def builtin_names(kind: str = "scenario") -> list[str]:
    """Return the names of what is built in of a `kind`, "scenario" or "campaign", sorted."""
    files = resources.files("cosim").joinpath(f"{kind}s").iterdir()
    return sorted(p.name.removesuffix(".toml") for p in files if p.name.endswith(".toml"))


def text_of(name: str, kind: str, error: type[CosimError]) -> tuple[str, Path | None]:
    """Return (text, folder of the file) of a `kind` that is built in or a file; raises `error`."""
    if not name:
        raise error(f"no {kind} is named", remedy=f"`cosim list` shows the built-in {kind}s")
    known = builtin_names(kind)
    if name in known:
        return resources.files("cosim").joinpath(f"{kind}s", f"{name}.toml").read_text(encoding="utf-8"), None
    try:
        return read(name, error=error, what=f"{kind} file"), Path(name).parent
    except FileNotFoundError:
        near = did_you_mean(name, known) or f"`cosim list` shows the built-in {kind}s"
        raise error(f"no built-in {kind} and no file of this name", place=name, remedy=near) from None


@told_at_call
def load_scenario(name_or_path: str | os.PathLike = DEFAULT, overrides: str | Iterable[str] = ()) -> Scenario:
    """Return the Scenario of a built-in name or a TOML file, `overrides` ("faults.0.frequency_hz=3", or a list) on top.

    A name without a dot or a slash that is built in wins over a file. Raises ScenarioError.
    """
    place = str(name_or_path)
    text, folder = text_of(place, "scenario", ScenarioError)
    overrides = [overrides] if isinstance(overrides, str) else list(overrides)
    table, wrong, said = applied(toml(text, place=place, error=ScenarioError), overrides)
    with wrong.caught():
        origin = Origin(place, text, tuple((key, f"{place}: {override}") for key, _, override in said))
        made = parse(locate(table, folder, place), place=place, origin=origin)
    wrong.check()
    keys = {key.partition(".")[0] for key, *_ in said}
    return made if "title" in keys or keys <= UNTITLED else retitled(made)


def retitled(scenario: Scenario) -> Scenario:
    """Return a scenario that is no longer the one of its title, with a title made of what flies."""
    faults = ", ".join(f"{f.kind} on {f.target}" for f in scenario.faults) or "no fault"
    title = f"{faults}; {scenario.flight.weather}, {scenario.manoeuvre.kind.replace('_', ' ')}"
    return scenario.model_copy(update={"title": title})


def parse(table: dict[str, Any], *, place: str = "scenario", origin: Origin | None = None) -> Scenario:
    """Return the Scenario of nested dicts; raises ScenarioError that names every mistake with `place` or, where
    `origin` tells it, the line or override, key, value and what is allowed."""
    try:
        own = OwnActuators.model_validate(table).actuators
        if own:
            register(own)
        return Scenario.model_validate(table, context={"aircraft": aircraft_of(table), "actuators": tuple(own)})
    except ValidationError as error:
        raise explained(error, table, origin or Origin(place)) from None
    except ScenarioError as error:
        error.place = f"{place}: {error.place}"
        raise


def applied(table: dict[str, Any], overrides: Iterable[str]) -> tuple[dict[str, Any], Mistakes, list[Assignment]]:
    """Return a copy of `table` with every override that can be applied, the errors of the others, and the overrides
    that are of the form."""
    wrong, said = Mistakes(), []
    for text in overrides:
        with wrong.caught():
            said.append(_assignment(text, f"--set {text}"))
    return assigned(table, said, wrong), wrong, said


def assigned(table: dict[str, Any], assignments: Iterable[Assignment], wrong: Mistakes) -> dict[str, Any]:
    """Return a copy of `table` with the value of every assignment that can be set; the errors of the others are put to
    the `wrong` ones."""
    out: dict[str, Any] = copy.deepcopy(table)
    for key, value, place in assignments:
        with wrong.caught():
            _set(out, key, copy.deepcopy(value), place)
    return out


def _assignment(text, place):
    """Return the Assignment of "key=value"."""
    if not isinstance(text, str) or unpaired_surrogate(text):
        raise ScenarioError("is no text in UTF-8", place=place, remedy=EXAMPLE)
    key, equals, value = text.partition("=")
    if not equals:
        raise ScenarioError(FORM, place=place, remedy=EXAMPLE)
    return key.strip(), _value(value.strip()), place


def _value(text):
    """Return the value that `text` has as TOML. What is not TOML is a list of words if it stands in brackets, else the
    text itself."""
    try:
        parsed = toml(f"x = {text}", place="")
    except CosimError:
        return [word.strip("\"' ") for word in text[1:-1].split(",")] if text[:1] + text[-1:] == "[]" else text
    return parsed["x"] if len(parsed) == 1 else text


def _set(table, key, value, place):
    path, node = key.split("."), table
    if not all(path):
        raise ScenarioError(FORM, place=place, remedy=EXAMPLE)
    _open(table, path)
    for i, part in enumerate(path[:-1], 1):
        here = ".".join(path[:i])
        node = node[_at(node, part, here, place)]
        if not isinstance(node, dict | list):
            raise ScenarioError(f"{here} is a value, it has no key {path[i]!r}", place=place)
    if isinstance(node, dict):
        for other in _replaced(node, path, value) - {path[-1]}:
            node.pop(other, None)
    node[_at(node, path[-1], key, place)] = value


def _at(node, part, here, place):
    """Return `part` as a key or index of table or list `node`, after adding a table there where it is the next one."""
    new: list | dict = [] if here in LISTS else {}
    if isinstance(node, dict):
        node.setdefault(part, new)
        return part
    if not part.isdigit() or int(part) > len(node):
        allowed = f"index 0 to {len(node)} ({len(node)} appends)"
        raise ScenarioError(f"{here} is not in the list", place=place, allowed=allowed)
    if int(part) == len(node):
        node.append(new)
    return int(part)


def _open(table, path):
    """Write as tables what the keys of `path` stand below: a manoeuvre that is left out, words of [elevator]; a new
    technology has the default feedback."""
    elevator = table.get("elevator") if isinstance(table.get("elevator"), dict) else {}
    match path:
        case ["manoeuvre", "hold_speed"]:
            table.setdefault("manoeuvre", {"kind": "cruise"})
        case ["elevator", "feedback", _] if isinstance(word := elevator.get("feedback"), str):
            default = aircraft_of(table).technology
            elevator["feedback"] = {name: word for name in default if {**default, **elevator}[name] == "hydraulic"}
        case ["elevator", segment, technology, _, *_] if isinstance(elevator.get(segment), str):
            elevator[segment] = {technology: {}}  # parameters of its actuator
        case ["elevator", segment] if isinstance(elevator.get("feedback"), dict):
            elevator["feedback"].pop(segment, None)


def _replaced(node, path, value):
    """Return the keys of table `node` that go where `path`, one of its keys, is set to `value`."""
    key, stem = path[-1], path[-1].split("_")[0]
    renamed = key == "kind" and value != node.get("kind")
    match path:
        case ["flight", "aircraft"] | ["law", "file"] | ["detectors" | "actuators", _, "file" | "fmu"]:
            return {"aircraft_sha256", "sha256"}
        case ["flight", _]:
            return next((set(group) for group in (SPEEDS, *PATHS) if key in group), set())
        case ["manoeuvre", "kind"] if renamed:
            fields = keys_of(value) if isinstance(value, str) and value in KINDS else ()
            kept = {"start_s", "duration_s", *(["hold_speed"] if node.get("hold_speed") is True else [])}
            return set(node) - (kept & {*fields})
        case ["manoeuvre", "file"]:
            return set(RANGES)
        case ["faults", _, "kind"] if renamed:
            return set(node) - set(KEPT)
        case ["manoeuvre", _] | ["faults", _, _] if stem in ("amplitude", "bias", "drift", "sigma", "backlash"):
            return {k for k in node if k.split("_")[0] == stem}
    return set()
