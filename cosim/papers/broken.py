"""Proof that rows can fail: something is broken in one place, and the row must see it.

Three kinds count apart: the *method* (a sign, gain, constant or equation of it), what is *flown* (faults, flights,
draws), and an *option* that is swapped for another. No break scales a row's own result.
"""

import contextlib
import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from cosim.papers.claims import load
from cosim.papers.row import Planned

KINDS = ("method", "flown", "option")


@dataclass(frozen=True)
class Break:
    """One thing that is broken, and the rows (parts of their items) that must leave their bands."""

    what: str
    patch: Callable[[], contextlib.AbstractContextManager]
    rows: tuple[str, ...]
    kind: str = "flown"  # one of KINDS

    def __post_init__(self):
        if self.kind not in KINDS:
            raise ValueError(f"{self.what}: kind {self.kind!r} is not one of {', '.join(KINDS)}")


@dataclass(frozen=True)
class Broken:
    """What a row shows with the method broken."""

    paper: str
    item: str
    what: str
    got: float
    band: str
    seen: bool  # outside the band, and outside what was found of a row that differs for a reason
    kind: str = "flown"


@contextlib.contextmanager
def swap(module: str, **values: Any) -> Iterator[None]:
    """Replace names of a module; a value that is a function of one argument under `wrap_NAME` gets the old one."""
    place = importlib.import_module(module)
    held = {}
    for key, value in values.items():
        name = key.removeprefix("wrap_")
        held[name] = getattr(place, name)
        setattr(place, name, value(held[name]) if key.startswith("wrap_") else value)
    try:
        yield
    finally:
        for name, value in held.items():
            setattr(place, name, value)


def forget(paper: str) -> None:
    """Empty every cache of a paper's modules."""
    for name, module in list(sys.modules.items()):
        if name.startswith(f"cosim.papers.{paper}"):
            for value in list(vars(module).values()):
                if callable(getattr(value, "cache_clear", None)):
                    value.cache_clear()


def breaks(paper: str) -> tuple[Break, ...]:
    """Return the Breaks of a paper."""
    return importlib.import_module(f"cosim.papers.{paper}.breaks").BREAKS


def chosen(rows: list[Planned], of: Break) -> list[Planned]:
    """Return the rows that a Break names; ValueError when a name stands for none."""
    out = []
    for part in of.rows:
        found = [p for p in rows if part in p.item]
        if not found:
            raise ValueError(f"{of.what}: no row has {part!r} in it")
        out += found
    return out


def proof(paper: str, only: Callable[[Break], bool] = lambda of: True) -> Iterator[Broken]:
    """Yield what each row of `paper` shows under each of its Breaks."""
    for of in filter(only, breaks(paper)):
        forget(paper)
        try:
            with of.patch():
                for p in chosen(load(paper), of):
                    row = p.judge()
                    seen = row.verdict == "differs"
                    yield Broken(paper, p.item, of.what, row.got, row.tolerance, seen, of.kind)
        finally:
            forget(paper)
