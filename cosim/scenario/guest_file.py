"""Detectors that a scenario takes from files: `[detectors.parity] file = "parity.py"`. Nothing is run here.

The file is found and its digest written beside it, so that a scenario says which code it means.
"""

import ast
import hashlib
import os
from pathlib import Path

from cosim.errors import ScenarioError

KEYS = ("file", "sha256")  # of a guest's table, beside its parameters
NOT_FOUND = "no such file"
CHANGED, AGREE = "is not the file that the scenario means: its digest differs", "Read it, then remove or renew sha256"


def digest(path: Path) -> str:
    """Return the SHA-256 of a Python file and of what lies beside it and is named in it: modules that it imports, files
    of models and numbers that it opens. Raises ScenarioError when it cannot be read.
    """
    found: dict[Path, bytes] = {}
    todo = [path]
    while todo:
        here = todo.pop()
        if here in found:
            continue
        try:
            found[here] = here.read_bytes()
        except OSError as error:
            raise ScenarioError(f"cannot be read: {error.strerror}", place=str(here)) from None
        if here.suffix == ".py":
            todo += [p for name in _named(found[here]) if os.path.isfile(p := here.parent / name)]
    out = hashlib.sha256()
    for here in sorted(found):
        out.update(os.fsencode(here.name) + b"\0" + found[here])
    return out.hexdigest()


def _named(source: bytes) -> set[str]:
    """Return the names that may be of files beside a source: modules imported, and every short text in it."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, MemoryError, RecursionError):  # nested without end
        return set()
    out: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            out |= {alias.name.split(".")[0] + ".py" for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            out.add(node.module.split(".")[0] + ".py")
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and 0 < len(node.value) < 100:
            out.add(node.value)
    return {name for name in out if "\0" not in name and "\n" not in name}


def locate(tables: dict, folder: Path | None, place: str) -> dict:
    """Return the tables of a scenario with the `file` of each guest found, beside the scenario's own file (`folder`) or
    from here, and its digest. Raises ScenarioError for one that is not there, or is another than
    the scenario means.
    """
    detectors = tables.get("detectors")
    if not isinstance(detectors, dict):
        return tables
    made = dict(detectors)
    for name, own in detectors.items():
        if isinstance(own, dict) and isinstance(own.get("file"), str) and own["file"]:
            path = Path(os.path.expanduser(own["file"]))
            beside = folder / path if folder else path
            path = beside if os.path.isfile(beside) else path
            if not os.path.isfile(path):
                raise ScenarioError(NOT_FOUND, place=f"{place}: detectors.{name}.file = {own['file']}")
            found = digest(path)
            if own.get("sha256", found) != found:
                raise ScenarioError(CHANGED, place=f"{place}: detectors.{name}.file = {path}", remedy=AGREE)
            made[name] = {**own, "file": str(path), "sha256": found}
    return {**tables, "detectors": made}
