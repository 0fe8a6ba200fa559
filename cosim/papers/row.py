"""One row of `cosim reproduce`: what a paper says, what we get, and whether they agree.

A row holds one claim of a paper to a band that the paper states, or that follows from what its figure can show. One
that leaves it for a known reason has a second band, what was found, as wide as its scatter: outside both it differs,
whatever the reason.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

VERDICTS = ("agrees", "differs_explained", "differs")


@dataclass(frozen=True)
class Row:
    """A published statement beside our number; `judged` makes it."""

    paper: str  # key of the paper, "jay"
    item: str  # figure, table or section, and what is looked at
    says: str  # the paper's number or words and where they stand
    got: float  # ours, in the unit that `item` or `says` names
    tolerance: str  # band that was committed before the run
    verdict: str  # one of VERDICTS
    reason: str  # why it differs, empty when it agrees
    evidence: str  # command that prints a figure which supports the reason
    note: str = ""  # what came with the number, "phase -8 deg"


@dataclass(frozen=True)
class Planned:
    """A statement with its band, before its number is known; `measure()` returns that, or (number, note)."""

    paper: str
    item: str
    says: str
    measure: Callable
    low: float
    high: float
    reason: str = ""  # why it is in `found` and not in the band; the rows that it names are printed by the same command
    piece: str = ""  # rows of one piece are measured in one process: they share what they fly
    found: tuple[float, float] | None = None  # what was found of a claim that leaves its band, as wide as its scatter
    spread: str = ""  # where that width comes from
    asks: str = ""  # name of the function that measures it

    def judge(self) -> Row:
        """Measure and return the Row.

        A claim outside its band is `differs_explained` when it is within `found`, for which a reason was committed.
        """
        found = self.measure()
        got, note = found if isinstance(found, tuple) else (found, "")
        got = float(got)
        inside = self.low <= got <= self.high and math.isfinite(got)
        explained = bool(self.reason) and self.found is not None and self.found[0] <= got <= self.found[1]
        verdict = "agrees" if inside else "differs_explained" if explained else "differs"
        band = f"{self.low:g} .. {self.high:g}"
        if self.found is not None:
            band += f"; found {self.found[0]:g} .. {self.found[1]:g}"
        why, evidence = (self.reason, f"cosim reproduce {self.paper}") if verdict == "differs_explained" else ("", "")
        return Row(self.paper, self.item, self.says, got, band, verdict, why, evidence, note)


def counts(rows: Iterable[Row]) -> dict[str, int]:
    """Return {verdict: number of rows} in the order of VERDICTS."""
    rows = list(rows)
    return {v: sum(r.verdict == v for r in rows) for v in VERDICTS}
