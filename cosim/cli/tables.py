"""What commands share to show their results: tables, progress, numbers as text. Nothing here prints."""

import math
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich import box
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

NOTHING = Text("-", style="dim")


class Plain(Table):
    """A table that shows its cells as they are written: what somebody else named is no markup."""

    def add_row(self, *cells: Any, **how: Any) -> None:
        """Add a row of texts and renderables."""
        super().add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in cells), **how)


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
        made.add_column(Text(name.removesuffix(">")), justify="right" if right else "left", no_wrap=right or i == 0)
    return made


@contextmanager
def progress(
    console: Console, text: str, unit: str = "s", waiting: str = ""
) -> Iterator[Callable[[float, float], None]]:
    """Show a bar on a terminal, `waiting` until its callback (done, total) is first called with something done."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    named, state = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[state]}")
    columns = (named, BarColumn(), state, TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
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


def plain(made: Any) -> Any:
    """Return a study's Table with its notes."""
    shown = table(made.title, *made.columns)
    for row in made.rows:
        shown.add_row(*map(cell, row))
    return Group(shown, *(Text(note, style="dim") for note in made.notes))


def word(path: Any) -> str:
    """Return a path as it stands in a command: quoted where it must be, one with a leading dash no option."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def whole(text: Text | str) -> Text:
    """Return a line that is not folded: a path or a command that is copied."""
    made = Text(text) if isinstance(text, str) else text
    made.no_wrap, made.overflow = True, "ignore"
    return made
