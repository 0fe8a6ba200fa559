"""Bring the channels of a recording to the ticks of the detectors."""

from typing import Any

import numpy as np

SNAP = 1e-3  # of a tick: a sample that near to a tick lies on it, so that rounded times lose nothing


def ticks(spans: Any, dt: float, start: float | None = None) -> tuple[Any, ...]:
    """Return (t_0, n): the n ticks t_0 + k dt that all `spans` [(first, last)] [s] cover, from `start` on."""
    t_0, end = max(a for a, _ in spans), min(b for _, b in spans)
    if start is not None and start > t_0:
        t_0 += dt * np.ceil((start - t_0) / dt - SNAP)
    return t_0, max(0, int(np.floor((end - t_0) / dt + SNAP)) + 1)


def resample(t: np.ndarray, y: np.ndarray, t_0: Any, dt: float, n: Any, *, linear: bool, max_gap: Any = None) -> Any:
    """Return (values, valid) (n,) of samples `y` at ascending times `t` [s] on the ticks t_0 + k dt.

    A sample within SNAP of a tick is taken as it is. Elsewhere the value is interpolated between its neighbours
    (`linear`) or the last one is held. It is valid (1.0) where the samples used are finite and their distance, or for
    a held one its age, is at most `max_gap` [s] (default: three median intervals); elsewhere the value is NaN and the
    flag 0.0.
    """
    at = t_0 + np.arange(n) * dt
    near = SNAP * dt
    last = np.searchsorted(t, at + near, side="right") - 1  # newest sample not after the tick
    following = np.minimum(last + 1, len(t) - 1)
    held = np.maximum(last, 0)
    exact = (last >= 0) & (np.abs(t[held] - at) <= near)
    if max_gap is None:
        max_gap = 3.0 * float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if linear:
        width = t[following] - t[held]
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(width > 0.0, (at - t[held]) / width, 0.0)
            values = y[held] + share * (y[following] - y[held])
        good = (last >= 0) & (last + 1 < len(t)) & (width <= max_gap + near)
    else:
        values = y[held]
        good = (last >= 0) & (at - t[held] <= max_gap + near)
    values = np.where(exact, y[held], values)
    good = (exact | good) & np.isfinite(values)
    return np.where(good, values, np.nan), good.astype(float)
