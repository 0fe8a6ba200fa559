"""Access to JSBSim's properties by the addresses of their nodes, where a comparison has shown that this is right.

Python's getters and setters cost half of a tick. The library of the jsbsim wheel exports what they call; only the node
behind a Python object is needed, and that stands where its layout in memory says. This rests on how one wheel was
built. So a process of its own compares them once for each wheel on each machine (`verify_fast_properties.py`); what it
found is kept beside the compiled kernels. Without that, after one value that differs, and with COSIM_BORDER=python,
Python's calls are used. A process that died found nothing, and the next one tries again.
"""

import contextlib
import ctypes
import functools
import hashlib
import importlib.util
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from actuators import subprocess_env
from actuators.kernels import cache
from cosim.errors import CosimError
from cosim.files import replace_text

SYMBOLS = "_ZNK14SGPropertyNode14getDoubleValueEv", "_ZN14SGPropertyNode14setDoubleValueEd"
HEAD = 16  # of every Python object [byte]
OFFSETS = HEAD, HEAD + 8  # at which the node's address may stand
DIFFERS = "differs"  # the verdict that no offset is right; else it is the offset
PATIENCE_S = 120.0
VERIFY = "from cosim.flight.plant.verify_fast_properties import verify; print(verify())"


class FastAccess(NamedTuple):
    """Addresses of the getter and the setter of a node, and where in its Python object the node's address stands."""

    get: int
    put: int
    offset: int

    def nodes(self, objects: list) -> np.ndarray:
        """Return the addresses of the nodes behind Python objects, which must live on."""
        return np.array([ctypes.c_int64.from_address(id(o) + self.offset).value for o in objects], np.int64)


@functools.cache
def fast_access() -> FastAccess | None:
    """Return how to get at properties by address, None where Python's calls are used."""
    file, library = _verdict_file(), jsbsim_library()
    if file is None or library is None or os.environ.get("COSIM_BORDER") == "python":
        return None
    verdict = ""
    with contextlib.suppress(OSError, ValueError):
        verdict = file.read_text("ascii").strip()
    if verdict not in (DIFFERS, *map(str, OFFSETS)):
        verdict = _verified()
        if not verdict:
            return None
        with contextlib.suppress(CosimError):  # it is tried again where it cannot be written
            replace_text(file, f"{verdict}\n")
    return None if verdict == DIFFERS else access(library, int(verdict))


def jsbsim_library() -> Path | None:
    """Return the file of JSBSim's compiled library, None where it stands in no file."""
    spec = importlib.util.find_spec("jsbsim._jsbsim")
    return Path(spec.origin) if spec and spec.origin and Path(spec.origin).is_file() else None


def _verdict_file():
    """Return the file of the verdict about this wheel, None where nothing can be kept."""
    root, library = cache(), jsbsim_library()
    if root is None or library is None:
        return None
    about = library.stat()
    facts = str(library), about.st_size, about.st_mtime_ns, sys.version, platform.platform()
    return root / f"fast-properties-{hashlib.sha256(repr(facts).encode()).hexdigest()[:16]}"


def _verified(script=VERIFY):
    """Return the verdict of another process, "" when it does not come to an end of its own."""
    env = subprocess_env.surroundings(COSIM_BORDER="python")
    how: Any = {"env": env, "capture_output": True, "text": True, "timeout": PATIENCE_S}
    try:
        done = subprocess.run(subprocess_env.command(script), **how)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    said = "".join(done.stdout.splitlines()[-1:])
    return said if done.returncode == 0 and said in (DIFFERS, *map(str, OFFSETS)) else ""


def access(library: Path, offset: int) -> FastAccess | None:
    """Return the FastAccess of a library that is loaded, None when it lacks a symbol."""
    held = ctypes.CDLL(str(library))
    try:
        get, put = (ctypes.cast(getattr(held, name), ctypes.c_void_p).value for name in SYMBOLS)
    except AttributeError:
        return None
    return FastAccess(get or 0, put or 0, offset)
