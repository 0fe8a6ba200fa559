"""The papers' own experiments, row by row: what a paper says, what we get, and whether they agree.

Expected values and tolerances are committed in a module per paper, whose `rows()` flies the experiments. No row is left
out because it disagrees; one that does names the command whose figure explains it.
"""

import importlib

from cosim.errors import CosimError, did_you_mean
from cosim.reproduce.row import VERDICTS, Row, counts

PAPERS = ("lu17", "jay", "sun13", "mar10", "alwi14")


def reproduce(paper="all", *, progress=None):
    """Return the rows of `paper`, one of PAPERS or "all"; `progress(done, total)` is called between papers.

    Raises CosimError for a paper that is none.
    """
    if paper not in (*PAPERS, "all"):
        raise CosimError(
            f"{paper!r} is no paper of this testbed",
            allowed=", ".join((*PAPERS, "all")),
            remedy=did_you_mean(paper, PAPERS),
        )
    chosen, out = PAPERS if paper == "all" else (paper,), []
    for i, name in enumerate(chosen):
        if progress:
            progress(i, len(chosen))
        out += importlib.import_module(f"cosim.reproduce.{name}").rows()
    if progress:
        progress(len(chosen), len(chosen))
    return out


__all__ = ["PAPERS", "VERDICTS", "Row", "counts", "reproduce"]
