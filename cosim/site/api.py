"""API reference of the site: the public names, and every type of ours that one of them returns."""

import ast
import builtins
import importlib
import inspect
import itertools
import re
import sys
import textwrap
import types
import typing
from pathlib import Path
from typing import Any

OURS = ("cosim", "fdi", "actuators")
PAGE = Path(__file__).resolve().parents[1] / "API.md"  # which names are public
GROUPS = {"cosim": "The package", "cosim.campaign": "Many flights", "cosim.compare": "Many flights",
          "cosim.replay": "Logs and recordings", "cosim.report": "Reports", "actuators": "Blocks and detectors",
          "fdi": "Blocks and detectors"}  # fmt: skip
BESIDE = ("cosim.flight.plant.point.FlightPoint",)  # taken, not returned, and made by programs


def found(name: str) -> Any:
    """Return the object of a dotted name."""
    room, _, last = name.rpartition(".")
    return getattr(importlib.import_module(room), last)


def place(value: Any) -> str:
    """Return the dotted name of a function or class where it is defined."""
    return f"{value.__module__}.{value.__qualname__}"


def _classes(hint: Any) -> list[type]:
    if inspect.isclass(hint) and not isinstance(hint, types.GenericAlias):
        return [hint] if hint.__module__.split(".")[0] in OURS else []
    return [c for part in typing.get_args(hint) for c in _classes(part)]


class _Names(dict):
    """Names of a module; one that only a type checker sees is any type."""

    def __missing__(self, name: str) -> Any:
        return Any


def _hints(value: Any) -> dict[str, Any]:
    """Return the type hints of a function or class."""
    beside = vars(sys.modules[value.__module__])
    names = _Names({**vars(builtins), "pd": importlib.import_module("pandas"), **beside})
    return typing.get_type_hints(value, localns=names)


def _function(value: Any) -> Any:
    """Return the function of a member of a class: of a method or property, None of others."""
    made = value.fget if isinstance(value, property) else getattr(value, "func", getattr(value, "__func__", value))
    return made if inspect.isfunction(made) else None


def returned(functions: list) -> list[type]:
    """Return our types that the functions return, and those that attributes and methods of these have, in order."""
    out: list[type] = []
    ahead = [c for f in functions if inspect.isfunction(f) for c in _classes(_hints(f).get("return"))]
    while ahead:
        one = ahead.pop(0)
        if one in out or issubclass(one, Exception):
            continue
        out.append(one)
        for name, value in vars(one).items():
            if not name.startswith("_") and (made := _function(value)):
                ahead += _classes(_hints(made).get("return"))
        ahead += [c for name, hint in _hints(one).items() if not name.startswith("_") for c in _classes(hint)]
    return out


def pages() -> dict[str, str]:
    """Return {file: Markdown} of the reference."""
    groups: dict[str, list[str]] = {}
    for name in re.findall(r"^## ([\w.]+)", PAGE.read_text(encoding="utf-8"), re.M):
        room = name.rpartition(".")[0].split(".")
        near = next(".".join(room[:n]) for n in (2, 1) if ".".join(room[:n]) in GROUPS)
        groups.setdefault(GROUPS[near], []).append(name)
    every = {name: found(name) for names in groups.values() for name in names}
    text = "# Functions and classes\n\nUnits are SI where none is said. [Types that they return](types.md).\n"
    for title, names in groups.items():
        text += f"\n## {title}\n"
        text += "".join(f"\n### {n}\n\n{_told(every[n])}" for n in names)
    told = {place(v) for v in every.values()}
    kinds = [c for c in [*returned(list(every.values())), *map(found, BESIDE)] if place(c) not in told]
    types_ = "# Returned types\n\nTheir attributes and methods; SI where no unit is said.\n"
    for name, kind in {place(c): c for c in kinds}.items():
        told_of = attributes(kind)
        rows = "".join(f"| `{a}` | `{hint}` | {about} |\n" for a, (hint, about) in told_of.items())
        table = f"| attribute | type | what it is |\n|---|---|---|\n{rows}\n" if rows else ""
        own = [n for n, value in vars(kind).items() if not n.startswith("_") and _function(value)]
        types_ += f"\n## {name.rpartition('.')[2]}\n\n`{name}`\n\n{_directive(name, members='false')}\n{table}"
        types_ += "".join(f"{_directive(f'{name}.{n}', show_root_heading='true')}\n" for n in own)
    return {"index.md": text, "types.md": types_}


def _told(value: Any) -> str:
    return _directive(place(value))


def attributes(kind: type) -> dict[str, tuple[str, str]]:
    """Return {name: (type, comment)} of the public fields of a class: the comment behind a field, or that above it."""
    lines = textwrap.dedent(inspect.getsource(kind)).splitlines()
    (tree,) = ast.parse("\n".join(lines)).body
    out: dict[str, tuple[str, str]] = {}
    for node in getattr(tree, "body", ()):
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and not node.target.id.startswith("_"):
            behind = lines[(node.end_lineno or 0) - 1][node.end_col_offset :].partition("# ")[2]
            above = list(itertools.takewhile(lambda line: line.lstrip().startswith("#"), lines[node.lineno - 2 :: -1]))
            about = behind or " ".join(line.strip().lstrip("# ") for line in reversed(above))
            out[node.target.id] = ast.unparse(node.annotation), about.replace("|", r"\|")
    return out


def _directive(name: str, **options: str) -> str:
    told = {"show_root_heading": "false", "heading_level": "4", **options}
    return f"::: {name}\n    options:\n" + "".join(f"      {key}: {value}\n" for key, value in told.items())
