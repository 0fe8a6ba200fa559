"""What a scenario brings along: files of detectors, law and actuators, and a folder with an aircraft.

Each is a name and a digest (cosim/scenario/user_file.py). Where it lies is for this machine only.
"""

import copy
import functools
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from cosim.errors import LogError, Mistakes, OutputError, ScenarioError
from cosim.files import replace
from cosim.scenario import toml
from cosim.scenario.aircraft import placed, ships
from cosim.scenario.user_file import AGREE, CHANGED, UserFile, contents, found, identity
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
    groups = [(g, tables[g]) for g in ("actuators", "detectors") if isinstance(tables.get(g), dict)]
    for name, own in (("law", law), *((f"{g}.{n}", own) for g, table in groups for n, own in table.items())):
        for key in ("file", "fmu"):
            if isinstance(own, dict) and isinstance(own.get(key), str) and own[key]:
                yield Place(own, key, SHA256, f"{name}.{key}")


def locate(tables: dict[str, Any], folder: Path | None, place: str) -> dict[str, Any]:
    """Return the tables of a scenario with every file as a path of this machine: it lies beside the scenario's own file
    (`folder`), or where the path leads from here. Raises ScenarioError for one that is not there."""
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
    own = scenario.law.file or scenario.actuators or scenario.detectors.model_extra
    if not own and ships(scenario.flight.aircraft):
        return scenario
    table, stamped = scenario.model_dump(mode="python", exclude_none=True), False
    for at in places(table):
        where, wanted = f"{at.name} = {at.table[at.key]}", at.table.get(at.digest)
        if not flies(scenario, at) or _known(at):
            continue
        at.table[at.digest] = identity(at.table[at.key], functools.partial(ScenarioError, place=where)).sha256
        if wanted not in (None, at.table[at.digest]):
            raise ScenarioError(CHANGED, place=where, remedy=AGREE)
        stamped = True
    context = {"aircraft": scenario.aircraft, "actuators": tuple(scenario.actuators)}
    return type(scenario).model_validate(table, context=context) if stamped else scenario


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


FOLDER = "user_files"  # of the names of attachments: user_files/law/law.py
MOST = 16 << 20  # [byte] a larger file is known by its digest alone: a log stays one that can be sent
_aircraft: list[Any] = []  # folders of aircraft that logs have brought into this process


def sources(scenario: Any) -> dict[str, tuple[str, bytes]]:
    """Return {attachment: (media type, bytes)} of the files that a flight of `scenario` is made of."""
    out = {}
    for at in places(scenario.model_dump(mode="python", exclude_none=True)):
        if not flies(scenario, at):
            continue
        for name, path in contents(at.table[at.key]).items():
            if path.stat().st_size <= MOST:
                out[f"{FOLDER}/{_part(at)}/{name}"] = ("application/octet-stream", path.read_bytes())
    return out


def write(tables: dict[str, Any], attachments: Mapping[str, bytes], folder: Path) -> list[str]:
    """Write the scenario of a log and its attached sources into `folder`, from where they fly; return the keys whose
    files the log does not hold. Raises OutputError for a folder that holds something, LogError for names that lead out
    of it.
    """
    files = dict(_files(attachments))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = any(folder.iterdir())
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}", place=str(folder)) from None
    if held:
        raise OutputError("holds something", place=str(folder), remedy="Choose an empty folder, or a new one, with -o")
    missing = []
    for at in places(tables):
        name = PurePosixPath(_part(at)) / Path(at.table[at.key]).name
        there = any(path == name or name in path.parents for path in files)
        at.table[at.key] = name.as_posix() if there else Path(at.table[at.key]).name
        missing += [] if there else [at.name]
    _unpack({**files, PurePosixPath("scenario.toml"): toml.dumps(tables).encode()}, folder)
    return missing


def _unpack(files, folder):
    for path, data in files.items():
        replace(folder / path, lambda part, data=data: part.write_bytes(data))


def bring_aircraft(tables: dict[str, Any], attachments: Mapping[str, bytes], place: str) -> None:
    """Make the attached aircraft of a log known, which is data, so that its scenario can be read. Raises LogError where
    it is not the one that the scenario means."""
    at = next((at for at in places(tables) if at.key == "aircraft"), None)
    sha256 = at and at.table.get(at.digest)
    files = {path: data for path, data in _files(attachments) if path.parts[0] == "flight"}
    if at is None or not isinstance(sha256, str) or not files or placed(sha256):
        return
    home = tempfile.TemporaryDirectory(prefix="cosim-aircraft-")
    try:
        _unpack(files, Path(home.name))
    except OutputError as error:
        raise LogError(f"its aircraft cannot be written out: {error.problem}", place=place) from None
    folder = Path(home.name) / "flight" / Path(at.table[at.key]).name
    if not folder.is_dir() or identity(folder).sha256 != sha256:
        raise LogError("is damaged: its aircraft is not the one that flew", place=place)
    _aircraft.append(home)
    placed(sha256, folder)


def _part(at):
    """Return the folder of a file: the key of the table that names it."""
    return at.name.rpartition(".")[0]


def _files(attachments: Mapping[str, bytes]) -> Iterator[tuple[PurePosixPath, bytes]]:
    """Yield (path, bytes) of what is attached. Raises LogError for a path that leads elsewhere."""
    for name, data in attachments.items():
        top, _, rest = name.partition("/")
        if top != FOLDER:
            continue
        path = PurePosixPath(rest)
        wrong = any(part in ("..", "") or set(part) & set('\\:\0') or not part.isprintable() for part in path.parts)
        if wrong or path.is_absolute() or len(path.parts) < 2 or path.as_posix() != rest:
            raise LogError(f"is damaged: attachment {name!r}", place="log")
        yield path, data
