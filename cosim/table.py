"""One table and its three renderings: rich for a terminal, HTML for a page or a notebook, Markdown for a README."""

import html
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

DASH = "–"
MORE = 5  # rank from which on a page shows a column on demand
EASY = 22  # characters of a column of words that are not folded for the sake of a column that can be left out
EDGE = 1  # character that the box takes left of each column, and one more at the right
STYLES = {"good": "green", "bad": "red", "warn": "yellow", "muted": "dim", "bold": "bold"}  # tone -> style of rich


class Cell(NamedTuple):
    """A text with a tone (good, bad, warn, muted, bold, code, or a CSS class c-…) and what a page shows on hover."""

    text: Any
    tone: str = ""
    title: str = ""


@dataclass(frozen=True)
class Column:
    """A column: its name, unit and meaning, and how its cell is taken from a record.

    `get` is a function of the record, or a key of it (default: the name). `rank` orders what a narrow terminal leaves
    out, the highest first, 0 never; from MORE on a page shows the column on demand. `detector`: hidden with that one.
    """

    name: str
    get: Callable[[Any], Any] | str = ""
    unit: str = ""
    doc: str = ""
    rank: int = 0
    right: bool = True
    detector: str = ""

    @property
    def head(self) -> str:
        """Return the name with its unit: "first alarm, s"."""
        return f"{self.name}, {self.unit}" if self.unit else self.name

    def of(self, record: Any) -> Any:
        """Return the cell of a record."""
        return self.get(record) if callable(self.get) else record.get(self.get or self.name)


@dataclass
class Row:
    """Cells, the tone of the whole row, and the detector with which a page hides it."""

    cells: Sequence[Any]
    tone: str = ""
    detector: str = ""


class Table:
    """A table of columns and rows; a column given as a text is one of words, with a trailing > one of figures.

    It renders itself in a terminal (rich), on a page (Jinja), in a notebook (HTML) and as Markdown. The first `keys`
    columns stand in front of each part of a table that is too wide for a terminal.
    """

    def __init__(self, title: str = "", *columns: "Column | str", rows: Iterable[Row] = (), caption: str = "",
                 kind: str = "wide", keys: int = 1, heads: bool = True):  # fmt: skip
        self.title, self.caption, self.kind, self.keys, self.heads = title, caption, kind, keys, heads
        self.columns = [column(c) if isinstance(c, str) else c for c in columns]
        self.rows = list(rows)

    def add(self, *cells: Any, tone: str = "", detector: str = "") -> None:
        """Add a row."""
        self.rows.append(Row(cells, tone, detector))

    def legend(self, columns: Iterable[Column] = (), more: str = "") -> str:
        """Return what the columns mean, those that say it: "seen: …; …"."""
        told = [f"{c.name}: {c.doc}" for c in columns or self.columns if c.doc]
        return ". ".join(filter(None, ("; ".join(told), more or self.caption)))

    def upto(self, rank: int) -> "Table":
        """Return the table without the columns above `rank`."""
        kept = [i for i, c in enumerate(self.columns) if c.rank <= rank]
        rows = [Row([r.cells[i] for i in kept], r.tone, r.detector) for r in self.rows]
        how: dict[str, Any] = {"caption": self.caption, "kind": self.kind, "keys": self.keys, "heads": self.heads}
        return Table(self.title, *(self.columns[i] for i in kept), rows=rows, **how)

    def markdown(self) -> str:
        """Return the table as Markdown: `code` and **bad** as such, a bar in a cell escaped."""
        lines = [[c.head for c in self.columns], ["---"] * len(self.columns)]
        lines += [[_marked(cell).replace("|", "\\|") for cell in row.cells] for row in self.rows]
        return "\n".join(f"| {' | '.join(line)} |" if i != 1 else f"|{'|'.join(line)}|" for i, line in enumerate(lines))

    def __html__(self) -> str:
        """Return the table for a page: columns of a high rank hidden until a button shows them; print shows all."""
        rows = "".join(self._row(row) for row in self.rows)
        heads = "".join(f"<th{self._td(i, c.doc)}>{html.escape(c.head)}</th>" for i, c in enumerate(self.columns))
        head = f"<thead><tr>{heads}</tr></thead>" if self.heads else ""
        kind = f' class="{self.kind}"' if self.kind else ""
        away, narrow = ([c.name for c in self.columns if c.rank >= least] for least in (MORE, 1))
        look = "more" if away else "more narrow"
        words = f"show all {len(self.columns)} columns: {', '.join(map(html.escape, away or narrow))}"
        more = f'<button class="{look}" aria-expanded="false">{words}</button>' if narrow else ""
        note = f'<p class="note">{html.escape(told)}</p>' if (told := self.legend()) else ""
        return (f'<div class="table"><div class="scroll"><table{kind}>{head}<tbody>{rows}</tbody></table></div>{more}'
                f"{note}</div>")  # fmt: skip

    def _repr_html_(self) -> str:
        shown = self.upto(MORE - 1)
        return f"<b>{html.escape(self.title)}</b>{shown.__html__()}" if self.title else shown.__html__()

    def _row(self, row):
        own = f' class="{row.tone}"' if row.tone else ""
        own += f' data-detector="{html.escape(row.detector)}"' if row.detector else ""
        if len(row.cells) == 1 < len(self.columns):  # a heading of its own
            return f'<tr class="group"><th colspan="{len(self.columns)}">{_tagged(row.cells[0])}</th></tr>'
        cells = []
        for i, cell in enumerate(row.cells):
            tag = "th" if self.kind.startswith("matrix") and i == 0 else "td"
            look = cell.tone if isinstance(cell, Cell) and cell.tone.startswith("c-") else ""
            title = cell.title if isinstance(cell, Cell) else ""
            cells.append(f"<{tag}{self._td(i, title, look)}>{_tagged(cell)}</{tag}>")
        return f"<tr{own}>{''.join(cells)}</tr>"

    def _td(self, i, title="", look=""):
        c = self.columns[i]
        names = ["n"] * c.right + ["more" if c.rank >= MORE else "lesser"] * (c.rank > 0) + [look] * bool(look)
        out = f' class="{" ".join(names)}"' if names else ""
        out += f' data-detector="{html.escape(c.detector)}"' if c.detector else ""
        return out + (f' title="{html.escape(title)}"' if title else "")

    def __rich_console__(self, console: Any, options: Any) -> Iterator[Any]:
        """Render for a terminal: no text is cut. Columns are left out by rank, with a line that says so; what is still
        too wide is stacked in parts."""
        from rich.text import Text

        if self.title:
            yield Text(f"\n{self.title}", style="bold")
        room, shown = options.max_width - EDGE, list(range(len(self.columns)))
        widths, easy = ([self._width(i, least) for i in shown] for least in (0, EASY))
        for i in sorted(shown, key=lambda i: (-self.columns[i].rank, -i)):
            if sum(easy[j] for j in shown) <= room or not self.columns[i].rank:
                break
            shown.remove(i)
        for part in _stacked(widths, shown, self.keys, room):
            yield self._part(part, room, widths)
        if told := self.legend([self.columns[i] for i in shown]):
            yield Text(told, style="dim")
        if gone := [c.name for i, c in enumerate(self.columns) if i not in shown]:
            left = f"left out of {options.max_width} columns: {', '.join(gone)}; a wider terminal and --json have them"
            yield Text(left, style="dim")

    def _width(self, i, easy):
        """Return the width at which nothing of a column is cut: its longest cell, of one of words its longest word, or
        up to `easy` characters of a cell without folding it."""
        from rich.cells import cell_len

        whole = self.columns[i].right or i == 0
        cells = [str(text(r.cells[i])) for r in self.rows if i < len(r.cells)]
        pieces = [p for t in cells for p in (t.splitlines() if whole else t.split())]
        unfolded = max((min(cell_len(t), easy) for t in cells), default=0)
        return max(unfolded, *map(cell_len, [*pieces, *self._head(i).split(), ""])) + 1 + EDGE

    def _head(self, i):
        return self.columns[i].head if self.heads else ""

    def _part(self, columns, room, widths):
        from rich import box
        from rich.table import Table as RichTable
        from rich.text import Text

        made = RichTable(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_header=self.heads)
        fits = sum(widths[i] for i in columns) <= room
        for i in columns:
            c, least = self.columns[i], widths[i] - 1 - EDGE
            whole = fits and (c.right or i == 0)
            head = "\n".join(textwrap.wrap(self._head(i), max(least, 1))) if whole else self._head(i)
            made.add_column(Text(head), justify="right" if c.right else "left", overflow="fold", no_wrap=whole)
        for row in self.rows:
            cells = [_styled(row.cells[i]) if i < len(row.cells) else Text("") for i in columns]
            made.add_row(*cells, style=STYLES.get(row.tone, ""))
        return made


def column(name: str, **about: Any) -> Column:
    """Return the Column of a text: with a trailing > one of figures."""
    return Column(name.removesuffix(">"), right=name.endswith(">"), **about)


def of(columns: Sequence[Column], records: Iterable[Any], tone: Callable[[Any], str] = lambda _: "",
       **about: Any) -> Table:  # fmt: skip
    """Return the Table of records, a row each, cells as the columns take them; `tone` is that of a record's row."""
    made = Table(about.pop("title", ""), *columns, **about)
    for record in records:
        name = record.get("id", "") if isinstance(record, dict) else ""
        made.add(*(c.of(record) for c in columns), tone=tone(record), detector=name)
    return made


def number(value: Any, digits: int = 3) -> str:
    """Return a number in `digits` significant digits, at least those before its point; a dash for none."""
    if value is None or not math.isfinite(value):
        return DASH
    if isinstance(value, int) or 10.0**digits <= abs(value) < 1e7:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def share(value: float | None) -> str:
    """Return a share in per cent; a dash for none."""
    return DASH if value is None or value != value else f"{value:.0%}"


def text(cell: Any) -> str:
    """Return a cell's text: numbers short, a dash for nothing."""
    value = cell.text if isinstance(cell, Cell) else cell
    if value is None or isinstance(value, float):
        return number(value)
    return str(value)


def _marked(cell):
    tone = cell.tone if isinstance(cell, Cell) else ""
    mark = {"code": "`", "bad": "**"}.get(tone, "")
    return f"{mark}{text(cell)}{mark}" if text(cell) else ""


def _tagged(cell):
    told = html.escape(text(cell)).replace("\n", "<br>")
    tone = cell.tone if isinstance(cell, Cell) else ""
    tag = {"bold": "b", "code": "code"}.get(tone)
    if tag:
        return f"<{tag}>{told}</{tag}>"
    return f'<span class="{tone}">{told}</span>' if tone and not tone.startswith("c-") else told


def _styled(cell):
    """Return a cell as rich shows it: no markup of a user's is read."""
    from rich.text import Text

    if not isinstance(cell, Cell | str | int | float | None):
        return cell
    told, tone = text(cell), cell.tone if isinstance(cell, Cell) else ""
    return Text(told, style=STYLES.get(tone, "dim" if told == DASH else ""))


def _stacked(widths, shown, keys, room):
    """Return lists of columns `shown`, each as wide as fits and with the first `keys` of them in front."""
    head, rest = shown[:keys], shown[keys:]
    free = room - sum(widths[i] for i in head)
    parts: list[list[int]] = [[]]
    for i in rest:
        if parts[-1] and sum(widths[j] for j in parts[-1]) + widths[i] > free:
            parts.append([])
        parts[-1].append(i)
    return [[*head, *part] for part in parts]
