"""One row of `cosim reproduce`: what a paper says, what we get, and whether they agree.

Three verdicts for a row with a claim of the paper. A number that the paper does not give is `ours`: it stands beside
the paper, counts apart and can neither agree nor disagree with it. It may carry a band of its own derivation, on which
the reason of another row rests; when it leaves that, it `differs` like any other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

VERDICTS = ("agrees", "differs_explained", "differs", "ours")
ANY = (-math.inf, math.inf)


@dataclass(frozen=True)
class Row:
    """A published statement beside our number; `judged` makes it."""

    paper: str      # key of the paper, "jay"
    item: str       # figure, table or section, and what is looked at
    says: str       # the paper's number and where it stands
    got: float      # ours, in the unit that `item` or `says` names
    tolerance: str  # band that was committed before the run, "none" for a number that only stands beside the paper
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
    claim: bool = True  # False: the paper gives no such number

    def __post_init__(self):
        if not self.claim and (self.reason or self.evidence):
            raise ValueError(f"{self.paper}, {self.item}: without a claim there is no difference to explain")

    def judge(self):
        """Return the Row."""
        found = self.measure()
        got, note = found if isinstance(found, tuple) else (found, "")
        why = {"reason": self.reason, "evidence": self.evidence}
        return judged(self.paper, self.item, self.says, got, self.low, self.high, note=note, claim=self.claim, **why)


def judged(paper, item, says, got, low, high, *, reason="", evidence="", note="", claim=True):
    """Return the Row of a number that should lie in low .. high; reason and evidence count only outside.

    Outside the band it is `differs_explained` when a reason with evidence was committed, else `differs`; a number that
    is not finite differs always. Without a `claim` of the paper it is `ours` inside the band.
    """
    got = float(got)
    inside = low <= got <= high and abs(got) != float("inf")
    explained = bool(reason and evidence) and got == got and abs(got) != float("inf")
    agrees = "agrees" if claim else "ours"
    verdict = agrees if inside else "differs_explained" if explained else "differs"
    shown = not inside
    band = f"{low:g} .. {high:g}" if claim or (low, high) != ANY else "none"
    return Row(paper, item, says, got, band, verdict, reason if shown else "", evidence if shown else "", note)


def ours(paper, item, measure, low=-math.inf, high=math.inf, *, says="not in the paper"):
    """Return the Planned row of a number that the paper does not give; low .. high is derived, by default no band."""
    return Planned(paper, item, says, measure, low, high, claim=False)


def counts(rows):
    """Return {verdict: number of rows} in the order of VERDICTS."""
    return {v: sum(r.verdict == v for r in rows) for v in VERDICTS}
