"""What commands share to show their results: progress, and paths and commands as text. Nothing here prints."""

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.text import Text


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
