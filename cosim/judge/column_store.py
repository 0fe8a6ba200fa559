"""Column store: rows of a flight of any length, kept on disk beyond some memory and read back column by column."""

import os
import tempfile
import threading
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

MEMORY = 24 << 20  # [byte] that all stores of a process hold before they go to disk
SPAN = 4000  # rows that are appended at once, where the caller may choose
_held = 0
_lock = threading.RLock()  # a block may go, and be counted off, while another is counted


class Columns:
    """An array (rows, columns) whose columns are fetched when they are asked for: `a[:, c]`, `a[i:j, c]`, `a[i:j]`.

    `fetch(c, i, j)` returns the rows i <= k < j of column `c`. A list of columns gives an array (rows, columns), a
    slice alone a view.
    """

    def __init__(self, fetch: Callable[[int, int, int], NDArray], stop: int, start: int = 0):
        self._fetch, self._start, self._stop = fetch, start, max(start, stop)

    def __len__(self) -> int:
        return self._stop - self._start

    def __getitem__(self, key: Any) -> Any:
        rows, columns = key if isinstance(key, tuple) else (key, None)
        if columns is None:
            start, stop, step = rows.indices(len(self))
            assert step == 1
            return Columns(self._fetch, self._start + stop, self._start + start)
        if not isinstance(columns, int | np.integer):
            return np.stack([self[rows, int(c)] for c in columns], axis=1)
        if isinstance(rows, slice):
            start, stop, step = rows.indices(len(self))
            return self._fetch(int(columns), self._start + start, self._start + max(start, stop))[::step]
        return self._fetch(int(columns), self._start, self._stop)[rows]


class ColumnStore(Columns):
    """Columns to which rows are appended; those of a process hold MEMORY together, what is more stands on disk. The
    file has no name (TMPDIR says where): it goes with the process, whatever ends it."""

    def __init__(self, kind: Any = np.float32):
        self._start = self._stop = 0
        self._kind = np.dtype(kind)
        self._file: Any = None
        # first row, rows, array (columns, rows) or file, place in the file
        self._blocks: list[tuple[int, int, Any, int]] = []

    def append(self, rows: NDArray) -> None:
        """Take rows (n, columns); they are copied."""
        global _held
        if not len(rows):
            return
        block = np.array(rows.T, self._kind, order="C")
        with _lock:
            fits = _held + block.nbytes <= MEMORY
            if fits:
                _held += block.nbytes
                weakref.finalize(block, _let_go, block.nbytes).atexit = False  # a branch may outlive this store
        self._blocks.append((self._stop, len(rows), *((block, 0) if fits else self._written(block))))
        self._stop += len(rows)

    def _written(self, block):
        if self._file is None:
            self._file = tempfile.TemporaryFile(buffering=0)
        at = self._file.seek(0, os.SEEK_END)
        view = memoryview(block).cast("B")
        while view:
            view = view[self._file.write(view) :]
        return self._file, at

    def branch(self) -> "ColumnStore":
        """Return a store with the rows so far, which are not copied; either may be continued."""
        out = ColumnStore(self._kind)
        out._blocks, out._stop = list(self._blocks), self._stop
        return out

    def _fetch(self, column, start, stop):  # no attribute: a reference to itself would outlive the store
        inside = [b for b in self._blocks if b[0] < stop and b[0] + b[1] > start]
        if len(inside) == 1 and not hasattr(inside[0][2], "fileno"):
            first, _, block, _ = inside[0]
            return block[column, start - first : stop - first]
        out = np.empty(stop - start, self._kind)
        for first, n, held, at in inside:
            low, high = max(start, first), min(stop, first + n)
            into = out[low - start : high - start]
            if hasattr(held, "fileno"):
                place = at + (column * n + low - first) * self._kind.itemsize
                into[:] = np.frombuffer(os.pread(held.fileno(), into.nbytes, place), self._kind)
            else:
                into[:] = held[column, low - first : high - first]
        return out


def _let_go(size):
    global _held
    with _lock:
        _held -= size
