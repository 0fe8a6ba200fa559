"""The text of what is stored in `fdi/designs/` and `fdi/thresholds/`: JSON, compact enough to read and to compare."""

import json
import textwrap
from importlib import resources
from pathlib import Path
from typing import Any

WIDTH = 120  # of a line


def read(name: str, own: str | Path | None = None) -> dict[str, Any]:
    """Return what the design `name` holds, of the aircraft with designs of its own in folder `own`, None: of `fdi`.

    Raises FileNotFoundError when there is none.
    """
    file = (Path(own) if own else resources.files("fdi")).joinpath("designs", f"{name}.json")
    if not file.is_file():
        raise FileNotFoundError(f"there is no stored design {name!r}; make it with `python -m cosim.training designs`")
    return json.loads(file.read_text(encoding="utf-8"))


def text(data: dict) -> str:
    """Return `data` as JSON: what fits stands on one line, long lists of numbers wrap; numbers keep their bits."""
    return _text(json.loads(json.dumps(data)), 0) + "\n"  # tuples are lists, too


def _text(value, depth):
    whole = json.dumps(value)
    if len(whole) + depth <= WIDTH or not isinstance(value, dict | list):
        return whole
    inner = " " * (depth + 1)
    between = f",\n{inner}"
    if isinstance(value, dict):
        return "{" + between.join(f"{json.dumps(k)}: {_text(v, depth + 1)}" for k, v in value.items()) + "}"
    if any(isinstance(v, dict | list) for v in value):
        return "[" + between.join(_text(v, depth + 1) for v in value) + "]"
    return "[" + textwrap.fill(whole[1:-1], WIDTH - depth - 1, subsequent_indent=inner, break_on_hyphens=False) + "]"
