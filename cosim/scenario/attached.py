"""Sources of a user's files in a log: attached as they flew, written out on request, never run unasked."""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from cosim.errors import LogError, OutputError
from cosim.files import replace
from cosim.scenario import toml
from cosim.scenario.aircraft import placed
from cosim.scenario.brought import flies, places
from cosim.scenario.user_file import contents, identity

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
    for path, data in {**files, PurePosixPath("scenario.toml"): toml.dumps(tables).encode()}.items():
        replace(folder / path, lambda part, data=data: part.write_bytes(data))
    return missing


def bring_aircraft(tables: dict[str, Any], attachments: Mapping[str, bytes], place: str) -> None:
    """Make the attached aircraft of a log known, which is data, so that its scenario can be read. Raises LogError where
    it is not the one that the scenario means.
    """
    at = next((at for at in places(tables) if at.key == "aircraft"), None)
    sha256 = at and at.table.get(at.digest)
    files = {path: data for path, data in _files(attachments) if path.parts[0] == "flight"}
    if at is None or not isinstance(sha256, str) or not files or placed(sha256):
        return
    home = tempfile.TemporaryDirectory(prefix="cosim-aircraft-")
    try:
        for path, data in files.items():
            to = Path(home.name) / path
            to.parent.mkdir(parents=True, exist_ok=True)
            to.write_bytes(data)
    except OSError as error:
        raise LogError(f"its aircraft cannot be written out: {error.strerror}", place=place) from None
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
