"""User files and folders that a scenario names: detectors, law, actuators, models, an aircraft.

A part is a file or a folder. Its digest is over what lies there, hidden files and compiled code left out; what its code
reads from elsewhere is not in the digest. Name and digest say which part is meant, on every machine; where it lies is
for this machine only. A folder with Python code is a package: `__init__.py`, and relative imports of what lies beside
it. To read a scenario runs nothing.
"""

import copy
import functools
import hashlib
import importlib.util
import logging
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any, NamedTuple

from actuators.exception_text import sentence
from cosim.errors import CosimError, LogError, Mistakes, OutputError, ScenarioError
from cosim.files import replace
from cosim.scenario import toml
from cosim.scenario.aircraft import bundled
from fdi.registry import USER_DETECTORS

SHA256 = "sha256"
CHANGED, AGREE = "is not the file that the scenario means: its digest differs", "Read it, then remove or renew sha256"
_loaded: dict[Path, tuple[str, ModuleType]] = {}  # path -> its digest when it was run, its module


class UserPart(NamedTuple):
    """A user part by its name and the SHA-256 of what lies there."""

    name: str
    sha256: str


@functools.cache
def _announce(part: UserPart) -> None:
    """Say once that the code of a part runs; the command line prints it."""
    logging.getLogger("cosim").info("runs code: %s, sha256 %s", *part)


def contents(path: str | os.PathLike) -> dict[str, Path]:
    """Return {name: path} of a file, or of every file of a folder but hidden ones and compiled code; names from the
    folder around it on."""
    path = Path(os.path.realpath(os.path.expanduser(path)))
    every = [path] if not path.is_dir() else (Path(top) / name for top, _, names in os.walk(path) for name in names)
    found = {file.relative_to(path.parent).as_posix(): file for file in every}
    return {name: found[name] for name in sorted(found) if not any(map(_hidden, name.split("/")[1:]))}


def _hidden(name):
    return name.startswith(".") or name == "__pycache__"


def identity(path: str | os.PathLike) -> UserPart:
    """Return what lies at `path`; nothing is run. Raises ScenarioError for what cannot be read."""
    path, out = Path(os.path.realpath(os.path.expanduser(path))), hashlib.sha256()
    for name, file in contents(path).items():
        out.update(os.fsencode(name.removeprefix(f"{path.name}/") if path.is_dir() else name) + b"\0")
        try:
            out.update(file.read_bytes())
        except OSError as error:
            raise ScenarioError(f"cannot be read: {error.strerror}", place=str(file)) from None
    return UserPart(path.name, out.hexdigest())


def load(path: str | os.PathLike, error: Callable[[str], Exception]) -> tuple[ModuleType, UserPart]:
    """Run a Python file, or a folder with `__init__.py`, once per content; return (its module, what it is).

    Whatever it raises becomes `error(text)`.
    """
    path = Path(os.path.realpath(os.path.expanduser(path)))
    file = path / "__init__.py" if path.is_dir() else path
    if file.suffix != ".py" or not file.is_file():
        raise error("is no Python code; allowed: a file that ends in .py, a folder with __init__.py")
    part = identity(path)
    if _loaded.get(path, ("",))[0] != part.sha256:
        if path in _loaded:
            from actuators.kernels import forget  # it needs NumPy

            forget()  # compiled code of the part as it was
        _loaded[path] = part.sha256, _run(path, file, part, error)
    return _loaded[path][1], part


def _run(path, file, part, error):
    _announce(part)
    name = f"cosim_user_{path.stem}_{part.sha256[:12]}"
    spec = importlib.util.spec_from_file_location(name, file, submodule_search_locations=[str(path)] * path.is_dir())
    assert spec is not None and spec.loader is not None
    module, here, before = importlib.util.module_from_spec(spec), os.getcwd(), sys.dont_write_bytecode
    sys.modules[name], sys.dont_write_bytecode = module, True
    try:
        with redirect_stdout(sys.stderr):  # standard output is the program's own
            exec(compile(file.read_bytes(), str(file), "exec"), vars(module))  # as it stands, whatever __pycache__ has
    except BaseException as wrong:
        sys.modules.pop(name)
        if isinstance(wrong, KeyboardInterrupt | CosimError):
            raise
        raise error(f"does not run: {sentence(wrong, path)}") from wrong
    finally:
        sys.dont_write_bytecode = before
        os.chdir(here)
    return module


class Place(NamedTuple):
    """Where the tables of a scenario name a file: the table, its keys of file and digest, and how they are written."""

    table: dict
    key: str
    digest: str
    part: str  # the table, "detectors.parity"

    @property
    def name(self) -> str:
        """Return the key of the scenario, "detectors.parity.file"."""
        return f"{self.part}.{self.key}"

    @property
    def path(self) -> Path:
        """Return what is named."""
        return Path(os.path.expanduser(self.table[self.key]))


def places(tables: dict[str, Any]) -> Iterator[Place]:
    """Yield every Place of the tables of a scenario, also of one that is not checked yet; that of a manoeuvre is read
    with the scenario, which then holds its numbers."""
    flight = tables.get("flight")
    if isinstance(flight, dict) and isinstance(name := flight.get("aircraft"), str) and name not in bundled():
        yield Place(flight, "aircraft", "aircraft_sha256", "flight")
    every = {part: tables.get(part) for part in ("law", "manoeuvre")}
    for group in ("actuators", "detectors"):
        own = tables.get(group)
        every |= {f"{group}.{name}": table for name, table in own.items()} if isinstance(own, dict) else {}
    for part, table in every.items():
        for key in ("file", "fmu"):
            if isinstance(table, dict) and isinstance(table.get(key), str) and table[key]:
                yield Place(table, key, SHA256, part)


def locate(tables: dict[str, Any], folder: Path | None, place: str) -> dict[str, Any]:
    """Return the tables of a scenario with every file as a path of this machine: it lies beside the scenario's own file
    (`folder`), or where the path leads from here; that of inputs is a Path, which a file or a log cannot hold. Raises
    ScenarioError for one that is not there; what an aircraft's name means `load_aircraft` says."""
    out, wrong = copy.deepcopy(tables), Mistakes()
    for at in places(out):
        with wrong.caught():
            if at.key != "aircraft" or os.path.isdir((folder or Path()) / at.path):
                found = find(at.table[at.key], folder, f"{place}: {at.name}")
                at.table[at.key] = Path(found) if at.part == "manoeuvre" else found
    wrong.check()
    return out


def find(name: str, folder: Path | None, place: str) -> str:
    """Return the path of a part, from beside the scenario (`folder`) or from here. Raises ScenarioError."""
    path = Path(os.path.expanduser(name))
    for here in (folder / path if folder else path, path):
        if os.path.exists(here):
            return os.path.abspath(here)
    raise ScenarioError("no such file", place=f"{place} = {name}")


def identified(scenario: Any) -> Any:
    """Return the Scenario with the digest of each of its files. Raises ScenarioError where one is not what it means."""
    table, stamped = scenario.model_dump(mode="python", exclude_none=True), False
    for at in places(table):
        wanted, known = at.table.get(at.digest), USER_DETECTORS.get(at.part.removeprefix("detectors."))
        if not flies(scenario, at) or (known is not None and known.sha256 == wanted):
            continue  # a detector that is not needed, or is loaded already from what the scenario means
        part = identity(at.path)
        if wanted not in (None, part.sha256):
            raise ScenarioError(CHANGED, place=f"{at.name} = {at.table[at.key]}", remedy=AGREE)
        if at.key == "fmu":
            _announce(part)
        at.table[at.digest] = part.sha256
        stamped = True
    context = {"aircraft": scenario.aircraft, "actuators": tuple(scenario.actuators)}
    return type(scenario).model_validate(table, context=context) if stamped else scenario


def flies(scenario: Any, at: Place) -> bool:
    """Tell whether what a scenario names flies; a detector may be named and not run."""
    group, _, name = at.part.partition(".")
    return group != "detectors" or name in scenario.running


FOLDER = "user_files"  # of the names of attachments: user_files/law/law.py
MOST = 16 << 20  # [byte] a larger file is known by its digest alone: a log stays one that can be sent
_aircraft: dict[str, Any] = {}  # digest -> temporary folder of an aircraft that came with a log


def sources(scenario: Any) -> dict[str, tuple[str, bytes]]:
    """Return {attachment: (media type, bytes)} of the files that a flight of `scenario` is made of."""
    tables = scenario.model_dump(mode="python", exclude_none=True)
    files = {f"{FOLDER}/{at.part}/{name}": path for at in places(tables) if flies(scenario, at)
             for name, path in contents(at.path).items()}  # fmt: skip
    kind = "application/octet-stream"
    return {name: (kind, path.read_bytes()) for name, path in files.items() if path.stat().st_size <= MOST}


def write(tables: dict[str, Any], attachments: Mapping[str, bytes], folder: Path) -> list[str]:
    """Write the scenario of a log and its attached sources into `folder`, from where they fly; return the keys whose
    files the log does not hold. Raises OutputError for a folder that holds something, LogError for names that lead out
    of it.
    """
    files = _files(attachments)
    if any(folder.glob("*")):
        raise OutputError("holds something", place=str(folder), remedy="Choose an empty folder, or a new one, with -o")
    missing = []
    for at in places(tables):
        name = PurePosixPath(at.part, at.path.name)
        there = any(path == name or name in path.parents for path in files)
        at.table[at.key] = name.as_posix() if there else name.name
        missing += [] if there else [at.name]
    _unpack({**files, PurePosixPath("scenario.toml"): toml.dumps(tables).encode()}, folder)
    return missing


def _unpack(files, folder):
    for path, data in files.items():
        replace(folder / path, lambda part, data=data: part.write_bytes(data))


def bring_aircraft(tables: dict[str, Any], attachments: Mapping[str, bytes], place: str) -> None:
    """Unpack the attached aircraft of a log, which is data, and name its folder in `tables`. Raises LogError where it
    is not the one that the scenario means."""
    at = next((at for at in places(tables) if at.key == "aircraft"), None)
    files = {path: data for path, data in _files(attachments).items() if path.parts[0] == "flight"}
    if at is None or not files:
        return
    sha256 = str(at.table.get(at.digest))
    if sha256 not in _aircraft:
        home = tempfile.TemporaryDirectory(prefix="cosim-aircraft-")
        _unpack(files, Path(home.name))
        folder = Path(home.name, "flight", at.path.name)
        if not folder.is_dir() or identity(folder).sha256 != sha256:
            raise LogError("is damaged: its aircraft is not the one that flew", place=place)
        _aircraft[sha256] = home
    at.table[at.key] = str(Path(_aircraft[sha256].name, "flight", at.path.name))


def _files(attachments: Mapping[str, bytes]) -> dict[PurePosixPath, bytes]:
    """Return {path: bytes} of what is attached. Raises LogError for a path that leads elsewhere."""
    out = {}
    for name in (name for name in attachments if name.startswith(f"{FOLDER}/")):
        path = PurePosixPath(name.removeprefix(f"{FOLDER}/"))
        odd = any(_hidden(part) or set(part) & set('\\:\0') or not part.isprintable() for part in path.parts)
        if odd or path.is_absolute() or len(path.parts) < 2 or f"{FOLDER}/{path.as_posix()}" != name:
            raise LogError(f"is damaged: attachment {name!r}", place="log")
        out[path] = attachments[name]
    return out
