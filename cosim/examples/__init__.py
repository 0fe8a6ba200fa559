"""Programs to start from: each runs as it stands, and `cosim example NAME` copies one into your folder."""

import ast
from importlib import resources
from pathlib import Path

from cosim.errors import CosimError, did_you_mean
from cosim.files import replace_text


def examples() -> dict[str, str]:
    """Return {name: first sentence of its docstring} of every example."""
    found = {p.name[:-3]: p for p in resources.files(__package__).iterdir() if p.name.endswith(".py")}
    own = {name: p for name, p in sorted(found.items()) if not name.startswith("_")}
    return {name: _summary(path.read_text(encoding="utf-8")) for name, path in own.items()}


def copy(name: str, path: Path) -> None:
    """Write example `name` to `path`. Raises CosimError for a name that there is not, OutputError for the file."""
    known = examples()
    if name not in known:
        raise CosimError(
            "no example of this name", place=name, allowed=", ".join(known), remedy=did_you_mean(name, known)
        )
    replace_text(path, resources.files(__package__).joinpath(f"{name}.py").read_text(encoding="utf-8"))


def _summary(source):
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0].rstrip(".")
