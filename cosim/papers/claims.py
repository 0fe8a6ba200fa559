"""What the papers say, as data: `PAPER/claims.toml` has a row per claim, and names the function that measures it.

[[row]]
item = "figure 3(a): …"         # what is looked at, and its unit
says = "IV.D: …"                # the quotation and its place, and what of the band is ours
measure = "stats.number"        # module and function in the paper's folder; returns a number, or (number, note)
with = { scenario = "…" }       # its arguments
beside = { "words" = { … } }    # other arguments, whose number stands in the note under these words
band = [0.95, 1.05]             # what agrees: what the paper states, or what its figure can show
reason = "…"                    # why a claim leaves its band: only where it does, with
found = [0.38, 0.47]            # the second band: what was found, as wide as its scatter
spread = "10 sets of 10 seeds"  # where that width comes from
piece = "…"                     # rows of one piece are measured in one process: they share what they fly
"""

import importlib
import math
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, TypeAdapter, model_validator

VERDICTS = ("agrees", "differs_explained", "differs")
Number = Annotated[float, Field(strict=True)]
Band = tuple[Number, Number]


@dataclass(frozen=True)
class Row:
    """A published statement beside our number."""

    paper: str  # key of the paper, "jay"
    item: str  # figure, table or section, and what is looked at
    says: str  # the paper's number or words and where they stand
    got: float  # ours, in the unit that `item` or `says` names
    tolerance: str  # band that was committed before the run
    verdict: str  # one of VERDICTS
    reason: str  # why it differs, empty when it agrees
    evidence: str  # command that prints a figure which supports the reason
    note: str = ""  # what came with the number, "phase -8 deg"


class Claim(BaseModel, extra="forbid"):
    """A row as it stands in a claims.toml."""

    paper: str
    item: str
    says: str
    measure: str
    with_: dict[str, Any] = Field({}, alias="with")
    beside: dict[str, dict[str, Any]] = {}
    band: Band
    reason: str = ""
    found: Band | None = None
    spread: str = ""
    piece: str = ""

    @model_validator(mode="after")
    def _together(self):
        if len({bool(self.reason), self.found is not None, bool(self.spread)}) > 1:
            raise ValueError("reason, found and spread stand together: why it differs, where, and how wide")
        for low, high in filter(None, (self.band, self.found)):
            if not low <= high or (low, high) == (-math.inf, math.inf):
                raise ValueError(f"[{low:g}, {high:g}] is not [least, largest]")
        return self

    def function(self) -> Callable:
        """Return the function that measures the claim."""
        module, _, name = self.measure.partition(".")
        return getattr(importlib.import_module(f"cosim.papers.{self.paper}.{module}"), name)

    def judge(self) -> Row:
        """Measure and return the Row."""
        got, note = self._number(self.with_)
        notes = [note, *(f"{words} {self._number(self.with_ | other)[0]:.3g}" for words, other in self.beside.items())]
        return self.row(got, "; ".join(filter(None, notes)))

    def _number(self, arguments):
        measured = self.function()(**arguments)
        return measured if isinstance(measured, tuple) else (measured, "")

    def row(self, got: float, note: str = "") -> Row:
        """Return the Row of a number: outside its band a claim is explained only within `found`."""
        band, verdict = "{:g} .. {:g}".format(*self.band), "differs"
        if self.found is not None:
            band += "; found {:g} .. {:g}".format(*self.found)
            verdict = "differs_explained" if self.found[0] <= got <= self.found[1] else verdict
        if self.band[0] <= got <= self.band[1] and math.isfinite(got):
            verdict = "agrees"
        why = (self.reason, f"cosim reproduce {self.paper}") if verdict == "differs_explained" else ("", "")
        return Row(self.paper, self.item, self.says, float(got), band, verdict, *why, note)


def load(paper: str, text: str | None = None) -> list[Claim]:
    """Return the claims of a paper; `text` instead of its file. Raises ValueError with row, key and what is allowed."""
    if text is None:
        text = (Path(__file__).parent / paper / "claims.toml").read_text(encoding="utf-8")
    rows = TypeAdapter(list[Claim]).validate_python([{"paper": paper, **row} for row in tomllib.loads(text)["row"]])
    if len({row.item for row in rows}) < len(rows):
        raise ValueError(f"{paper}/claims.toml has two rows with the same item")
    return rows


def counts(rows: Iterable[Row]) -> dict[str, int]:
    """Return {verdict: number of rows} in the order of VERDICTS."""
    rows = list(rows)
    return {v: sum(r.verdict == v for r in rows) for v in VERDICTS}
