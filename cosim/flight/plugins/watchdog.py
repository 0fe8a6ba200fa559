"""Watchdog of a user's detectors, and of compiled user code that never returns after Ctrl-C.

The watchdog looks at the step under way ten times a second: one that takes longer than its limit is interrupted where
Python can be, and named where it does not come back. Of Ctrl-C
Python hears between two lines of its own, which never come. So while a flight has compiled guests, its
machine code runs with the interpreter unlocked, the system's own handler writes the signal to a pipe, and a thread that
waits there gives the flight two seconds to come back; then it closes the log and ends the process.
"""

import contextlib
import faulthandler
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

GRACE_S = 2.0  # for a flight to come back by itself
ENDING = (signal.SIGINT, signal.SIGTERM)
LOOK_S = 0.1  # from look to look of the watchdog
NAMED_S = 10.0  # a step that was to be interrupted, and is not back after so long, is named
HELD_S = 30.0  # so long may a step keep the interpreter to itself until a trace names its line


class Overdue(BaseException):
    """A step that takes longer than its limit: raised within it."""


def _tell(runner: Any, text: str) -> None:
    logging.getLogger("cosim").warning("%s; Ctrl-C ends the flight", text)


@contextlib.contextmanager
def watched(runners: Sequence[Any], *, lost: Callable[[Any, str], Any] = _tell, trace: Any = None) -> Iterator[None]:
    """Within it no step of the `runners` (cosim/flight/plugins/plain.py) stands unseen.

    One that takes longer than `runner.limit_s` is interrupted: Overdue is raised in it, in the main thread, which alone
    hears of signals. Of one that is not back NAMED_S later `lost(runner, text)` is told. One that keeps the interpreter
    for itself leaves a trace on `trace` (standard error) after HELD_S; with a `trace` the process then ends.
    """
    number: Any = getattr(signal, "SIGALRM", None)
    main = number is not None and threading.current_thread() is threading.main_thread()
    done, thread = threading.Event(), threading.get_ident()
    into: Any = trace or sys.__stderr__

    def interrupt(*_):
        if any(r.busy_s() > r.limit_s for r in runners):  # it may have come back since the signal was sent
            raise Overdue

    def arm():
        with contextlib.suppress(AttributeError, ValueError, OSError, RuntimeError):  # no file to write to
            faulthandler.dump_traceback_later(HELD_S, exit=trace is not None, file=into)

    def look():
        told: tuple = ()
        while not done.wait(LOOK_S):
            arm()
            late = next((r for r in runners if r.busy_s() > r.limit_s), None)
            if late and main:
                signal.pthread_kill(thread, number)
            if late and late.busy_s() > late.limit_s + NAMED_S and told != (late, late.steps):
                told = late, late.steps
                lost(late, f"{late.step} has not come back for {late.busy_s():.0f} s")

    before = signal.signal(number, interrupt) if main else None
    watcher = threading.Thread(target=look, name="watchdog", daemon=True)
    arm()
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()
        faulthandler.cancel_dump_traceback_later()
        if main:
            signal.signal(number, before)


@contextlib.contextmanager
def ended_by_force(close: Callable[[], str]) -> Iterator[None]:
    """Within it Ctrl-C ends the process with 130 even where it hangs in compiled code, after `close()`, whose text is
    told on standard error. Does nothing outside the main thread, which alone hears of signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    hear, tell = os.pipe()
    os.set_blocking(tell, False)
    back = threading.Event()

    def wait():
        while number := os.read(hear, 1):
            if number[0] in ENDING and not back.wait(GRACE_S):
                with contextlib.suppress(Exception):  # nothing may keep it from ending
                    print(close(), file=sys.stderr, flush=True)
                os._exit(130)

    thread = threading.Thread(target=wait, name="stuck", daemon=True)
    before = signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        back.set()
        signal.set_wakeup_fd(before)
        os.close(tell)
        thread.join()
        os.close(hear)
