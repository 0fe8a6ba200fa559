"""What the papers say, as data: `PAPER/claims.toml` has a row per claim, and names the function that measures it.

[[row]]
item = "figure 3(a): …"         # what is looked at, and its unit
says = "IV.D: …"                # the quotation and its place, and what of the band is ours
measure = "stats.number"        # module and function in the paper's folder; returns a number, or (number, note)
with = { scenario = "…" }       # its arguments
band = [0.95, 1.05]             # what agrees
reason = "…"                    # why a claim leaves its band: only where it does, with
found = [0.38, 0.47]            # the second band: what was found, as wide as its scatter
spread = "10 sets of 10 seeds"  # where that width comes from
piece = "…"                     # rows of one piece are measured in one process
"""

import importlib
import inspect
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError, model_validator

from cosim.papers.row import Planned

Number = Annotated[float, Field(strict=True)]
Band = tuple[Number, Number]


class Claim(BaseModel, extra="forbid"):
    """A row as it stands in a claims.toml."""

    item: str
    says: str
    measure: str
    with_: dict[str, Any] = Field({}, alias="with")
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


def load(paper: str, text: str | None = None) -> list[Planned]:
    """Return the rows of a paper; `text` instead of its file. Raises ValueError with row, key and what is allowed."""
    if text is None:
        text = (Path(__file__).parent / paper / "claims.toml").read_text(encoding="utf-8")
    whole = tomllib.loads(text)
    if set(whole) != {"row"}:
        raise ValueError(f"{paper}/claims.toml holds {', '.join(sorted(whole))}; allowed: [[row]] only")
    rows = [_planned(paper, i, row) for i, row in enumerate(whole["row"], 1)]
    items = [row.item for row in rows]
    for item in items:
        if items.count(item) > 1:
            raise ValueError(f"{paper}/claims.toml has two rows with item = {item!r}")
    return rows


def _planned(paper, number, row):
    where = f"{paper}/claims.toml, row {number} ({row.get('item', 'without item')})"
    try:
        c = Claim.model_validate(row)
    except ValidationError as error:
        raise ValueError(f"{where}: {error}") from None
    measure = _measure(paper, where, c.measure, c.with_)
    return Planned(paper, c.item, c.says, measure, *c.band, c.reason, c.piece, c.found, c.spread, c.measure)


def _measure(paper, where, name, arguments):
    """Return the function `name` with its arguments."""
    module, _, function = name.partition(".")
    try:
        place = importlib.import_module(f"cosim.papers.{paper}.{module}")
        inspect.signature(getattr(place, function)).bind(**arguments)
    except (ImportError, AttributeError, TypeError, ValueError) as e:
        raise ValueError(f"{where}: measure = {name!r} with {arguments}: {e}") from None
    plain = {k: _plain(v) for k, v in arguments.items()}
    return lambda: getattr(place, function)(**plain)


def _plain(value: Any) -> Any:
    """Return a value with tuples for lists, so that it can be an argument of a function with a cache."""
    return tuple(map(_plain, value)) if isinstance(value, list) else value
