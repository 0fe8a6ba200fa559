"""Progress of long work: a bar on a terminal or in a notebook, a line now and then in a plain file."""

import time
from types import TracebackType
from typing import Any

FIRST_S, EVERY_S = 10.0, 30.0  # of the clock, to the first line in a plain file and from each to the next


class Progress:
    """A callback (done, total) that shows how far something is; also a context manager, which ends it.

    `text` says what goes on, `unit` what is counted, `waiting` what goes on before anything is done; `console` is a
    rich Console, by default that of standard error.

        run_campaign("my.toml", progress=cosim.Progress("flying", "runs"))
    """

    def __init__(self, text: str = "", unit: str = "", *, waiting: str = "", console: Any = None):
        from rich.console import Console

        self._text, self._unit, self._waiting = text, unit, waiting
        self._console = console or Console(stderr=True)
        self._shown = self._console.is_terminal or self._console.is_jupyter
        self._bar: Any = None
        self._next = time.monotonic() + FIRST_S

    def __call__(self, done: float, total: float) -> None:
        """Show that `done` of `total` are done; the bar goes when all are."""
        if self._shown and (done > 0 or not self._waiting):
            state = f"{done:.0f}/{total:.0f} {self._unit}"
            self._open().update(0, description=self._text, completed=done, total=total, state=state)
        elif not self._shown and time.monotonic() >= self._next:
            self._next = time.monotonic() + EVERY_S
            self._console.print(f"{self._text}: {done:.0f} of {total:.0f} {self._unit}", highlight=False, markup=False)
        if done >= total:
            self.close()

    def _open(self):
        if self._bar is None:
            from rich import progress as rich

            named, state = rich.TextColumn("{task.description}", markup=False), rich.TextColumn("{task.fields[state]}")
            columns = (named, rich.BarColumn(), state, rich.TimeRemainingColumn())
            self._bar = rich.Progress(*columns, console=self._console, transient=True)
            self._bar.add_task(self._waiting or self._text, total=None, state="")
            self._bar.start()
        return self._bar

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def __enter__(self) -> "Progress":
        if self._shown:
            self._open()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()


class Compiling(Progress):
    """A Progress of (done, n) kernels: shown at once where there is anything to compile, also in a plain file."""

    def __init__(self, console: Any = None):
        super().__init__("compiling", "kernels, once on a machine", console=console)
        self._next = 0.0

    def __enter__(self) -> "Compiling":
        return self  # nothing to show while nothing is compiled
