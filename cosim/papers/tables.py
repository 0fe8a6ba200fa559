"""Tables of the papers' rows, the same in terminal and page."""

from collections.abc import Iterable

from cosim.papers.claims import Row
from cosim.table import Cell, Column, Table, number, of

VERDICTS = {  # verdict -> word, tone
    "agrees": ("agrees", "good"),
    "differs_explained": ("differs, explained", "warn"),
    "differs": ("differs", "bad"),
}
MEANING = "Each band stands in the code beside the sentence, table or figure it is from."


def _why(r: Row) -> str:
    return "; ".join(filter(None, (f"{r.reason} ({r.evidence})" if r.reason else "", r.note)))


def rows(found: Iterable[Row], several: bool = False) -> Table:
    """Return the Table of papers' rows; with `several` papers each row names its own."""
    columns = (
        *([Column("paper", lambda r: r.paper, right=False)] * several),
        Column("what", lambda r: r.item, right=False), Column("paper says", lambda r: r.says, right=False),
        Column("we get", lambda r: number(r.got)), Column("band", lambda r: r.tolerance, right=False),
        Column("verdict", lambda r: Cell(*VERDICTS[r.verdict]), right=False),
        Column("why, and what came with it", _why, rank=1, right=False),
    )  # fmt: skip
    return of(columns, found, kind="")
