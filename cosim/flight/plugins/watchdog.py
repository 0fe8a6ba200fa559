"""Watchdog for compiled user code that never returns after Ctrl-C: a thread closes the log and ends the process.

Python hears of Ctrl-C between two lines of its own, which never come. So while a flight has compiled guests, its
machine code runs with the interpreter unlocked, the system's own handler writes the signal to a pipe, and a thread that
waits there gives the flight two seconds to come back.
"""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator

GRACE_S = 2.0  # for a flight to come back by itself
ENDING = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def ended_by_force(close: Callable[[], str]) -> Iterator[None]:
    """Within it Ctrl-C ends the process with 130 even where it hangs in compiled code, after `close()`, whose text is
    told on standard error. Does nothing outside the main thread, which alone hears of signals.
    """
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
