"""Runs of a trace: ticks in which nothing that a lane says changes, so that memory is that of the changes."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK = 1 << 16  # ticks that are read at once


class Runs:
    """Columns of a trace by runs: run i holds the ticks at[i] <= k < at[i + 1], `runs[c]` are the values (runs,) of
    column c there."""

    def __init__(self, trace: Any, columns: Iterable[int], cuts: Iterable[int] = ()):
        """`trace` is (ticks, columns); a run begins at each of the `cuts`, too."""
        which = list(dict.fromkeys(columns))
        self.ticks = len(trace)
        at, values, last = [], [], None
        for a in range(0, self.ticks, BLOCK):
            part = trace[a : a + BLOCK]
            block = np.stack([part[:, c] for c in which])
            new = np.ones(block.shape[1], bool)
            new[1:] = (block[:, 1:] != block[:, :-1]).any(axis=0)
            if last is not None:
                new[0] = (block[:, 0] != last).any()
            new[[k - a for k in cuts if a <= k < a + len(new)]] = True
            at.append(a + np.flatnonzero(new))
            values.append(block[:, new])
            last = block[:, -1]
        self.at = np.concatenate([*at, [self.ticks]]).astype(np.int64)
        self._values = dict(zip(which, np.concatenate(values, axis=1) if values else np.zeros((len(which), 0))))

    def __getitem__(self, column: int) -> NDArray:
        return self._values[column]

    def __len__(self) -> int:
        return len(self.at) - 1

    def of(self, k: Any) -> Any:
        """Return the run of tick `k`, or of each of several."""
        return np.searchsorted(self.at[:-1], k, side="right") - 1

    def inside(self, first: int, stop: int) -> tuple[NDArray, NDArray, NDArray]:
        """Return (runs, first tick of each, tick after each) of the ticks first <= k < stop."""
        first, stop = max(0, first), min(stop, self.ticks)
        if first >= stop:
            return (np.zeros(0, np.int64),) * 3
        i = np.arange(self.of(first), self.of(stop - 1) + 1)
        return i, np.maximum(self.at[i], first), np.minimum(self.at[i + 1], stop)

    def count(self, mask: NDArray, first: int = 0, stop: int | None = None) -> int:
        """Return the number of ticks in [first, stop) of the runs in which `mask` (runs,) holds."""
        i, a, b = self.inside(first, self.ticks if stop is None else stop)
        return int((b - a)[mask[i]].sum())

    def onsets(self, mask: NDArray) -> NDArray[np.int64]:
        """Return the ticks at which `mask` (runs,) begins to hold."""
        return self.at[:-1][mask & ~np.concatenate([[False], mask[:-1]])]

    def ends(self, mask: NDArray) -> NDArray[np.int64]:
        """Return the ticks from which `mask` (runs,) no longer holds, the last one where it holds to the end."""
        return self.at[1:][mask & ~np.concatenate([mask[1:], [False]])]
