"""Command and environment of a Python subprocess: no library is imported from the current folder."""

import os
import sys
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


def command(code: str) -> list[str]:
    """Return the command line that runs `code`; -P keeps the current folder from the path."""
    return [sys.executable, "-P", "-c", code]


def surroundings(**more: str) -> dict[str, str]:
    """Return the environment of such a process, with `more`: our packages are found wherever this one found them."""
    paths = (str(_ROOT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **more}
