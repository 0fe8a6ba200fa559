"""JSBSim's properties in rows: read into and set from arrays in SI, by address where that was shown to be right.

Python's getters and setters cost half of a tick. The library of the jsbsim wheel exports what they call; only the node
behind a Python object is needed, the last word of the object. This rests on how one wheel was built. So a process of
its own compares both ways once for each wheel on each machine (`verify` of cosim/flight/plant/plant.py); what it found
is kept beside the compiled kernels. Without that, after one value that differs, and with COSIM_BORDER=python, Python's
calls are used. A process that died found nothing, and the next one tries again.
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
from typing import Any, NamedTuple

import numpy as np

from actuators.kernels import cache, python
from cosim.errors import CosimError
from cosim.files import replace_text

SYMBOLS = "_ZNK14SGPropertyNode14getDoubleValueEv", "_ZN14SGPropertyNode14setDoubleValueEd"
WORD = 8  # [byte]
NODE = 24, 32  # sizes that the object of a node may have: the head of every object, perhaps a reference, the node
SAME, DIFFERS = "same", "differs"  # verdicts
PATIENCE_S = 120.0
VERIFY = f"from cosim.flight.plant.plant import verify; print({(DIFFERS, SAME)}[verify()])"


class Properties:
    """Some properties of one aircraft; a number in SI is what the property has, times its unit."""

    def __init__(self, nodes: list, units: Any):
        """`nodes` are JSBSim's, `units` in SI."""
        self.nodes, self.units = nodes, np.array(units, float)

    def read(self, out: np.ndarray) -> None:
        """Read all into `out` (n,)."""
        out[:] = np.array([node.get_double_value() for node in self.nodes]) * self.units

    def write(self, values: np.ndarray) -> None:
        """Set all from `values` (n,)."""
        for node, value in zip(self.nodes, (values / self.units).tolist()):
            node.set_double_value(value)

    def schedule_read(self, tape: Any, out: np.ndarray) -> None:
        """Schedule on a tape to read all into `out` (n,)."""
        if by_address := fast_access():
            tape.get(self.addresses(), by_address.get, self.units, out)
        else:
            tape.call(lambda k: self.read(out))

    def schedule_write(self, tape: Any, values: np.ndarray) -> None:
        """Schedule on a tape to set all from `values` (n,)."""
        if by_address := fast_access():
            tape.put(self.addresses(), by_address.put, self.units, values)
        else:
            tape.call(lambda k: self.write(values))

    def addresses(self) -> np.ndarray:
        """Return the addresses of the nodes, which live as long as this object."""
        places = [id(node) + type(node).__basicsize__ - WORD for node in self.nodes]
        return np.array([ctypes.c_int64.from_address(place).value for place in places], np.int64)


class FastAccess(NamedTuple):
    """Addresses of the getter and the setter of a node."""

    get: int
    put: int


@functools.cache
def fast_access() -> FastAccess | None:
    """Return how to get at properties by address, None where Python's calls are used."""
    found = exported()
    file = _verdict_file() if found else None
    if file is None or os.environ.get("COSIM_BORDER") == "python":
        return None
    verdict = file.read_text("latin-1").strip() if file.is_file() else ""
    if verdict not in (SAME, DIFFERS) and (verdict := _verified()):
        with contextlib.suppress(CosimError):  # it is compared again where it cannot be written
            replace_text(file, f"{verdict}\n")
    return found if verdict == SAME else None


def exported() -> FastAccess | None:
    """Return what the library of the jsbsim wheel exports, None where it stands in no file or lacks a symbol."""
    library = _library()
    try:
        get, put = (ctypes.cast(getattr(ctypes.CDLL(library), name), ctypes.c_void_p).value for name in SYMBOLS)
    except (AttributeError, OSError):
        return None
    return FastAccess(get or 0, put or 0)


def _library():
    spec = importlib.util.find_spec("jsbsim._jsbsim")
    return str(spec.origin if spec else "")


def _verdict_file():
    """Return the file of the verdict about this wheel, None where nothing can be kept."""
    root, about = cache(), os.stat(_library())
    facts = _library(), about.st_size, about.st_mtime_ns, sys.version, platform.platform()
    return root and root / f"fast-properties-{hashlib.sha256(repr(facts).encode()).hexdigest()[:16]}"


def _verified(script=VERIFY):
    """Return the verdict of another process, "" when it does not come to an end of its own."""
    call = python(script, COSIM_BORDER="python")
    try:
        done = subprocess.run(**call, capture_output=True, text=True, timeout=PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired):
        return ""
    said = "".join(done.stdout.splitlines()[-1:])
    return said if done.returncode == 0 and said in (SAME, DIFFERS) else ""
