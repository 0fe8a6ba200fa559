"""Arrays of a flight by column: in memory, or in a file where they are large, so that memory is that of the columns in
use."""

import mmap
import os
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGE = 1 << 20  # [byte] beyond which an array stands in a file


def column_store(ticks: int, columns: int, kind: Any = np.float32) -> NDArray:
    """Return zeros (ticks, columns) of `kind`, stored column by column; a large one in a file without a name (TMPDIR
    says where), which goes with the array. Raises OSError where the disk is full."""
    size = ticks * columns * np.dtype(kind).itemsize
    if size <= LARGE:
        return np.zeros((columns, ticks), kind).T
    with tempfile.TemporaryFile() as file:
        os.posix_fallocate(file.fileno(), 0, size)  # a full disk is an error here, and would be a signal later
        return np.frombuffer(mmap.mmap(file.fileno(), size), kind).reshape(columns, ticks).T


def release(array: Any) -> None:
    """Give back the memory of what was read or written of a stored array; its file keeps it."""
    while isinstance(array, np.ndarray):
        array = array.base
    array = getattr(array, "obj", array)  # of the memoryview that NumPy makes of a map
    if isinstance(array, mmap.mmap):
        array.madvise(mmap.MADV_DONTNEED)
