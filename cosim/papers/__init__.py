"""The papers' own experiments, row by row: what a paper says, what we get, and whether they agree.

Expected values and tolerances are committed in a module per paper, whose `plan()` lists what is asked and whose
`rows()` runs the experiments; `<paper>_figures` makes our figures. No row is left out because it disagrees; one that
does names the command whose figure explains it.
"""

import importlib

from cosim.campaign.pool import finished
from cosim.errors import CosimError, did_you_mean
from cosim.papers.row import VERDICTS, Row, counts

PAPERS = ("lu17", "jay", "sun13", "mar10", "alwi14")
LONGEST_FIRST = ("mar10", "sun13", "alwi14", "lu17", "jay")  # so that two processes end together


def chosen(paper):
    """Return the papers that `paper`, one of PAPERS or "all", stands for. Raises CosimError for another name."""
    if paper not in (*PAPERS, "all"):
        raise CosimError(
            f"{paper!r} is no paper of this testbed",
            allowed=", ".join((*PAPERS, "all")),
            remedy=did_you_mean(paper, PAPERS),
        )
    return PAPERS if paper == "all" else (paper,)


def plan(paper="all"):
    """Return what is asked of a paper, as rows without their numbers: [Planned or Row]."""
    return [p for name in chosen(paper) for p in importlib.import_module(f"cosim.papers.{name}.rows").plan()]


def reproduce(paper="all", *, progress=None, workers=None):
    """Return (rows, drawings) of `paper`, one of PAPERS or "all"; `progress(done, total)` is called between papers.

    Several papers run in `workers` processes, by default one per core; 0 stays in this process.
    """
    names = chosen(paper)
    tell = progress or (lambda done, total: None)
    tell(0, len(names))
    found: dict = {}
    calls = [(name, one, (name,)) for name in LONGEST_FIRST if name in names]
    for name, made in finished(calls, workers=0 if len(names) == 1 else workers):
        found[name] = made
        tell(len(found), len(names))
    return [r for n in names for r in found[n][0]], [d for n in names for d in found[n][1]]


def one(name):
    """Return (rows, drawings) of one paper."""
    rows = [p.judge() for p in importlib.import_module(f"cosim.papers.{name}.rows").plan()]
    return rows, importlib.import_module(f"cosim.papers.{name}.figures").drawings()


__all__ = ["PAPERS", "VERDICTS", "Row", "counts", "plan", "reproduce"]
