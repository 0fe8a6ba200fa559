"""CRC-32 of large blocks: zlib's number, several times as fast where the processor multiplies without carries."""

import functools
import zlib
from typing import Any

import numpy as np

from actuators.object_cache import PLAIN, of_wholes

BLOCK = 256  # [byte] in which the compiled function counts, and how many it leaves
LEAST = 1 << 15  # [byte]; what is smaller zlib has done before the call is made
_ALL = 0xFFFFFFFF
FOLD = of_wholes("cosim.log.crc_kernel", "fold", 4, f"{__name__}:FOLD")


@functools.cache
def foldable() -> bool:
    """Tell whether this processor multiplies without carries, and functions are compiled."""
    import llvmlite.binding as llvm

    return not PLAIN and bool(llvm.get_host_cpu_features().get("pclmul"))


def crc32(data: Any, value: int = 0) -> int:
    """Return the CRC-32 of bytes that follow others of CRC-32 `value`, as zlib.crc32; where the fast function is not
    compiled yet zlib does it, for nobody should wait for that."""
    if len(data) < LEAST or not foldable() or not FOLD.ready():
        return zlib.crc32(data, value)
    held, left = np.frombuffer(data, "u1"), np.zeros(BLOCK, "u1")
    blocks = len(held) // BLOCK
    FOLD.free(held.ctypes.data, blocks, left.ctypes.data, value ^ _ALL)
    # what is left stands for all before it, register included: it begins with a register of zeros
    return zlib.crc32(held[blocks * BLOCK :].data, zlib.crc32(left.data, _ALL))
