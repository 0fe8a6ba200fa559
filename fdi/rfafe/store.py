"""Keep an estimator as plain numbers in `fdi/designs/`, so that a flight needs no solver."""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np

from fdi.common.compact import read
from fdi.rfafe.discrete import Discrete, discretise
from fdi.rfafe.synthesis import Design, Region


def to_plain(design: Design) -> dict[str, Any]:
    """Return a Design as nested dicts and lists that JSON can hold."""
    plain: dict[str, Any] = json.loads(json.dumps(asdict(design), default=np.ndarray.tolist))
    return plain


def from_plain(plain: Mapping[str, Any]) -> Design:
    """Return the Design of `to_plain`; a field that is missing raises KeyError."""

    def made(kind, held):
        return kind(**{f.name: np.array(v, float) if isinstance(v := held[f.name], list) else v for f in fields(kind)})

    parts = {"region": made(Region, plain["region"]), "discrete": made(Discrete, plain["discrete"])}
    design: Design = made(Design, {**plain, **parts})
    return design


def choose(stored: Any, technology: str, dt: float) -> tuple[Design, Any]:
    """Return (Design, entry) for `technology` of a stored file (name or content), its discrete form made for `dt` [s].

    `technology` is that of both sides, or "left/right"; a file without any pair is of a form that knows no sides and
    takes sides that differ as "mixed". Raises ValueError for a technology that the file lacks.
    """
    stored = read(stored) if isinstance(stored, str) else stored
    if why := _lacking(stored, technology):
        raise ValueError(why)
    entry = stored["designs"][_key(technology, stored)]
    design = from_plain(entry["design"])
    return design if design.discrete.dt == dt else replace(design, discrete=discretise(design, dt)), entry


def lacks(name: str, technologies: Mapping[str, str], own: Any) -> str:
    """Return why design `name` of folder `own` (None: the bundled one) has none for these elevators, or ""."""
    return _lacking(read(name, own), side_kinds(technologies))


def _key(technology, stored):
    """Return the key of a design in `stored`: a file without any pair knows no sides."""
    pairs = any("/" in kind for kind in stored["designs"])
    return "mixed" if "/" in technology and not pairs else technology


def _lacking(stored, technology):
    known = stored["designs"]
    return "" if _key(technology, stored) in known else (
        f"no design for {technology} elevators; there is {', '.join(sorted(known))}")


def side_kinds(technologies: Mapping[str, str]) -> str:
    """Return the key of the stored design for elevators of `technologies`, {segment: technology}: one word when both
    sides are alike, a kind or "mixed", else "left/right".
    """
    found = ({t for s, t in technologies.items() if s.startswith(side)} for side in ("left", "right"))
    left, right = (kinds.pop() if len(kinds) == 1 else "mixed" for kinds in found)
    return left if left == right else f"{left}/{right}"
