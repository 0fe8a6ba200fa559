"""What detectors are tuned by: thresholds and designs, trained, solved for or published, kept as data.

`fdi/thresholds/<detector>.json` holds one object per set ("published", "flight") of PARAMS fields in SI, and under
"training" how the flight set was found (seeds, margin, maxima); `fdi/designs/<name>.json` a design. Both are JSON,
compact enough to read and to compare. What was made for another aircraft lies in `thresholds/` and `designs/` of that
aircraft's folder; its thresholds replace the fields that they have.
"""

import json
import math
import textwrap
from dataclasses import asdict, fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

WIDTH = 120  # of a line
Folder = str | Path | None  # of an aircraft with thresholds and designs of its own; None: those of the aircraft of fdi


def thresholds(detector: str, which: str = "flight", own: Folder = None) -> dict:
    """Return {PARAMS field: number or row, SI} of set `which`; an unknown set or a bad value raises ValueError."""
    file = resources.files("fdi").joinpath("thresholds", f"{detector}.json")
    sets = {k: v for k, v in json.loads(file.read_text(encoding="utf-8")).items() if k != "training"}
    if which not in sets:
        raise ValueError(f"{detector}: threshold set {which!r} is not one of {sorted(sets)}")
    other = Path(own) / "thresholds" / f"{detector}.json" if own else None
    trained = json.loads(other.read_text(encoding="utf-8")).get(which, {}) if other and other.is_file() else {}
    if unknown := trained.keys() - sets[which].keys():
        raise ValueError(f"{other}: {detector} has no threshold {sorted(unknown)[0]!r}")
    found = {**sets[which], **trained}
    for name, value in found.items():
        parts = value if isinstance(value, list) else [value]
        if not all(isinstance(v, int | float) and math.isfinite(v) for v in parts):
            raise ValueError(f"{detector}: threshold {name} = {value!r} is no finite number")
    return found


def read(name: str, own: Folder = None) -> dict[str, Any]:
    """Return what the design `name` holds. Raises FileNotFoundError when there is none."""
    file = (Path(own) if own else resources.files("fdi")).joinpath("designs", f"{name}.json")
    if not file.is_file():
        raise FileNotFoundError(f"there is no stored design {name!r}; make it with `python -m cosim.training designs`")
    return json.loads(file.read_text(encoding="utf-8"))


def plain(made: Any) -> Any:
    """Return a dataclass of arrays and numbers as nested dicts and lists that JSON can hold."""
    return json.loads(json.dumps(asdict(made), default=np.ndarray.tolist))


def from_plain(kind: type, held: Any) -> Any:
    """Return the dataclass `kind` of what `plain` made of one, lists as arrays; a field that is missing raises
    KeyError."""
    return kind(**{f.name: np.array(v, float) if isinstance(v := held[f.name], list) else v for f in fields(kind)})


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
