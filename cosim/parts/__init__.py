"""User detectors, from a file, a folder or a program.

It is a plain Python class (`detector.py`), a block as ours are (actuators/block.py), or a fitted model over a window of
signals (`window.py`), from a file that a scenario or a command line names, or from `cosim.register(Parity)`. Its code
has its user's rights: it is run as it stands, and only a file that the user has named is run
(cosim/scenario/user_parts.py loads it).
"""

import functools
import hashlib
import inspect
import os
import tomllib
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from cosim.errors import among, did_you_mean
from cosim.parts.detector import PartError, PlainDetector, block_detector, is_block, is_detector_class, rollout_of
from cosim.scenario import Scenario, parse, user_parts
from cosim.texts import unpaired_surrogate
from fdi import registry

__all__ = ["PartError", "load", "loaded", "register", "rollout_of", "use", "with_detectors"]
KEYS = ("file", "sha256")  # of the table of a user's detector, beside its parameters


def register(part: Any) -> Any:
    """Make a detector known to this process: a class, or a module that is a block. It flies in every scenario that does
    not choose its detectors. Returns it, so that it serves as a decorator. Raises PartError for what is no detector.
    """
    _install(_made(part, _source(part)))
    return part


def _install(part):
    """Take a user's detector into the registry and return it; raises PartError for the id of one that ships."""
    name = part.DETECTOR.id
    if name in registry.SHIPPED:
        raise PartError(f"{name!r} is a detector that ships", place=part.file or name, remedy="Choose another id")
    registry.USER_DETECTORS[name] = part
    return part


def load(name: str | os.PathLike) -> Any:
    """Return the detector of a file or a folder, known to this process from now on.

    Raises PartError for a file that is not there, does not run, or holds no detector or several.
    """
    path = Path(os.path.expanduser(name))
    if unpaired_surrogate(str(path)):
        raise PartError("its name is not UTF-8, which a log needs", place=str(path), remedy="Rename it")
    if not os.path.exists(path):
        near = [str(path.with_name(p.name)) for p in path.parent.glob("*.py")]
        raise PartError("no such file", place=str(name), remedy=did_you_mean(name, near))
    module, part = user_parts.load(path, lambda text: PartError(text, place=str(name)))
    return _install(_only(module, str(path.resolve()), part.sha256))


def loaded(files: Iterable[str | os.PathLike]) -> list[Any]:
    """Return the detectors of several files, each once; raises PartError, also where two have one id."""
    out: dict[str, Any] = {}
    for file in files:
        part = load(file)
        before = out.setdefault(part.DETECTOR.id, part)
        if before is not part:
            raise _twice(part.DETECTOR.id, before.file, file)
    return list(out.values())


def _twice(name, one, other):
    said = f"has the id {name!r}, as {one} has: a flight has one detector of an id"
    return PartError(said, place=str(other), remedy="Choose another id, or leave one out")


def use(scenario: Scenario) -> None:
    """Load the user's detectors of a scenario that this process does not know yet. Raises PartError."""
    for name in (name for name in scenario.running if name not in registry.SHIPPED):
        table, part = scenario.detectors.table(name), registry.USER_DETECTORS.get(name)
        file = table.get("file")
        if file and (part is None or table.get("sha256") not in (None, part.sha256)):
            part = load(file)
        if part is not None and part.DETECTOR.id != name:
            said, place = f"holds the detector {part.DETECTOR.id!r}", f"detectors.{name}.file = {file}"
            raise PartError(said, place=place, allowed=f"one with id {name!r}")
        among(name, (*registry.SHIPPED, *registry.USER_DETECTORS), "no such detector, and no file is given",
              error=PartError, place=f"detectors.{name}")  # fmt: skip


def with_detectors(scenario: Scenario, files: Iterable[str | os.PathLike]) -> Scenario:
    """Return `scenario` with the detectors of `files` among its own."""
    parts = loaded(files)
    table = tomllib.loads(scenario.expanded_toml())
    own = table.setdefault("detectors", {})
    for part in parts:
        name = part.DETECTOR.id
        named = own.get(name, {}).get("file", "")
        if os.path.exists(named) and not os.path.samefile(named, part.file):
            raise _twice(name, f"{named} of the scenario", part.file)
        own[name] = {**own.get(name, {}), "file": part.file, "sha256": part.sha256}
        own["enabled"] = list(dict.fromkeys([*own.get("enabled", scenario.detectors.enabled), name]))
    return parse(table) if parts else scenario


@functools.cache
def _only(module, file, sha256):
    """Return the one detector of a module, made: the module itself when it is a block, else its one class."""
    if is_block(module):
        return _made(module, (file, sha256))
    found = [v for v in vars(module).values() if is_detector_class(v) and v.__module__ == module.__name__]
    if len(found) != 1:
        several = ", ".join(v.__name__ for v in found)
        raise PartError(f"holds {several}" if found else "holds no detector", place=file,
                        allowed="one class with id, level, inputs and update, or a block with DETECTOR",
                        remedy="`cosim new detector NAME` writes one that runs")  # fmt: skip
    try:
        return _made(found[0], (file, sha256))
    except PartError as error:
        error.place = f"{file}: {error.place}"
        raise


def _source(part):
    """Return (file, digest) of a class or module that a program holds; without a file the digest of its text."""
    try:
        file = inspect.getsourcefile(part) or ""
        if file and Path(file).is_file() and getattr(part, "__module__", "") != "__main__":
            return file, user_parts.identity(file).sha256
        return "", hashlib.sha256(inspect.getsource(part).encode()).hexdigest()
    except (OSError, TypeError):
        return "", hashlib.sha256(repr(part).encode()).hexdigest()


def _made(part, source):
    if isinstance(part, ModuleType) and is_block(part):
        return block_detector(part, *source)
    if is_detector_class(part):
        return PlainDetector(part, *source)
    raise PartError("is no detector", place=repr(part), allowed="a class with id, level, inputs and update")


def about(part: Any) -> dict:
    """Return what a log tells of a user's detector, so that it can be judged and shown without its code."""
    own = part.DETECTOR
    keys = ("summary", "technologies", "inputs", "group", "designed_for", "may_see", "blind", "blind_to")
    record = {k: getattr(own, k) for k in keys}
    record["estimates"] = [[e.of, e.output, e.unit] for e in own.estimates]
    form = "python" if isinstance(part, PlainDetector) else "block"
    about = {"form": form, "file": Path(part.file).name, "sha256": part.sha256}
    return about | {"isolable_parts": list(part.ISOLABLE_PARTS), "record": record}
