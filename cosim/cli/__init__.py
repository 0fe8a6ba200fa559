"""The command line: `cosim` and its commands."""

import os
import signal
import sys


def main() -> None:
    """Run the command line; Ctrl-C, SIGTERM and SIGHUP end it with 130, whatever it is at."""
    try:
        for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
            if signal.getsignal(number) != signal.SIG_IGN:  # under nohup a terminal that goes away is ignored
                signal.signal(number, _interrupt)
        for name in ("stdout", "stderr"):
            if getattr(sys, name) is None:  # closed by who called
                setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
            getattr(sys, name).reconfigure(errors="replace")
        from cosim.cli.commands import app

        app(prog_name="cosim")
    except KeyboardInterrupt:
        sys.exit(130)


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
