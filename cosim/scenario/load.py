"""Read a scenario: a built-in name or a path, overrides on top; every mistake is named, with its line and key."""

import os
from collections.abc import Callable, Iterable
from importlib import resources
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from cosim.errors import CosimError, ScenarioError, did_you_mean, joined, told_at_call
from cosim.scenario import inputs, own_actuator
from cosim.scenario.aircraft import DEFAULT as DEFAULT_AIRCRAFT
from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.manoeuvre import KINDS
from cosim.scenario.model import Scenario
from cosim.scenario.override import applied
from cosim.scenario.problem import Origin
from cosim.scenario.user_parts import locate
from cosim.texts import read, toml

DEFAULT = "liquid-ofc"
MISSING, NEAR = "is missing", "Did you mean"
WORDS = {  # what pydantic calls by the names of Python
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "must be a table"),
    **dict.fromkeys(("tuple_type", "list_type"), "must be a list"),
    "string_type": "must be text",
    "bool_type": "must be true or false",
}
NUMBERS = tuple(f"{kind}_{what}" for kind in ("float", "int", "bool") for what in ("type", "parsing"))  # of a text


def builtin_names() -> list[str]:
    """Return the names of the built-in scenarios, sorted."""
    files = resources.files("cosim").joinpath("scenarios").iterdir()
    return sorted(p.name.removesuffix(".toml") for p in files if p.name.endswith(".toml"))


@told_at_call
def load_scenario(name_or_path: str | os.PathLike = DEFAULT, overrides: str | Iterable[str] = ()) -> Scenario:
    """Return the Scenario of a built-in name or a TOML file, `overrides` ("faults.0.frequency_hz=3", or a list) on top.

    A name without a dot or a slash that is built in wins over a file. Raises ScenarioError.
    """
    place, text = _read(name_or_path)
    overrides = [overrides] if isinstance(overrides, str) else list(overrides)
    for given in overrides:
        if not isinstance(given, str):
            allowed = "texts like 'faults.0.frequency_hz=3'"
            raise ScenarioError(f"{given!r} is no text", place="overrides", allowed=allowed)
    table, wrong, said = applied(toml(text, place=place, error=ScenarioError), overrides)

    def origin() -> Origin:
        made = Origin.of_toml(text, place)
        for key, override in said:
            made = made.overridden(key, f"{place}: {override}")
        return made

    with wrong.caught():
        made = parse(located(table, name_or_path), place=place, origin=origin)
    wrong.check()
    keys = {key.partition(".")[0] for key, _ in said}
    return made if "title" in keys or keys <= UNTITLED else retitled(made)


UNTITLED = {"duration_s", "seed", "rate_hz", "log_profile", "detectors"}  # no title tells of these


def retitled(scenario: Scenario) -> Scenario:
    """Return a scenario that is no longer the one of its title, with a title made of what flies."""
    faults = ", ".join(f"{f.kind} on {f.target}" for f in scenario.faults) or "no fault"
    title = f"{faults}; {scenario.flight.weather}, {scenario.manoeuvre.kind.replace('_', ' ')}"
    return scenario.model_copy(update={"title": title})


def located(table: dict[str, Any], name: str | os.PathLike) -> dict[str, Any]:
    """Return the tables of scenario `name` with the files of its user parts found, beside it or from here, and that of
    its inputs read."""
    path = Path(str(name))
    folder = path.parent if os.path.isfile(path) else None
    return inputs.located(locate(table, folder, str(name)), folder, str(name))


def parse(table: dict[str, Any], *, place: str = "scenario", origin: Callable[[], Origin] | None = None) -> Scenario:
    """Return the Scenario of nested dicts; raises ScenarioError that names every mistake with `place` or, where
    `origin` tells it, the line or override, key, value and what is allowed."""
    own_actuator.take(table)
    own = tuple(table["actuators"]) if isinstance(table.get("actuators"), dict) else ()
    try:
        return Scenario.model_validate(table, context={"aircraft": _aircraft(table, place), "actuators": own})
    except ValidationError as error:
        raise explained(error, table, origin() if origin else Origin(place)) from None


def _aircraft(table, place):
    """Return the record of the aircraft that `table` names; what is no name is for the model to refuse."""
    flight = table.get("flight")
    flight = flight if isinstance(flight, dict) else {}
    name, sha256 = flight.get("aircraft", DEFAULT_AIRCRAFT), flight.get("aircraft_sha256")
    try:
        known = name if isinstance(name, str) else DEFAULT_AIRCRAFT
        return load_aircraft(known, sha256 if isinstance(sha256, str) else None)
    except ScenarioError as error:
        error.place = f"{place}: {error.place}"
        raise


def _read(name_or_path):
    name = str(name_or_path)
    if not name:
        raise ScenarioError("no scenario is named", remedy="`cosim list` shows the built-in scenarios")
    if name in builtin_names():
        return name, resources.files("cosim").joinpath("scenarios", f"{name}.toml").read_text(encoding="utf-8")
    try:
        return name, read(name, error=ScenarioError, what="scenario file")
    except FileNotFoundError:
        near = did_you_mean(name, builtin_names()) or "`cosim list` shows the built-in scenarios"
        raise ScenarioError("no built-in scenario and no file of this name", place=name, remedy=near) from None


def explained(
    error: ValidationError, table: dict[str, Any], origin: Origin, root: type[BaseModel] = Scenario,
    kind: type[CosimError] = ScenarioError
) -> CosimError:  # fmt: skip
    """Return pydantic's `error` about `table`, a file of model `root`, as an error of `kind` that names every mistake,
    in the order of the file. Of two about one key the first is told, and none that an unknown key explains."""
    found: dict[str, tuple] = {}
    for one in error.errors(include_url=False):
        key, *said = _said(one, table, root)
        found.setdefault(key, (key, *said))
    near = [(key.rpartition(".")[0], remedy.split("'")[1]) for key, *_, remedy in found.values() if NEAR in remedy]
    slips = {".".join(filter(None, parts)) for parts in near}
    order = {where: n for n, where in enumerate(origin.where.values())}
    made = []
    for key, value, said, allowed, remedy in sorted(found.values(), key=lambda one: order.get(origin.of(one[0]), -1)):
        if said == MISSING and key in slips:
            continue
        where = origin.of(key)
        text = where.partition("--set ")[2]
        if text.partition("=")[0].strip() == key:  # the override of just this key says it all
            where = where.removesuffix(f" {text}")
            place = f"{where} {key}{value or ' = ' + text.partition('=')[2].strip()[:60]}"
        else:
            place = ": ".join(filter(None, (where, key + value)))
        made.append(kind(said, place=place, allowed=allowed, remedy=remedy))
    return joined(made)


def _said(one, table, root):
    """Return (key, " = value", what is wrong, what is allowed, what to do) of one error of pydantic's."""
    ctx, wrong, loc = one.get("ctx", {}), one["type"], list(one["loc"])
    model, field = _walk(root, loc)
    if loc[:1] == ["manoeuvre"] and loc[1:2] and loc[1] in KINDS:  # pydantic's, which the file does not have there
        del loc[1]
    problem, allowed, remedy = one["msg"], "", ""
    if wrong == "cosim":
        loc += [ctx["key"]] if ctx["key"] else []
        allowed, remedy = ctx["allowed"], ctx["remedy"]
    elif wrong == "extra_forbidden":
        known = list(model.model_fields) if model else []
        problem, allowed, remedy = "unknown key", ", ".join(known), did_you_mean(loc[-1], known)
    elif wrong == "missing":
        problem, allowed = MISSING, _range(field)
    elif wrong in ("union_tag_invalid", "union_tag_not_found"):
        loc.append("kind")
        problem, allowed = "is no manoeuvre" if "tag" in ctx else MISSING, ", ".join(KINDS)
        remedy = did_you_mean(str(ctx.get("tag", "")), KINDS)
    elif wrong == "literal_error":
        problem, allowed = "is not one of the choices", ctx["expected"].replace("'", "").replace(" or ", ", ")
    else:
        problem, allowed = problem.removeprefix("Input ").removeprefix("should"), _range(field)
        problem = "is out of range" if "than" in wrong else WORDS.get(wrong, f"must{problem}")
    key = ".".join(map(str, loc))
    return key, "" if wrong == "missing" else _value(table, key, wrong), problem, allowed, remedy


def _value(table, key, wrong):
    """Return " = value" of a key of the tables, "" where there is none or it is a table itself."""
    for part in key.split("."):
        try:
            table = table[int(part) if isinstance(table, list) else part]
        except (KeyError, IndexError, ValueError, TypeError):
            return ""
    if isinstance(table, bool):
        table = str(table).lower()  # as TOML spells it
    elif isinstance(table, str) and wrong in NUMBERS:
        table = f'"{table}"'  # what is wrong are its quotes
    return "" if isinstance(table, dict | list) else f" = {str(table)[:60]}"


def _walk(root, loc):
    """Return (model that holds the last key of `loc`, its FieldInfo), each may be None."""
    model, field, inner = root, None, [root]
    for part in loc:
        if len(inner) > 1:  # one of several manoeuvres, the kind of which pydantic says
            inner = [KINDS[part]] if part in KINDS else []
            continue
        model = inner[0] if inner else None
        field = model.model_fields.get(part) if model else None
        inner = _models(field.annotation) if field else inner  # else a name that the user gave, or a place in a list
    return model, field


def _models(annotation):
    """Return the models that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _range(field):
    if field is None:
        return ""
    parts = [*field.metadata]
    for option in getattr(field.annotation, "__args__", ()):
        parts += [m for meta in getattr(option, "__metadata__", ()) for m in getattr(meta, "metadata", [meta])]
    bounds = {k: getattr(m, k) for m in parts for k in ("ge", "gt", "le", "lt") if getattr(m, k, None) is not None}
    if not {"le", "lt"} & bounds.keys():
        return ""
    low = f"above {_plain(bounds['gt'])}" if "gt" in bounds else _plain(bounds.get("ge", 0))
    return f"{low} to {_plain(bounds.get('le', bounds.get('lt')))}"


def _plain(bound):
    return str(int(bound)) if bound == int(bound) else f"{bound:g}"
