"""Tables of the papers' rows, the same in terminal, page and README."""

from collections.abc import Iterable

from cosim.papers.broken import Broken
from cosim.papers.row import Row
from cosim.table import Cell, Column, Table, number, of

VERDICTS = {  # verdict -> word, tone
    "agrees": ("agrees", "good"),
    "differs_explained": ("differs, explained", "warn"),
    "differs": ("differs", "bad"),
    "ours": ("ours", "muted"),
    "beyond": ("beyond", ""),
}
MEANING = (
    "Each band stands in the code beside the sentence, table or figure it is from. Ours: a number that the paper does "
    "not give; beyond: what its authors announce, or we add. A band of these holds what was found."
)


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


def proof(found: Iterable[Broken]) -> Table:
    """Return the Table of what rows show with the method broken."""
    columns = (
        Column("paper", lambda b: b.paper, right=False), Column("row", lambda b: b.item, right=False),
        Column("what was broken", lambda b: b.what, right=False), Column("kind", lambda b: b.kind, right=False),
        Column("value then", lambda b: number(b.got)), Column("band", lambda b: b.band, right=False),
        Column("seen", lambda b: Cell("yes", "good") if b.seen else Cell("not seen", "bad"), right=False),
    )  # fmt: skip
    return of(columns, found, kind="")
