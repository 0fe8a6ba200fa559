"""What commands share to show their results: tables, progress, numbers as text. Nothing here prints."""

import math
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

NOTHING = Text("-", style="dim")
EDGE = 1  # character that the box takes left of each column, and one more at the right


class Plain(Table):
    """A table that shows its cells as they are written: what somebody else named is no markup.

    Where the terminal is too narrow for its widest numbers it leaves out the columns `spare`, in this order and with a
    line that says so, and stacks what is still too wide in parts, each of which begins with the first `keys` columns.
    """

    def __init__(self, *heads: Any, spare: Sequence[str] = (), keys: int = 1, **how: Any):
        super().__init__(*heads, **how)
        self.spare, self.keys = spare, keys

    def add_row(self, *cells: Any, **how: Any) -> None:
        """Add a row of texts and renderables."""
        super().add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in cells), **how)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        need, room = self._needs(), options.max_width - EDGE
        left_out = self._left_out(need, room)
        parts = _stacked(need, [i for i in range(len(need)) if i not in left_out], self.keys, room)
        if sum(need) <= room:
            yield from super().__rich_console__(console, options)
            return
        for k, part in enumerate(parts):
            yield self._part(part, room, title=self.title if k == 0 else None)
        if self.caption:
            yield Text(str(self.caption), style="dim italic")
        if left_out:
            names = ", ".join(str(self.columns[i].header) for i in sorted(left_out))
            yield Text(
                f"left out of {options.max_width} columns: {names}; a wider terminal and --json have them", "dim"
            )

    def _needs(self):
        return [_least(column) + sum(self.padding[1::2]) + EDGE for column in self.columns]

    def _left_out(self, need, width):
        out: list[int] = []
        heads = [str(column.header) for column in self.columns]
        for name in (name for name in self.spare if name in heads):
            if sum(n for i, n in enumerate(need) if i not in out) <= width:
                break
            out.append(heads.index(name))
        return out

    def _part(self, columns, width, title):
        made = Plain(
            title=title, box=self.box, pad_edge=self.pad_edge, padding=self.padding, show_header=self.show_header
        )
        made.title_justify, made.title_style = self.title_justify, self.title_style
        for i in columns:
            own = self.columns[i]
            made.add_column(own.header, justify=own.justify, no_wrap=own.no_wrap, overflow="fold", ratio=own.ratio)
        rows = [list(self.columns[i].cells) for i in columns]
        for row, cells in zip(self.rows, zip(*rows)):
            made.add_row(*cells, style=row.style)
        if sum(made._needs()) > width:  # not even these few fit: their words are folded
            for column in made.columns:
                column.no_wrap = False
        return made


def _least(column):
    """Return the width at which nothing of a column is cut: its longest cell, of one that folds its longest word."""
    texts = [str(cell) for cell in (column.header, *column.cells)]
    pieces = [piece for text in texts for piece in (text.splitlines() if column.no_wrap else text.split())]
    return max(map(cell_len, pieces), default=0)


def _stacked(need, shown, keys, width):
    """Return lists of columns `shown`, each as wide as fits and with the first `keys` of them in front."""
    head, rest = shown[:keys], shown[keys:]
    room, parts = width - sum(need[i] for i in head), [[]]
    for i in rest:
        if parts[-1] and sum(need[j] for j in parts[-1]) + need[i] > room:
            parts.append([])
        parts[-1].append(i)
    return [[*head, *part] for part in parts]


def table(title: str, *columns: str, **options: Any) -> Table:
    """Return an empty table in the house style; a column named with a trailing > is right-aligned."""
    heading = Text(f"\n{title}", style="bold") if title else None
    made = Plain(
        title=heading,
        title_justify="left",
        title_style="",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
        **options,
    )
    for i, name in enumerate(columns):
        right = name.endswith(">")
        made.add_column(
            Text(name.removesuffix(">")), justify="right" if right else "left", no_wrap=right or i == 0, overflow="fold"
        )
    return made


@contextmanager
def progress(
    console: Console, text: str, unit: str = "s", waiting: str = ""
) -> Iterator[Callable[[float, float], None]]:
    """Show a bar on a terminal, `waiting` until its callback (done, total) is first called with something done."""
    if not console.is_terminal:
        yield lambda done, total: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    named, state = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[state]}")
    columns = (named, BarColumn(), state, TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(waiting or text, total=None, state="")

        def move(done, total):
            if done > 0:
                bar.update(task, description=text, completed=done, total=total, state=f"{done:.0f}/{total:.0f} {unit}")

        yield move


@contextmanager
def compiling(console: Console) -> Iterator[Callable[[int, int], None]]:
    """Give a callback (i, n) that says "compiling 7 of 30" on a terminal; one line elsewhere."""
    said = False

    def tell(i, n):
        nonlocal said
        if console.is_terminal:
            status.update(f"compiling {i} of {n}, once on a machine")
            status.start()
        elif not said:
            console.print(f"compiling {n} kernels, once on a machine", highlight=False)
        said = True

    status = console.status("")
    try:
        yield tell
    finally:
        status.stop()


def number(value: float | None, digits: int = 2) -> Text | str:
    """Return a number as text, or a dash when there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def cell(value: Any) -> str:
    """Return a table cell: short numbers, a dash for nothing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def bare(value: Any) -> Any:
    """Return a NumPy number as JSON can hold it."""
    return value.item()


def word(path: Any) -> str:
    """Return a path as it stands in a command: quoted where it must be, one with a leading dash no option."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def whole(text: Text | str) -> Text:
    """Return a line that is not folded: a path or a command that is copied."""
    made = Text(text) if isinstance(text, str) else text
    made.no_wrap, made.overflow = True, "ignore"
    return made
