"""Read a scenario: a built-in name or a path, overrides on top; every mistake is named, with its line and key."""

import os
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cosim.errors import CosimError, ScenarioError, did_you_mean, told_at_call
from cosim.scenario import inputs
from cosim.scenario.aircraft import aircraft_of
from cosim.scenario.model import Scenario
from cosim.scenario.override import applied
from cosim.scenario.own_actuator import OwnActuators, register
from cosim.scenario.problem import Origin, explained
from cosim.scenario.user_parts import locate
from cosim.texts import read, toml

DEFAULT = "liquid-ofc"


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
        made = parse(located(table, folder, place), place=place, origin=origin)
    wrong.check()
    keys = {key.partition(".")[0] for key, *_ in said}
    return made if "title" in keys or keys <= UNTITLED else retitled(made)


UNTITLED = {"duration_s", "seed", "rate_hz", "log_profile", "detectors"}  # no title tells of these


def retitled(scenario: Scenario) -> Scenario:
    """Return a scenario that is no longer the one of its title, with a title made of what flies."""
    faults = ", ".join(f"{f.kind} on {f.target}" for f in scenario.faults) or "no fault"
    title = f"{faults}; {scenario.flight.weather}, {scenario.manoeuvre.kind.replace('_', ' ')}"
    return scenario.model_copy(update={"title": title})


def located(table: dict[str, Any], folder: Path | None, place: str) -> dict[str, Any]:
    """Return the tables of a scenario with the files of its user parts found, beside it (`folder`) or from here, and
    that of its inputs read."""
    return inputs.located(locate(table, folder, place), folder, place)


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
