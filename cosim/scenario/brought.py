"""What a scenario brings along: files of detectors, law and actuators, and a folder with an aircraft.

Each is a name and a digest (cosim/scenario/user_file.py). Where it lies is for this machine only.
"""

import copy
import functools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cosim.errors import Mistakes, ScenarioError
from cosim.scenario.aircraft import ships
from cosim.scenario.user_file import AGREE, CHANGED, UserFile, found, identity
from fdi.registry import GUESTS

SHA256 = "sha256"


class Place(NamedTuple):
    """Where the tables of a scenario name a file: the table, its keys of file and digest, and how they are written."""

    table: dict
    key: str
    digest: str
    name: str


def places(tables: dict[str, Any]) -> Iterator[Place]:
    """Yield every Place of the tables of a scenario, also of one that is not checked yet."""
    flight, law = tables.get("flight"), tables.get("law")
    if isinstance(flight, dict) and isinstance(name := flight.get("aircraft"), str) and not ships(name):
        yield Place(flight, "aircraft", "aircraft_sha256", "flight.aircraft")
    several = [(f"{group}.{n}", t) for group in ("actuators", "detectors") for n, t in _tables(tables.get(group))]
    for name, own in (("law", law), *several):
        for key in ("file", "fmu"):
            if isinstance(own, dict) and isinstance(own.get(key), str) and own[key]:
                yield Place(own, key, SHA256, f"{name}.{key}")


def _tables(group):
    return list(group.items()) if isinstance(group, dict) else []


def locate(tables: dict[str, Any], folder: Path | None, place: str) -> dict[str, Any]:
    """Return the tables of a scenario with every file as a path of this machine: it lies beside the scenario's own file
    (`folder`), or where the path leads from here. Raises ScenarioError for one that is not there.
    """
    if next(places(tables), None) is None:
        return tables
    out, wrong = copy.deepcopy(tables), Mistakes()
    for at in places(out):
        name = at.table[at.key]
        if at.key == "aircraft":
            beside = folder / os.path.expanduser(name) if folder else None
            if beside and os.path.isdir(beside):
                at.table[at.key] = os.path.abspath(beside)
            continue
        with wrong.caught():
            at.table[at.key] = found(name, folder, f"{place}: {at.name}")
    wrong.check()
    return out


def identified(scenario: Any) -> Any:
    """Return the Scenario with the digest of each of its files. Raises ScenarioError where one is not what it means."""
    own = scenario.detectors.model_extra or {}
    if not (scenario.law.file or scenario.actuators or own) and ships(scenario.flight.aircraft):
        return scenario
    table = scenario.model_dump(mode="python", exclude_none=True)
    stamped = {}
    for at in places(table):
        where = f"{at.name} = {at.table[at.key]}"
        if not flies(scenario, at) or _known(at):
            continue
        wanted = at.table.get(at.digest)
        sha256 = identity(at.table[at.key], functools.partial(ScenarioError, place=where)).sha256
        if wanted not in (None, sha256):
            raise ScenarioError(CHANGED, place=where, remedy=AGREE)
        stamped[at.name.rpartition(".")[0]] = {at.digest: sha256}
    if not stamped:
        return scenario
    update: dict[str, Any] = {k: getattr(scenario, k).model_copy(update=stamped[k]) for k in stamped if "." not in k}
    update["actuators"] = {
        n: a.model_copy(update=stamped.get(f"actuators.{n}")) for n, a in scenario.actuators.items()
    }
    tables = {n: {**t, **stamped.get(f"detectors.{n}", {})} for n, t in own.items()}
    return scenario.model_copy(update={**update, "detectors": scenario.detectors.model_copy(update=tables)})


def flies(scenario: Any, at: Place) -> bool:
    """Tell whether what a scenario names flies; a detector may be named and not run."""
    return _detector(at) is None or _detector(at) in scenario.running


def _detector(at):
    group, _, rest = at.name.partition(".")
    return rest.rpartition(".")[0] if group == "detectors" else None


def _known(at):
    """Tell whether a detector is loaded already, from what the scenario means."""
    guest = GUESTS.get(_detector(at))
    return guest is not None and guest.sha256 == at.table.get(at.digest)


def files(tables: dict[str, Any]) -> dict[str, UserFile]:
    """Return {key of the scenario: UserFile} of what the tables bring along; a digest that is not known is empty."""
    return {at.name: UserFile(Path(at.table[at.key]).name, str(at.table.get(at.digest, ""))) for at in places(tables)}


def changed(before: Iterable[tuple[str, UserFile]], now: Iterable[tuple[str, UserFile]]) -> str:
    """Return in a sentence which file is another than it was, of (key, UserFile) of several scenarios; "" for none."""
    was: dict = {}
    for key, file in before:
        was.setdefault((key, file.name), {})[file.sha256] = None
    for key, file in now:
        flown = was.get((key, file.name), {file.sha256: None})
        if file.sha256 not in flown:
            old = ", ".join(sha256[:12] for sha256 in flown)
            return f"{key} = {file.name} is not the file that flew: digest {file.sha256[:12]} here, {old} there"
    return ""


def portable(tables: dict[str, Any], *, aircraft: bool = True) -> dict[str, Any]:
    """Return the tables with names in place of paths; that of an aircraft stays a path where `aircraft` is false."""
    out = copy.deepcopy(tables)
    for at in places(out):
        if aircraft or at.key != "aircraft":
            at.table[at.key] = Path(at.table[at.key]).name
    return out
