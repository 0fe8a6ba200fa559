"""Columns of a long flight as a page draws them: a value or two for each interval, made while they are read."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

POINTS = 2000  # of a curve; two per interval
PEAKS = 600  # of a statistic; one per interval


class Thinned:
    """Columns (rows, columns) that come in blocks, of each interval of `step` rows what `reduce` leaves."""

    def __init__(self, step: int, reduce: Callable[[NDArray], NDArray]):
        self._step, self._reduce = step, reduce
        self._done: list[NDArray] = []
        self._left: Any = None  # rows of an interval that is not whole

    def add(self, rows: NDArray) -> "Thinned":
        """Take the next rows; return itself."""
        block = np.asarray(rows, float)
        block = block if self._left is None else np.concatenate([self._left, block])
        whole = len(block) // self._step * self._step
        self._done.append(self._reduced(block[:whole]))
        self._left = block[whole:]
        return self

    def values(self) -> NDArray:
        """Return (values, columns) of what came so far; the last interval may be shorter."""
        if self._left is None:
            return np.zeros((0, 1))
        rest = np.pad(self._left, ((0, -len(self._left) % self._step), (0, 0)), constant_values=np.nan)
        return np.concatenate([*self._done, self._reduced(rest)])

    def _reduced(self, rows):
        kept = self._reduce(rows.reshape(-1, self._step, rows.shape[1]))
        return kept.reshape(-1, rows.shape[1])


def envelope(rows: int, points: int = POINTS) -> tuple[Thinned, float]:
    """Return (Thinned, rows per value) of columns of so many rows: every row, or of many the smallest and the largest
    of each of points / 2 intervals, in order of time. An interval that holds only NaN gives NaN."""
    step = -(-2 * rows // points)
    whole = rows <= points or step < 3
    return (Thinned(1, lambda y: y), 1.0) if whole else (Thinned(step, _ends), step / 2.0)


def peaks(rows: int, points: int = PEAKS) -> tuple[Thinned, float]:
    """Return (Thinned, rows per value) of columns of so many rows: the largest value of each of `points` intervals."""
    step = max(1, -(-rows // points))
    return Thinned(step, lambda y: np.fmax.reduce(y, axis=1)[:, None]), float(step)


def _ends(y):
    gone = np.isnan(y)
    low, high = (np.argmin(np.where(gone, np.inf, sign * y), axis=1) for sign in (1.0, -1.0))
    at = np.stack([np.minimum(low, high), np.maximum(low, high)], axis=1)
    out = np.take_along_axis(y, at, axis=1)
    out[np.broadcast_to(gone.all(axis=1)[:, None], out.shape)] = np.nan
    return out
