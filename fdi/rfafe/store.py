"""Keep an estimator as plain numbers in `fdi/designs/`, so that a flight needs no solver."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fdi.common import tuning
from fdi.common.tuning import read
from fdi.rfafe.discrete import Discrete, discretise
from fdi.rfafe.synthesis import Design, Region


def from_plain(held: Mapping[str, Any]) -> Design:
    """Return the Design of what `fdi.common.tuning.plain` made of one; a field that is missing raises KeyError."""
    parts = {"region": tuning.from_plain(Region, held["region"]),
             "discrete": tuning.from_plain(Discrete, held["discrete"])}  # fmt: skip
    return tuning.from_plain(Design, {**held, **parts})


def choose(stored: Any, technology: str, dt: float) -> tuple[Design, Any]:
    """Return (Design, entry) for `technology` of the content of a stored file, its discrete form made for `dt` [s].

    `technology` is that of both sides, or "left/right"; a file without any pair is of a form that knows no sides and
    takes sides that differ as "mixed". Raises ValueError for a technology that the file lacks.
    """
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
