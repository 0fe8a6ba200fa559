"""Figures of our own as plain data: what a paper's figure shows, from our runs. `cosim.report` draws them."""

from dataclasses import dataclass

import numpy as np

from cosim.table import Table

DT = 0.005


@dataclass(frozen=True)
class Curve:
    """One line: samples `y` at t0 + k dt; colour by `role`, dashed where a second cue is needed."""

    name: str
    y: np.ndarray
    role: str = "ours"
    dash: str = "solid"
    t0: float = 0.0
    dt: float = DT  # [s]


@dataclass(frozen=True)
class Panel:
    """A set of axes over time: title, unit, curves, horizontal lines, least half range or its limits."""

    title: str
    unit: str
    curves: tuple
    levels: tuple = ()
    least: float = 0.0
    limits: tuple | None = None


def estimated(
    title: str, unit: str, ours: np.ndarray, true: np.ndarray, least: float = 0.0, word: str = "true"
) -> Panel:
    """Return the Panel of an estimate over what is true of it, dotted."""
    return Panel(title, unit, (Curve("estimate", ours), Curve(word, true, "true", "dot")), least=least)


@dataclass(frozen=True)
class Drawing:
    """One figure: which of the paper's it stands beside, what it says in our words, and its panels or table."""

    paper: str
    beside: str  # "figure 3"
    title: str
    caption: str
    panels: tuple = ()
    columns: int = 3  # at most
    table: Table | None = None
    onset: float | None = None  # of the fault [s]
    span: tuple | None = None
    row_px: int = 170  # height of a row of panels
    look: str = ""  # what to look at, one sentence; "" where nothing of the paper stands beside it

