"""The command line: `cosim` and its commands."""

import codecs
import contextlib
import os
import signal
import sys
import threading

# of addresses: with less the threads of linear algebra wait for ever while they are loaded
LEAST_BYTES, ENOUGH_BYTES = 480 << 20, 2 << 30
# what stands for a letter that the terminal's encoding does not have
_PLAIN = {"µ": "u", "–": "-", "—": "-", "…": "...", "×": "x", "·": "*", "≤": "<=", "≥": ">=", "±": "+-", "°": " deg",
          "“": '"', "”": '"', "‘": "'", "’": "'", "→": "->", "é": "e", "²": "2", "³": "3"}  # fmt: skip


def main() -> None:
    """Run the command line; Ctrl-C ends it with 130 at any moment, SIGTERM and SIGHUP like it."""
    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the last where a terminal goes away; under nohup it is ignored
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, _interrupt)
        _streams()
        _room()
        from cosim.cli.commands import main as run

        try:
            run()
        except SystemExit as end:
            _leave(end.code)
            raise
    except KeyboardInterrupt:
        sys.exit(130)
    except ImportError as error:
        if not any(word in str(error) for word in ("failed to map segment", "annot allocate memory")):
            raise
        print("error: this machine gives no more memory. Close other programs, or raise the limit (ulimit -v)",
              file=sys.stderr)  # fmt: skip
        sys.exit(2)
    except Exception as error:  # what Python makes of an interrupt inside an import's `__set_name__`
        if not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        sys.exit(130)


def _leave(status: object) -> None:
    """End the process where a thread of a user's detector would keep it, with a line."""
    guests = sys.modules.get("fdi.registry")
    left = [t.name for t in threading.enumerate() if not t.daemon and t is not threading.main_thread()]
    if not left or guests is None or not guests.GUESTS:
        return
    names = ", ".join(guests.GUESTS)
    said = f"ended with the thread {left[0]!r} running, which code of a user's has started"
    print(f"note: {said}: {names}", file=sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):
            stream.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


def _interrupt(*_: object) -> None:
    sys.unraisablehook = lambda _: None  # of what is half made at this moment its end may fail, too
    raise KeyboardInterrupt


def _room() -> None:
    """End with a line where the system allows too few addresses: threads of libraries would wait for ever."""
    try:
        import resource

        most, _ = resource.getrlimit(resource.RLIMIT_AS)
    except (ImportError, OSError):
        return
    if most != resource.RLIM_INFINITY and most < LEAST_BYTES:
        print(f"error: the limit of {most >> 20} MB for addresses is too low; allowed: from {LEAST_BYTES >> 20} MB on. "
              f"Raise it: ulimit -v {ENOUGH_BYTES >> 10}", file=sys.stderr)  # fmt: skip
        sys.exit(2)


def _streams() -> None:
    """Give a closed stream somewhere to go, and one of few letters plain ones in place of those it lacks."""
    codecs.register_error("plain", _plain)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="plain")


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lost = error.object[error.start : error.end]
    return "".join(_PLAIN.get(letter, "?") for letter in lost), error.end
