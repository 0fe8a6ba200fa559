"""The papers' own experiments, row by row: what a paper says, what we get, and whether they agree.

Each paper is a package: `claims.toml` lists what is asked, with its bands (`cosim.papers.claims` reads it), beside the
functions that measure it; `figures.drawings()` makes our figures. No row is left out because it disagrees.
"""

import importlib
from collections import Counter
from collections.abc import Callable
from typing import Any

from cosim.campaign.pool import finished
from cosim.errors import CosimError, did_you_mean
from cosim.papers import claims
from cosim.papers.claims import VERDICTS, Claim, Row, counts

FIGURES = "figures"  # the piece of a paper that makes its drawings
PAPERS = ("lu17", "jay", "sun13", "mar10", "alwi14")
LONGEST_FIRST = ("mar10", "sun13", "alwi14", "lu17", "jay")  # so that processes end together


def chosen(paper: str) -> Any:
    """Return the papers that `paper`, one of PAPERS or "all", stands for. Raises CosimError for another name."""
    if paper not in (*PAPERS, "all"):
        raise CosimError(
            f"{paper!r} is no paper of this testbed",
            allowed=", ".join((*PAPERS, "all")),
            remedy=did_you_mean(paper, PAPERS),
        )
    return PAPERS if paper == "all" else (paper,)


def plan(paper: str = "all") -> list[Claim]:
    """Return the claims of `paper`, one of PAPERS or "all", without their numbers."""
    return [p for name in chosen(paper) for p in claims.load(name)]


def reproduce(
    paper: str = "all",
    *,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> tuple[list[Row], list]:
    """Return (rows, drawings) of `paper`, one of PAPERS or "all"; `progress(done, total)` counts rows and figures.

    The pieces of the papers run in `workers` processes, by default one per core; 0 stays in this process.
    """
    asked = {name: claims.load(name) for name in LONGEST_FIRST if name in chosen(paper)}
    pieces = Counter((name, piece) for name in asked for piece in [*(p.piece for p in asked[name]), FIGURES])
    done, tell = 0, progress or (lambda done, total: None)
    tell(done, pieces.total())
    found: dict = {}
    for key, made in finished([(key, one, key) for key in pieces], workers=workers):
        found[key] = made
        done += pieces[key]
        tell(done, pieces.total())
    left = {key: iter(made) for key, made in found.items()}
    rows = [next(left[name, p.piece]) for name in chosen(paper) for p in asked[name]]
    return rows, [drawing for name in chosen(paper) for drawing in found[name, FIGURES]]


def one(paper: str, piece: str) -> list:
    """Return the Rows of a piece of a paper, or its Drawings."""
    if piece == FIGURES:
        return importlib.import_module(f"cosim.papers.{paper}.figures").drawings()
    return [p.judge() for p in claims.load(paper) if p.piece == piece]


__all__ = ["PAPERS", "VERDICTS", "Row", "counts", "plan", "reproduce"]
