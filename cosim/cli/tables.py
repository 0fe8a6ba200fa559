"""What commands share to show their results: progress, and paths and commands as text. Nothing here prints."""

import shlex
from typing import Any

from rich.console import Console
from rich.text import Text

from cosim.progress import Progress


def progress(console: Console, text: str, unit: str = "s", waiting: str = "") -> Progress:
    """Return what shows progress on `console`, `waiting` until its callback (done, total) is first called."""
    return Progress(text, unit, waiting=waiting, console=console)


def word(path: Any) -> str:
    """Return a path as it stands in a command: quoted where it must be, one with a leading dash no option."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def whole(text: Text | str) -> Text:
    """Return a line that is not folded: a path or a command that is copied."""
    made = Text(text) if isinstance(text, str) else text
    made.no_wrap, made.overflow = True, "ignore"
    return made
