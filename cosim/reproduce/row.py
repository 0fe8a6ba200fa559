"""One row of `cosim reproduce`: what a paper says, what we get, and whether they agree."""

from collections.abc import Callable
from dataclasses import dataclass

VERDICTS = ("agrees", "differs_explained", "differs")


@dataclass(frozen=True)
class Row:
    """A published statement beside our number; `judged` makes it."""

    paper: str      # key of the paper, "jay"
    item: str       # figure, table or section, and what is looked at
    says: str       # the paper's number and where it stands
    got: float      # ours, in the unit that `item` or `says` names
    tolerance: str  # band that was committed before the run
    verdict: str    # one of VERDICTS
    reason: str     # why it differs, empty when it agrees
    evidence: str   # command that prints a figure which supports the reason
    note: str = ""  # what came with the number, "phase -8 deg"

    def __post_init__(self):
        if self.verdict not in VERDICTS:
            raise ValueError(f"verdict {self.verdict!r} is not one of {', '.join(VERDICTS)}")
        if self.verdict == "differs_explained" and not (self.reason and self.evidence):
            raise ValueError(f"{self.paper}, {self.item}: an explained difference needs a reason and a command for it")

    def judge(self):
        """Return this row: its number was known when it was planned."""
        return self


@dataclass(frozen=True)
class Planned:
    """A statement with its band, before its number is known; `measure()` returns that, or (number, note)."""

    paper: str
    item: str
    says: str
    measure: Callable
    low: float
    high: float
    reason: str = ""
    evidence: str = ""

    def judge(self):
        """Return the Row."""
        found = self.measure()
        got, note = found if isinstance(found, tuple) else (found, "")
        why = {"reason": self.reason, "evidence": self.evidence}
        return judged(self.paper, self.item, self.says, got, self.low, self.high, note=note, **why)


def judged(paper, item, says, got, low, high, *, reason="", evidence="", note=""):
    """Return the Row of a number that should lie in low .. high; reason and evidence count only outside.

    Outside the band it is `differs_explained` when a reason with evidence was committed, else `differs`; a number that
    is not finite differs always.
    """
    got = float(got)
    inside = low <= got <= high
    explained = bool(reason and evidence) and got == got and abs(got) != float("inf")
    verdict = "agrees" if inside else "differs_explained" if explained else "differs"
    shown = not inside
    band = f"{low:g} .. {high:g}"
    return Row(paper, item, says, got, band, verdict, reason if shown else "", evidence if shown else "", note)


def counts(rows):
    """Return {verdict: number of rows} in the order of VERDICTS."""
    return {v: sum(r.verdict == v for r in rows) for v in VERDICTS}
