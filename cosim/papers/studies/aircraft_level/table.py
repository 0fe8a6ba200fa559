"""A printed table and the numbers in it."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Hold rows under a head; notes stand below."""

    title: str
    head: tuple
    rows: list
    notes: tuple = ()

    def text(self):
        """Return the table as lines of text, columns aligned."""
        cells = [[str(c) for c in self.head], *([_cell(c) for c in row] for row in self.rows)]
        width = [max(len(row[i]) for row in cells) for i in range(len(self.head))]
        lines = [
            "  ".join(c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, width))) for row in cells
        ]
        return "\n".join([self.title, lines[0], "-" * len(lines[0]), *lines[1:], *self.notes])

    def plain(self):
        """Return what JSON can hold: numbers that are not finite become null."""
        return {
            "title": self.title,
            "rows": [{h: _json(c) for h, c in zip(self.head, row)} for row in self.rows],
            "notes": list(self.notes),
        }


def _cell(c):
    if isinstance(c, bool) or not isinstance(c, float):
        return "-" if c is None else str(c)
    return "-" if math.isnan(c) else f"{c:.3g}" if abs(c) < 1e4 else f"{c:.0f}"


def _json(c):
    if isinstance(c, float) and not math.isfinite(c):
        return None
    return c.item() if hasattr(c, "item") else c
