"""Effect of a fault on its elevator: the difference of a flight and its reference without the fault.

    peak        largest |d| while a fault on the segment is active and 1 s afterwards
    amplitude   of an oscillation: of the least-squares sine at the fault's frequency over the settled whole periods
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actuators.common.linkage import ARM
from actuators.constants import DEG_PER_RAD
from cosim.judge.runs import BLOCK

SETTLE_PERIODS = 2.0
MOST = 1 << 18  # ticks of a fit: it takes 150 bytes of memory each
MOVED = 1e-3  # of rod from where it would be, from when on a fault can be seen at all [m]
NAMES = ("rod_mm", "surface_deg", "travel_pct", "amplitude_mm", "amplitude_deg")


def sine(t: NDArray, y: NDArray, w: float) -> complex:
    """Return the complex amplitude c of Re(c exp(i w t)) in y (n,) at times t (n,) [s], by least squares. A constant
    and a slope are fitted beside the sine of `w` [rad/s], so that a slow change of y does not count."""
    basis = np.stack([np.cos(w * t), np.sin(w * t), np.ones_like(t), t - t[0]], 1)
    c = np.linalg.lstsq(basis, y, rcond=None)[0]
    return c[0] - 1j * c[1]


def amplitude(d: Any, column: int, w: float, start: float, end: float, dt: float) -> float | None:
    """Return the amplitude of the sine of `w` [rad/s] in a column of d (ticks, columns), in its unit; None when no
    whole period is left. Taken over the last whole periods, MOST ticks of them, of [start + SETTLE_PERIODS periods,
    end] [s]."""
    period = 2 * math.pi / w
    first = round((start + SETTLE_PERIODS * period) / dt)
    longest = math.floor(MOST * dt / period) or 1
    last = min(len(d), round(min(end, len(d) * dt) / dt))
    whole = min(longest, math.floor((last - first) * dt / period + 1e-9))
    if whole < 1:
        return None
    cut = d[last - round(whole * period / dt) : last, column]
    return float(abs(sine(np.arange(len(cut)) * dt, cut, w))) if np.isfinite(cut).all() else None


def _blocks(d: Any, column: int, first: int, stop: int) -> Iterator[NDArray]:
    """Yield the rows first <= k < stop of a column of (ticks, columns), of which a part is fetched at a time."""
    return (d[a : min(a + BLOCK, stop), column] for a in range(first, stop, BLOCK))


def moved(difference: Any, faults: Sequence, dt: float, travel: float) -> dict[str, float | None]:
    """Return {name of NAMES: value or None} of one segment, and `moved_at_s`, when it was first MOVED of rod away [s].

    `difference` (ticks, 2), an array or Columns, is rod [m], NaN where there is none, and surface [rad], each less
    its twin's; `faults` are the injections on the segment (cosim/flight/faults/inject.py), `travel` is the elevator's
    [rad].
    """
    start = min(j.start for j in faults)
    end = max(j.end for j in faults) + 1.0
    last = len(difference) if math.isinf(end) else min(len(difference), round(end / dt))
    first = round(start / dt)
    rod, surface = (_largest(_blocks(difference, c, first, last)) for c in (0, 1))
    s = next((j for j in faults if math.isfinite(j.omega) and j.shape != "chirp"), None)
    swing = [amplitude(difference, c, s.omega, s.start + s.ramp, s.end, dt) if s else None for c in (0, 1)]
    deg = DEG_PER_RAD
    values = (rod, surface, surface, *swing)
    sizes = {n: None if v is None else v * k for n, v, k in zip(NAMES, values, (1e3, deg, 100 / travel, 1e3, deg))}
    return sizes | {"moved_at_s": _moved_at(difference, first, dt)}


def _moved_at(difference, first, dt):
    """Return the first time from tick `first` on at which the rod, or the surface's share of it, is MOVED away, or
    None."""
    n = len(difference)
    known = all(np.isfinite(block).all() for block in _blocks(difference, 0, 0, n))
    for block in _blocks(difference, 0 if known else 1, first, n):
        away = np.flatnonzero(np.abs(block if known else ARM * block) >= MOVED)
        if len(away):
            return float((first + away[0]) * dt)
        first += len(block)
    return None


def largest(segments: dict[str, dict] | None) -> dict[str, float | None]:
    """Return {name of NAMES: largest over the segments of `moved`}, None where no segment has a value."""
    given = {name: [s[name] for s in (segments or {}).values() if s[name] is not None] for name in NAMES}
    return {name: max(values, default=None) for name, values in given.items()}


def _largest(blocks):
    """Return the largest magnitude, None where there is none or one is not finite."""
    peaks = [float(np.max(np.abs(d))) if np.isfinite(d).all() else math.inf for d in blocks]
    return max(peaks) if peaks and math.isfinite(max(peaks)) else None
