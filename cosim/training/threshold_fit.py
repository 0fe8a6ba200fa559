"""Fit of a threshold that scales with a measured quantity, at one false-alarm probability per flight.

Each flight gives blocks: the largest statistic y of a piece of time, and beside it the features x that the threshold
may grow with (1 for its constant part). The weights w >= 0 of the limit x w are a quantile regression (a linear
program); its scale follows from the largest y / (x w) of every flight: their upper fifth has an exponential tail.
"""

from typing import Any

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, hstack, identity

from cosim.errors import DesignError

PROBABILITY = 1e-3  # of a false alarm of a detector in a flight of 60 s: of the stored thresholds
LEVELS = (0.97, 0.99, 0.999, 0.9999)  # of the regression, to choose from
LEAST = 0.25
BLOCK_S = 1.0
HELD = 0.8  # of its confirmation time: a statistic that lasts so long counts as one that alarms
UPPER = 0.8  # from this quantile of the flights on the tail is exponential


def blocks(y: np.ndarray, features: list, valid: np.ndarray, dt: float, hold: float = 0.0) -> np.ndarray:
    """Return (blocks, 1 + features): of each second the largest y (ticks,) that lasted for `hold` [s], and the
    features (ticks,) or numbers there. Blocks without one are left out."""
    y = lasting(np.where(valid, y, 0.0), hold, dt)
    n = round(BLOCK_S / dt)
    at = np.arange(0, len(y) - n + 1, n)
    at = at + y[: len(at) * n].reshape(-1, n).argmax(axis=1)
    at = at[y[at] > 0.0]
    return np.stack([y[at], *(np.broadcast_to(f, len(y))[at] for f in features)], axis=1)


def lasting(y: np.ndarray, hold: float, dt: float) -> np.ndarray:
    """Return what y (..., ticks) does not fall below for `hold` [s] about each tick."""
    return minimum_filter1d(y, max(round(hold / dt), 1), axis=-1)


def quantile(y: np.ndarray, x: np.ndarray, level: float, least: float = LEAST) -> np.ndarray:
    """Return weights (features,) >= 0 so that y (n,) stays below x (n, features) @ weights in a share `level`.

    The first is at least `least` of the median of y: no threshold is nothing where all that it grows with is.
    """
    size, most = np.maximum(np.abs(x).max(axis=0), 1e-300), max(float(np.abs(y).max()), 1e-300)
    scaled, n = x / size, len(y)
    cost = np.concatenate([(1.0 - level) * scaled.sum(axis=0), np.ones(n)])
    found = linprog(cost, A_ub=hstack([csr_matrix(-scaled), -identity(n)]).tocsr(), b_ub=-y / most,
                    bounds=[(least * float(np.median(y)) * size[0] / most, None)] + [(0, None)] * (len(cost) - 1),
                    method="highs")  # fmt: skip
    return found.x[: x.shape[1]] * most / size


def exceeded(largest: np.ndarray, probability: float) -> float:
    """Return what the largest of a flight exceeds with `probability`; never less than the largest that was seen.

    `largest` (flights,): above the quantile UPPER of those that are not 0 they are taken to be exponential (peaks over
    a threshold).
    """
    if not largest.any():
        return 0.0
    u = float(np.quantile(largest[largest > 0.0], UPPER))
    over = largest[largest > u] - u
    if not len(over):
        return float(largest.max())
    return float(max(u + over.mean() * max(np.log(len(over) / len(largest) / probability), 0.0), largest.max()))


def limit(
    flights: list[np.ndarray], probability: float, place: str = "", least: float = LEAST, kinds: Any = None
) -> tuple[np.ndarray, dict]:
    """Return (weights (features,), how they were found) of the limit that a flight passes with `probability`.

    `flights` holds (blocks, 1 + features) for each flight, y first; flights without a block count as far below. Of
    LEVELS the one with the least geometric mean of the limit is taken: still air, where limits are small, counts as
    much as gusts. Of `kinds` (flights,) of flights each is held to the probability by itself: what few of all flights
    meet is in no tail of them all. Raises DesignError if no flight has a block.
    """
    rows = np.concatenate([f for f in flights if len(f)] or [np.zeros((0, 2))])
    if not len(rows):
        raise DesignError("no flight shows what this threshold is for", place=place, remedy="train with more flights")
    best: tuple = (np.inf, np.zeros(rows.shape[1] - 1), {})
    for level in LEVELS if rows.shape[1] > 2 else (1.0,):
        w = quantile(rows[:, 0], rows[:, 1:], level, least) if rows.shape[1] > 2 else np.ones(1)
        if not (rows[:, 1:] @ w > 0.0).all():
            continue
        ratio = np.array([(f[:, 0] / (f[:, 1:] @ w)).max() if len(f) else 0.0 for f in flights])
        groups = [ratio] if kinds is None else [ratio[np.asarray(kinds) == kind] for kind in dict.fromkeys(kinds)]
        scale = max(exceeded(group, probability) for group in groups)
        mean = float(np.log(np.maximum(rows[:, 1:] @ (w * scale), 1e-300)).mean())
        if mean < best[0]:
            found = {"level": level, "scale": scale, "largest": float(ratio.max() / scale) if scale else 0.0}
            best = (mean, w * scale, found)
    return best[1], best[2]
