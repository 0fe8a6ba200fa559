"""What an alarm counts for: onset, detection, false alarm and the time in which there can be one, each defined once.

Arrays are over the ticks of one detector lane, `dt` [s] apart; a fault is a dict with `start_s` and `end_s` [s], the
latter inf for one that stays.
"""

import functools
import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

GRACE_S = 2.0  # an alarm that rises up to this after a fault has healed is still that fault's


def onsets(alarm: ArrayLike) -> NDArray[np.int64]:
    """Return the ticks at which `alarm` (ticks,), 0 or 1, rises; one that stands at the first tick rises there."""
    return np.flatnonzero(np.diff(np.asarray(alarm) > 0.5, prepend=False) & (np.asarray(alarm) > 0.5))


def detection(alarm: ArrayLike, first: int, end: int | None = None) -> int | None:
    """Return the first tick in [first, end) at which `alarm` rises, None without one. An alarm that stands since before
    `first` is no detection of what begins there."""
    rises = onsets(alarm)
    new = rises[(rises >= first) & (rises < (math.inf if end is None else end))]
    return int(new[0]) if len(new) else None


def faulty(faults: Iterable[Mapping], ticks: int, dt: float, t0: float = 0.0) -> NDArray[np.bool_]:
    """Return (ticks,): whether an alarm that rises then is that of a fault, GRACE_S after its end included. An onset
    where this is false is a false alarm. `t0` is the time of the first tick [s]."""
    out = np.zeros(ticks, bool)
    for first, end in (span(f, dt, t0) for f in faults):
        out[max(0, first) : max(0, ticks if end is None else end)] = True
    return out


def span(fault: Mapping, dt: float, t0: float = 0.0) -> tuple[int, int | None]:
    """Return the ticks (first, end), first <= k < end, of a fault, GRACE_S after its end included; None: all."""
    return _span(fault["start_s"], fault["end_s"], dt, t0)


@functools.lru_cache(maxsize=4096)  # each fault is asked for beside every other one
def _span(start_s, end_s, dt, t0):
    end = None if math.isinf(end_s) else math.ceil((end_s + GRACE_S - t0) / dt)
    return round((start_s - t0) / dt), end


def acts(fault: Mapping, ticks: int, dt: float) -> bool:
    """Return whether a fault is there in one of the `ticks` of a flight (cosim/flight/blocks/faults.py): it begins
    before the last one, and does not end before its own first one."""
    first = span(fault, dt)[0]
    return first < ticks and first < fault["end_s"] / dt - 0.5


def during(faults: Iterable[Mapping], ticks: ArrayLike, dt: float) -> NDArray[np.bool_]:
    """Return whether each of `ticks` (n,) is one of a fault, as `faulty` does for all of a flight."""
    spans = [(first, math.inf if end is None else end) for first, end in (span(f, dt) for f in faults)]
    begun, over = np.sort(np.array(spans, float).reshape(-1, 2), axis=0).T
    return np.searchsorted(begun, ticks, side="right") > np.searchsorted(over, ticks, side="right")
