"""User detectors, from a file, a folder or a program.

A user's detector, called a guest, is a plain Python class (`detector.py`), a block as ours are (actuators/block.py), or
a fitted model over a window of signals (`window.py`). It comes from a file that a scenario or a command line names,
or from `cosim.register(Parity)`. Its code has its user's
rights: it is run as it stands, and only a file that the user has named is run (cosim/scenario/user_parts.py loads it).
"""

import hashlib
import inspect
import os
import tomllib
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from cosim.errors import did_you_mean
from cosim.parts.detector import BlockDetector, GuestError, PlainDetector, is_block, is_guest, rollout_of
from cosim.scenario import Scenario, parse, user_parts
from cosim.texts import unpaired_surrogate
from fdi import registry

__all__ = ["GuestError", "load", "loaded", "register", "rollout_of", "use", "with_detectors"]
KEYS = ("file", "sha256")  # of a guest's table, beside its parameters
_loaded: dict[tuple[str, str], Any] = {}  # (file, digest) -> guest


def register(guest: Any) -> Any:
    """Make a guest known to this process: a class, or a module that is a block. It flies in every scenario that does
    not choose its detectors. Returns it, so that it serves as a decorator. Raises GuestError for what is no detector.
    """
    _install(_made(guest, _source(guest)))
    return guest


def _install(guest):
    """Take a made guest into the registry and return it; raises GuestError for the id of a detector that ships."""
    name = guest.DETECTOR.id
    if name in registry.SHIPPED:
        raise GuestError(f"{name!r} is a detector that ships", place=guest.file or name, remedy="Choose another id")
    registry.GUESTS[name] = guest
    return guest


def load(name: str | os.PathLike) -> PlainDetector:
    """Return the guest of a file or a folder, known to this process from now on.

    Raises GuestError for a file that is not there, does not run, or holds no detector or several.
    """
    path = Path(os.path.expanduser(name))
    if unpaired_surrogate(str(path)):
        raise GuestError("its name is not UTF-8, which a log needs", place=str(path), remedy="Rename it")
    if not os.path.exists(path):
        near = [str(path.with_name(p.name)) for p in path.parent.glob("*.py")]
        raise GuestError("no such file", place=str(name), remedy=did_you_mean(name, near))
    module, part = user_parts.load(path, lambda text: GuestError(text, place=str(name)))
    key = str(path.resolve()), part.sha256
    if key not in _loaded:
        _loaded[key] = _only(module, str(name), key)
    return _install(_loaded[key])


def loaded(files: Iterable[str | os.PathLike]) -> list[PlainDetector]:
    """Return the guests of several files; raises GuestError, also where two have one id."""
    out: dict[str, tuple[Any, str | os.PathLike]] = {}
    for file in files:
        guest = load(file)
        before, other = out.setdefault(guest.DETECTOR.id, (guest, file))
        if before is not guest:
            raise _twice(guest.DETECTOR.id, other, file)
    return [guest for guest, _ in out.values()]


def _twice(name, one, other):
    said = f"has the id {name!r}, as {one} has: a flight has one detector of an id"
    return GuestError(said, place=str(other), remedy="Choose another id, or leave one out")


def use(scenario: Scenario) -> None:
    """Load the guests of a scenario that this process does not know yet. Raises GuestError, also when a file is no
    longer the one that the scenario means."""
    for name in scenario.running:
        table = scenario.detectors.table(name)
        if name in registry.SHIPPED or not table.get("file"):
            if not registry.known(name):
                near = did_you_mean(name, [*registry.SHIPPED, *registry.GUESTS])
                raise GuestError("no such detector, and no file is given", place=f"detectors.{name}", remedy=near)
            continue
        guest, place = registry.GUESTS.get(name), f"detectors.{name}.file = {table['file']}"
        wanted, remedy = table.get("sha256"), "Load the scenario again, or remove its sha256"
        changed = GuestError(user_parts.CHANGED, place=place, remedy=remedy)
        if guest is None or (wanted and guest.sha256 != wanted):
            guest = load(table["file"])
        if guest.DETECTOR.id != name:
            raise GuestError(f"holds the detector {guest.DETECTOR.id!r}", place=place, allowed=f"one with id {name!r}")
        if wanted and guest.sha256 != wanted:
            raise changed


def with_detectors(scenario: Scenario, files: Iterable[str | os.PathLike]) -> Scenario:
    """Return `scenario` with the guests of `files` among its detectors."""
    files = list(files)
    if not files:
        return scenario
    loaded(files)
    table = tomllib.loads(scenario.expanded_toml())
    own = table.setdefault("detectors", {})
    for file in files:
        guest = load(file)
        name = guest.DETECTOR.id
        named = own.get(name, {}).get("file", "")
        if os.path.exists(named) and not os.path.samefile(named, file):
            raise _twice(name, f"{named} of the scenario", file)
        own[name] = {**own.get(name, {}), "file": str(Path(file)), "sha256": guest.sha256}
        own["enabled"] = list(dict.fromkeys([*own.get("enabled", scenario.detectors.enabled), name]))
    return parse(table)


def _only(module, place, key):
    """Return the one detector of a module, made: the module itself when it is a block, else its one class."""
    if is_block(module):
        return _made(module, key)
    found = [v for v in vars(module).values() if is_guest(v) and v.__module__ == module.__name__]
    if len(found) != 1:
        several = ", ".join(v.__name__ for v in found)
        raise GuestError(f"holds {several}" if found else "holds no detector", place=place,
                         allowed="one class with id, level, inputs and update, or a block with DETECTOR",
                         remedy="`cosim new detector NAME` writes one that runs")  # fmt: skip
    return _made(found[0], key)


def _source(guest):
    """Return (file, digest) of a class or module that a program holds; without a file the digest of its text."""
    try:
        file = inspect.getsourcefile(guest) or ""
        if file and Path(file).is_file() and getattr(guest, "__module__", "") != "__main__":
            return file, user_parts.identity(file).sha256
        return "", hashlib.sha256(inspect.getsource(guest).encode()).hexdigest()
    except (OSError, TypeError):
        return "", hashlib.sha256(repr(guest).encode()).hexdigest()


def _made(guest, source):
    if isinstance(guest, ModuleType) and is_block(guest):
        return BlockDetector(guest, *source)
    if is_guest(guest):
        return PlainDetector(guest, *source)
    raise GuestError("is no detector", place=repr(guest), allowed="a class with id, level, inputs and update")


def about(guest: Any) -> dict:
    """Return what a log tells of a guest, so that it can be judged and shown without its code."""
    own = guest.DETECTOR
    keys = ("summary", "technologies", "inputs", "group", "designed_for", "may_see", "blind", "blind_to", "remark")
    record = {k: getattr(own, k) for k in keys}
    record["estimates"] = [[e.of, e.output, e.unit] for e in own.estimates]
    form = "python" if isinstance(guest, PlainDetector) else "block"
    return {"form": form, "file": Path(guest.file).name, "sha256": guest.sha256, "culprits": list(guest.CULPRITS),
            "record": record}  # fmt: skip
