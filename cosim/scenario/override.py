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
from cosim.texts import toml, unpaired_surrogate

LISTS = ("faults", "flight.air", "flight.gusts")
FORM, EXAMPLE = "is not of the form key=value", "Example: --set faults.0.frequency_hz=3"
KEPT = ("target", "kind", "start_s", "end_s", "ramp_s", "path")
Assignment = tuple[str, Any, str]  # key, value, place in what is said of it


def applied(table: dict[str, Any], overrides: Iterable[str]) -> tuple[dict[str, Any], Mistakes, list[Assignment]]:
    """Return a copy of `table` with every override that can be applied, the errors of the others, and the overrides
    that are of the form."""
    wrong, said = Mistakes(), []
    for text in overrides:
        with wrong.caught():
            said.append(_read(text, f"--set {text}"))
    return assigned(table, said, wrong), wrong, said


def assigned(table: dict[str, Any], assignments: Iterable[Assignment], wrong: Mistakes) -> dict[str, Any]:
    """Return a copy of `table` with the value of every assignment that can be set; the errors of the others are put to
    the `wrong` ones."""
    out: dict[str, Any] = copy.deepcopy(table)
    for key, value, place in assignments:
        with wrong.caught():
            _set(out, key, copy.deepcopy(value), place)
    return out


def _read(text, place):
    """Return the Assignment of "key=value"."""
    if not isinstance(text, str) or unpaired_surrogate(text):
        raise ScenarioError("is no text in UTF-8", place=place, remedy=EXAMPLE)
    key, equals, value = text.partition("=")
    if not equals:
        raise ScenarioError(FORM, place=place, remedy=EXAMPLE)
    return key.strip(), _value(value.strip()), place


def _value(text):
    """Return the value of TOML; a text that is none is a string, in brackets a list of them: words need no quotes."""
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
