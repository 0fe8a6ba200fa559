"""Read a scenario: a built-in name or a path, overrides on top; every mistake is named, with its line and key."""

import os
from collections.abc import Callable, Iterable
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from cosim.errors import ScenarioError, did_you_mean, told_at_call
from cosim.scenario import inputs
from cosim.scenario.aircraft import aircraft_of
from cosim.scenario.model import Scenario
from cosim.scenario.override import applied
from cosim.scenario.own_actuator import OwnActuators, register
from cosim.scenario.problem import Origin, explained
from cosim.scenario.user_parts import locate
from cosim.texts import read, toml

DEFAULT = "liquid-ofc"


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
    try:
        own = OwnActuators.model_validate(table).actuators
        if own:
            register(own)
        return Scenario.model_validate(table, context={"aircraft": aircraft_of(table), "actuators": tuple(own)})
    except ValidationError as error:
        raise explained(error, table, origin() if origin else Origin(place)) from None
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
