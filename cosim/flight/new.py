"""The files that `cosim new KIND NAME` writes: a plug-in, scenario part or campaign that runs, and its test."""

import importlib.machinery
import keyword
import os
import re
import sys
from importlib import resources
from pathlib import Path

from cosim.errors import among
from cosim.parts import PartError
from cosim.scenario.aircraft import bundled, load_record
from cosim.scenario.catalog import TECHNOLOGIES
from fdi import registry

KINDS = {  # kind -> what to do with it next
    "detector": ("cosim check {file}", "cosim run --detector {file}"),
    "law": ("cosim check {file}", "cosim run --set law.file={file}"),
    "actuator": ("cosim run cruise --set actuators.{name}.file={file} --set elevator.left_inner={name}",),
    "aircraft": ("cosim check {file}", "python -m cosim.training all --aircraft {file}"),
    "campaign": ("cosim campaign {file}",),
}
TAKEN = {"detector": ("enabled", *registry.SHIPPED), "actuator": tuple(TECHNOLOGIES), "aircraft": bundled()}
SAMPLE = "narrowbody"  # whose numbers stand in the template of an aircraft
TEMPLATE = "# Template: the numbers are those of a twin of the A320 class; put yours in their place.\n"
ALLOWED = "lower-case letters, digits and _"


def texts(name: str, kind: str = "detector", numbers: Path | None = None) -> dict[str, str]:
    """Return {file: text} of a thing of `kind` that is called `name`, and its test.

    Of an aircraft without `numbers` the two files to fill in; with `numbers`, a numbers.toml that has aircraft.toml
    beside it, its whole folder.

    Raises PartError for an unknown kind, a name that cannot be its id, that ships, or that shadows a module: Python
    would import the user's file in place of numpy or os.
    """
    among(kind, (*KINDS, "example"), "is nothing to write", error=PartError, place=f"cosim new {kind}")
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise PartError("cannot be its name", place=f"{kind} {name}", allowed=ALLOWED)
    if name in TAKEN.get(kind, ()):
        raise PartError("is the name of one that ships", place=name, remedy="Choose another name")
    if shadows(name):
        raise PartError("is the name of a module that Python would no longer find", place=name,
                         remedy=f"Choose another name, for example my_{name}")  # fmt: skip
    if kind == "aircraft" and numbers is None:
        return {f"{name}/{file}": f"{TEMPLATE}{text}" for file, text in _records(load_record(SAMPLE).folder).items()}
    words = {"CLASS": "".join(part.capitalize() for part in name.split("_")), "NAME": name}
    main = f"{name}.toml" if kind == "campaign" else f"{name}.py"
    files = {f"test_{name}.py": f"test_{kind}.py"}
    if kind != "aircraft":
        files[main] = f"{kind}.toml" if kind == "campaign" else f"{kind}.py"
    out = {}
    for file, template in sorted(files.items()):
        text = resources.files("cosim").joinpath("templates", template).read_text(encoding="utf-8")
        for word, own in words.items():
            text = text.replace(word, own)
        out[file] = text
    return out | (_aircraft(name, numbers) if numbers else {})


def shadows(name: str) -> bool:
    """Tell whether a file NAME.py would stand in the place of a module of Python's or of an installed package."""
    path = [p for p in sys.path if p and os.path.abspath(p) != os.getcwd()]
    ours = "actuators", "cosim", "fdi"  # also where they are imported from a checkout
    known = *sys.stdlib_module_names, *sys.builtin_module_names, *ours
    return name in known or importlib.machinery.PathFinder.find_spec(name, path) is not None


def _aircraft(name, numbers):
    """Return the files of an aircraft that is estimated from its dimensions."""
    from cosim.flight.plant.estimate import build

    if not numbers.is_file():
        raise PartError("no such file", place=str(numbers))
    record = load_record(str(numbers.parent)).model_copy(update={"name": name})
    made = build(record, numbers) | _records(numbers.parent) | {"numbers.toml": numbers.read_text("utf-8")}
    return {f"{name}/{file}": text for file, text in made.items()}


def _records(folder):
    found = (folder / file for file in ("aircraft.toml", "numbers.toml"))
    return {path.name: path.read_text("utf-8") for path in found if path.is_file()}
