"""The time in which an alarm is that of a fault, defined once.

Ticks are `dt` [s] apart; a fault is a dict with `start_s` and `end_s` [s], the latter inf for one that stays.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

GRACE_S = 2.0  # an alarm that rises up to this after a fault has healed is still that fault's


def span(fault: Mapping, dt: float, t0: float = 0.0) -> tuple[int, int | None]:
    """Return the ticks (first, end), first <= k < end, of a fault, GRACE_S after its end included; None: all."""
    end = None if math.isinf(fault["end_s"]) else math.ceil((fault["end_s"] + GRACE_S - t0) / dt)
    return round((fault["start_s"] - t0) / dt), end


def acts(fault: Mapping, ticks: int, dt: float) -> bool:
    """Return whether a fault is there in one of the `ticks` of a flight (cosim/flight/blocks/faults.py): it begins
    before the last one, and does not end before its own first one."""
    first = span(fault, dt)[0]
    return first < ticks and first < fault["end_s"] / dt - 0.5


def during(faults: Iterable[Mapping], ticks: ArrayLike, dt: float, t0: float = 0.0) -> NDArray[np.bool_]:
    """Return (n,): whether an alarm that rises at each of `ticks` (n,) is that of a fault, GRACE_S after its end
    included. An alarm that rises where this is false is a false one. `t0` is the time of the first tick [s]."""
    spans = [(first, math.inf if end is None else end) for first, end in (span(f, dt, t0) for f in faults)]
    begun, over = np.sort(np.array(spans, float).reshape(-1, 2), axis=0).T
    return np.searchsorted(begun, ticks, side="right") > np.searchsorted(over, ticks, side="right")
