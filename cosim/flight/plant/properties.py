"""JSBSim's properties in rows: read into and set from arrays in SI, by address where that was shown to be right.

Python's getters and setters cost half of a tick. The library of the jsbsim wheel exports what they call; only the node
behind a Python object is needed, the last word of the object. This rests on how one wheel was built. So a process of
its own compares both ways once for each wheel and version of ours (`verify` of cosim/flight/plant/plant.py); what it
found is kept beside the compiled kernels. Without that, after one value that differs, and with COSIM_BORDER=python,
Python's calls are used. A process that died found nothing, and the next one tries again.
"""

import ctypes
import functools
import importlib.util
import os
import platform
import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np

from actuators.kernels import cache, cached_array, python

SYMBOLS = "_ZNK14SGPropertyNode14getDoubleValueEv", "_ZN14SGPropertyNode14setDoubleValueEd"
WORD = 8  # [byte]
NODE = 24, 32  # sizes that the object of a node may have: the head of every object, perhaps a reference, the node
PATIENCE_S = 120.0
VERIFY = "from cosim.flight.plant.plant import verify; print(int(verify()))"


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
    found, library = exported(), _library()
    if found is None or cache() is None or os.environ.get("COSIM_BORDER") == "python":
        return None
    about = os.stat(library)
    facts = library, about.st_size, about.st_mtime_ns, sys.version, platform.platform()
    try:
        return found if cached_array(facts, float, _verified, __file__).all() else None
    except (OSError, ValueError, subprocess.SubprocessError):
        return None


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


def _verified(script=VERIFY):
    """Return (1,), what another process finds: 1 where all bits are the same. Raises an error where it does not come to
    an end of its own: it may have been killed, and the next one tries again."""
    call = python(script, COSIM_BORDER="python")
    said = subprocess.run(**call, capture_output=True, text=True, timeout=PATIENCE_S, check=True).stdout
    return np.array([float(said.strip().rpartition("\n")[2])])
