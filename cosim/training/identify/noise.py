"""White noise of a channel, by differences of rising order: motion cancels, white noise grows by a known factor.

The k-th difference of white noise of variance s^2 has the variance C(2k, k) s^2; that of a smooth motion falls with k.
The first order whose estimate agrees with the next one's is taken. The variance is the median over WINDOWS, so that
manoeuvres do not count; its interval is that of a median (order statistics), without a law of distribution.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import binom

WINDOW = 64  # samples
ORDERS = 6
AGREE = 0.1  # two orders agree when their standard deviations differ by less than this share


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a channel's white noise per sample [SI] with its interval; `note` qualifies it."""

    sigma: float
    low: float
    high: float
    resolution: float  # smallest step between two samples [SI]
    note: str = ""


def white(y: np.ndarray, level: float = 0.95) -> Noise | None:
    """Return the Noise of samples y (n,), NaN where there is a gap; None for a constant channel or a short one."""
    steps = np.abs(np.diff(y))
    moved = steps[np.isfinite(steps) & (steps > 0.0)]
    if not len(moved):
        return None
    resolution = float(moved.min())
    found = [_median(y, k, level) for k in range(1, ORDERS + 1)]
    found = [f for f in found if f is not None]
    if len(found) < 2:
        return None
    for now, following in pairwise(found):
        if abs(following[0] - now[0]) < AGREE * now[0]:
            sigma, low, high = now
            coarse = sigma < 0.5 * resolution
            note = f"of the order of its resolution, {resolution:.3g}" if coarse else ""
            return Noise(sigma, low, high, resolution, note)
    sigma, _, high = found[-1]
    return Noise(sigma, 0.0, high, resolution, "at most: its differences are not white at any order")


def _median(y, k, level):
    """Return (sigma, low, high) by differences of order k, None without six whole windows."""
    d = np.diff(y, k) if k else y
    n = len(d) // WINDOW
    mean = np.mean(d[: n * WINDOW].reshape(n, WINDOW) ** 2, axis=1) if n else np.empty(0)
    mean = np.sort(mean[np.isfinite(mean)])
    if len(mean) < 6:
        return None
    weights = np.poly1d([1.0, -1.0]) ** k
    rho = np.correlate(weights.c, weights.c, "full")[k:]
    dof = WINDOW / (1.0 + 2.0 * np.sum((rho[1:] / rho[0]) ** 2))
    scale = rho[0] * (1.0 - 2.0 / (9.0 * dof)) ** 3  # median of chi square over its mean (Wilson, Hilferty)
    below = int(binom.ppf(0.5 * (1.0 - level), len(mean), 0.5))
    spread = max(below - 1, 0), min(len(mean) - below, len(mean) - 1)
    return tuple(float(np.sqrt(v / scale)) for v in (np.median(mean), mean[spread[0]], mean[spread[1]]))
