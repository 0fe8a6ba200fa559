"""The command line: `cosim` and its commands."""

import signal
import sys


def main() -> None:
    """Run the command line; Ctrl-C, SIGTERM and SIGHUP end it with 130, whatever it is at."""
    try:
        for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            if signal.getsignal(number) != signal.SIG_IGN:  # under nohup a terminal that goes away is ignored
                signal.signal(number, _interrupt)
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
        from cosim.cli.commands import main as run

        run()
    except KeyboardInterrupt:
        _interrupted()
        sys.exit(130)
    except SystemExit as end:
        if end.code == 130:
            _interrupted()
        raise


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def _interrupted() -> None:
    """Remove what an interrupt has left half written; name the part of a log that stays."""
    from cosim.files import interrupted

    for part in interrupted():
        print(f"{part} holds what was flown: `cosim recover {part}` makes a readable log of it", file=sys.stderr)
