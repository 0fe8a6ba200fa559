"""Access to JSBSim's properties by the addresses of their nodes, where a trial has shown that this is right.

Python's getters and setters cost half of a tick. The library of the jsbsim wheel exports what they call; only the node
behind a Python object is needed, and that stands where its layout in memory says. This rests on how one wheel was
built. So a process of its own tries it once for each wheel on each machine: it flies an aircraft twice, by Python's
calls and by address, and compares every value. What it found is remembered beside the compiled kernels. Without that,
after one value that differs, and with COSIM_BORDER=python, Python crosses. A trial that died found nothing, it may have
been killed or had no memory: Python crosses, and the next process tries again.
"""

import contextlib
import ctypes
import functools
import hashlib
import importlib.util
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from actuators import subprocess_env
from actuators.object_cache import PLAIN
from actuators.source_hash import cache_root
from cosim.errors import CosimError
from cosim.files import replace_text
from cosim.texts import from_json

SYMBOLS = "_ZNK14SGPropertyNode14getDoubleValueEv", "_ZN14SGPropertyNode14setDoubleValueEd"
HEAD = 16  # of every Python object [byte]
OFFSETS = HEAD, HEAD + 8  # of the node's address that a trial may find
PATIENCE_S = 120.0  # of the trial


class Crossing(NamedTuple):
    """Addresses of the getter and the setter of a node, and where in its Python object the node's address stands."""

    get: int
    put: int
    offset: int

    def nodes(self, objects: list) -> np.ndarray:
        """Return the addresses of the nodes behind Python objects, which must live on."""
        return np.array([ctypes.c_int64.from_address(id(o) + self.offset).value for o in objects], np.int64)


@functools.cache
def crossing() -> Crossing | None:
    """Return how to cross by address, None where Python crosses."""
    if PLAIN or os.environ.get("COSIM_BORDER") == "python":
        return None
    file, library = _memory(), jsbsim_library()
    if file is None or library is None:
        return None
    verdict = None
    with contextlib.suppress(OSError):
        verdict = _verdict(file.read_bytes())
    if verdict is None:
        verdict = _tried()
        if verdict is None:
            return None
        with contextlib.suppress(OSError, CosimError):  # it is tried again where it cannot be written
            replace_text(file, json.dumps(verdict) + "\n")
    return found(library, int(verdict["offset"])) if verdict["equal"] else None


def _verdict(text):
    """Return the verdict that JSON `text` is, None for anything else: an address from elsewhere ends the process."""
    try:
        told = from_json(text, place="trial")
    except CosimError:
        return None
    if not isinstance(told, dict) or not isinstance(told.get("equal"), bool):
        return None
    return told if not told["equal"] or told.get("offset") in OFFSETS else None


def jsbsim_library() -> Path | None:
    """Return the file of JSBSim's compiled library, None where it stands in no file."""
    spec = importlib.util.find_spec("jsbsim._jsbsim")
    return Path(spec.origin) if spec and spec.origin and Path(spec.origin).is_file() else None


def _memory():
    """Return the file of the verdict about this wheel, None where nothing can be remembered."""
    root, library = cache_root(), jsbsim_library()
    if root is None or library is None:
        return None
    about = library.stat()
    facts = "with gusts", str(library), about.st_size, about.st_mtime_ns, sys.version, platform.platform()
    return root / f"border-{hashlib.sha256(repr(facts).encode()).hexdigest()[:16]}.json"


TRIAL = "from cosim.flight.plant.pointer_trial import trial; trial()"


def _tried(script=TRIAL):
    """Return what a trial in another process finds, None when it does not come to an end of its own."""
    env = subprocess_env.surroundings(COSIM_BORDER="python")
    try:
        done = subprocess.run(
            subprocess_env.command(script), env=env, capture_output=True, text=True, timeout=PATIENCE_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return _verdict("".join(done.stdout.splitlines()[-1:])) if done.returncode == 0 else None


def found(library: Path, offset: int) -> Crossing | None:
    """Return the Crossing of a library that is loaded, None when it lacks a symbol."""
    held = ctypes.CDLL(str(library))
    try:
        get, put = (ctypes.cast(getattr(held, name), ctypes.c_void_p).value for name in SYMBOLS)
    except AttributeError:
        return None
    return Crossing(get or 0, put or 0, offset)
