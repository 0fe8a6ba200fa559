"""`--set key=value`: the keys of the file, lists by index, applied in order on a copy of the file's tables.

The index after the last one appends. What excludes another key replaces it: a speed, an amplitude, a bias in another
unit. A new `kind` of manoeuvre or fault drops the numbers that belonged to the old one.
"""

import copy
from collections.abc import Iterable
from typing import Any

from cosim.errors import CosimError, Mistakes, ScenarioError
from cosim.scenario.aircraft import aircraft_of
from cosim.scenario.flight import PATHS, SPEEDS
from cosim.scenario.inputs import RANGES
from cosim.scenario.manoeuvre import KINDS, keys_of
from cosim.scenario.toml import inline
from cosim.texts import toml, unpaired_surrogate

LISTS = ("faults", "flight.air", "flight.gusts")
FORM, EXAMPLE = "is not of the form key=value", "Example: --set faults.0.frequency_hz=3"
KEPT = ("target", "kind", "start_s", "end_s", "ramp_s", "path")


def applied(
    table: dict[str, Any], overrides: Iterable[str]
) -> tuple[dict[str, Any], Mistakes, list[tuple[str, str]]]:
    """Return a copy of `table` with every override that can be applied, the errors of the others, and (key, "--set
    key=value") of each applied."""
    out, wrong, said = copy.deepcopy(table), Mistakes(), []
    for text in overrides:
        place = f"--set {text}"
        with wrong.caught():
            if not isinstance(text, str) or unpaired_surrogate(text):
                raise ScenarioError("is no text in UTF-8", place=place, remedy=EXAMPLE)
            key, equals, value = text.partition("=")
            if not equals:
                raise ScenarioError(FORM, place=place, remedy=EXAMPLE)
            _set(out, key.strip(), _parse(value.strip()), place)
            said.append((key.strip(), place))
    return out, wrong, said


def assigned(table: dict[str, Any], pairs: Iterable[tuple[str, Any]]) -> tuple[dict[str, Any], list]:
    """Return a copy of `table` with the value of every (key, value) that can be set, and (key, error) of the others."""
    out: dict[str, Any] = copy.deepcopy(table)
    wrong = []
    for key, value in pairs:
        try:
            _set(out, key, copy.deepcopy(value) if isinstance(value, dict | list) else value, key)
        except ScenarioError as error:
            error.place = f"{key} = {inline(value)}"
            wrong.append((key, error))
    return out, wrong


def _parse(value):
    """Return a TOML value; a text that is not TOML is a string, so that words need no quotes."""
    try:
        parsed = toml(f"x = {value}", place="")
    except CosimError:
        return value
    return parsed["x"] if len(parsed) == 1 else value


def _set(table, key, value, place):
    path, node = key.split("."), table
    if not all(path):
        raise ScenarioError(FORM, place=place, remedy=EXAMPLE)
    _open(table, path)
    for i, part in enumerate(path[:-1]):
        here = ".".join(path[: i + 1])
        new: list | dict = [] if here in LISTS else {}
        node = _item(node, part, here, place) if isinstance(node, list) else node.setdefault(part, new)
        if not isinstance(node, dict | list):
            raise ScenarioError(f"{here} is a value, it has no key {path[i + 1]!r}", place=place)
    if isinstance(node, list):
        _item(node, path[-1], key, place, value)
        return
    if path[0] == "elevator" and isinstance(node.get("feedback"), dict):
        node["feedback"].pop(path[-1], None)  # the default of the new technology
    for other in _replaced(node, path, value) - {path[-1]}:
        node.pop(other, None)
    node[path[-1]] = value


def _open(table, path):
    """Write as tables what the keys of `path` stand below: a manoeuvre that is left out, words of [elevator]."""
    elevator = table.get("elevator")
    if path == ["manoeuvre", "hold_speed"]:
        table.setdefault("manoeuvre", {"kind": "cruise"})
    if path[0] != "elevator" or len(path) < 3 or not isinstance(elevator, dict):
        return
    word = elevator.get(path[1])
    if path[1] == "feedback" and isinstance(word, str):  # of all hydraulic segments
        default = aircraft_of(table).technology
        elevator["feedback"] = {name: word for name in default if {**default, **elevator}[name] == "hydraulic"}
    elif isinstance(word, str) and len(path) > 3:  # parameters of its actuator
        elevator[path[1]] = {path[2]: {}}


def _item(items, index, here, place, value=None):
    """Return items[index], appended as a table when it is the next one; sets it when `value` is given."""
    if not index.isdigit() or int(index) > len(items):
        allowed = f"index 0 to {len(items)} ({len(items)} appends)"
        raise ScenarioError(f"{here} is not in the list", place=place, allowed=allowed)
    if int(index) == len(items):
        items.append({})
    if value is not None:
        items[int(index)] = value
    return items[int(index)]


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
            return {k for k in node if k not in fields or k not in kept}
        case ["manoeuvre", "file"]:
            return set(RANGES)
        case ["faults", _, "kind"] if renamed:
            return set(node) - set(KEPT)
        case ["manoeuvre", _] | ["faults", _, _] if stem in ("amplitude", "bias", "drift", "sigma", "backlash"):
            return {k for k in node if k.split("_")[0] == stem}
    return set()
