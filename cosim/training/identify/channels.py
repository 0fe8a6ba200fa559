"""White noise of a channel, and by how much it lags another that physics ties to it.

Noise by differences of rising order: the k-th difference of white noise of variance s^2 has the variance C(2k, k) s^2;
that of a smooth motion falls with k. The first order whose estimate agrees with the next one's is taken. The variance
is the median over WINDOWS, so that manoeuvres do not count; its interval is that of a median (order statistics),
without a law of distribution.

Delay by the slope of the phase of a cross spectrum:

    Y / X = g (j w)^n e^(-j w tau),    arg S_xy(w) - n pi/2 = -w tau

n is -1 for an angle beside its rate, 1 for a rate beside its angle, 0 for two readings of one thing. The phase of a
frequency has the variance (1 - c) / (2 m c), c the coherence, m the number of independent segments (Bendat and Piersol,
Random Data, 9.2); the slope is their weighted least squares, its interval widened where the phases scatter by more.
"""

import math
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import signal
from scipy.stats import binom
from scipy.stats import t as student

from cosim.replay import clock
from cosim.replay.map import Prepared
from cosim.replay.map_signals import sampled, shares

WINDOW = 64  # samples of noise
ORDERS = 6
AGREE = 0.1  # two orders agree when their standard deviations differ by less than this share
PAIRS = (  # (channel, other channel, n)
    ("theta", "q", -1), ("phi", "p", -1), ("psi", "r", -1), ("h_baro", "hdot", -1), ("h_inertial", "hdot", -1),
    ("qdot", "q", 1), ("pdot", "p", 1), ("rdot", "r", 1), ("cas", "tas", 0), ("mach", "tas", 0),
    ("h_baro", "h_inertial", 0), ("alpha", "alpha_ground", 0), ("tas", "v_ground", 0),
)  # fmt: skip
LEAST = 0.6  # coherence of a frequency that counts
SEGMENTS = 8  # of the recording at least
SEGMENT_S = 20.0  # at most: the slowest motion that counts takes some five of these
FEWEST = 4  # frequencies


@dataclass(frozen=True)
class Noise:
    """Standard deviation of a channel's white noise per sample [SI] with its interval; `note` qualifies it."""

    sigma: float
    low: float
    high: float
    resolution: float  # smallest step between two samples [SI]
    note: str = ""


@dataclass(frozen=True)
class Delay:
    """Lag behind `of` [s], + later, with its interval; `note` says why there is none."""

    of: str
    tau: float = np.nan
    low: float = np.nan
    high: float = np.nan
    coherence: float = np.nan
    note: str = ""


def white(y: np.ndarray, level: float = 0.95) -> Noise | None:
    """Return the Noise of samples y (n,), NaN where there is a gap; None for a constant channel or a short one."""
    steps = np.abs(np.diff(y))
    moved = steps[np.isfinite(steps) & (steps > 0.0)]
    found = [f for k in range(1, ORDERS + 1) if (f := _median(y, k, level)) is not None]
    if not len(moved) or len(found) < 2:
        return None
    resolution = float(moved.min())
    for (sigma, low, high), following in pairwise(found):
        if abs(following[0] - sigma) < AGREE * sigma:
            note = f"of the order of its resolution, {resolution:.3g}" if sigma < 0.5 * resolution else ""
            return Noise(sigma, low, high, resolution, note)
    sigma, _, high = found[-1]
    return Noise(sigma, 0.0, high, resolution, "at most: its differences are not white at any order")


def _median(y, k, level):
    """Return (sigma, low, high) by differences of order k, None without six whole windows."""
    d = np.diff(y, k)
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


def lag(y: np.ndarray, x: np.ndarray, n: int, dt: float, of: str, level: float = 0.95) -> Delay:
    """Return the Delay of samples y behind x (both (samples,), finite, every `dt` seconds) with Y/X = g (j w)^n."""
    size = int(min(SEGMENT_S / dt, len(y) * 2 // (SEGMENTS + 1)))
    if size < 16:
        return Delay(of, note=f"{len(y) * dt:.3g} s are too short")
    how = {"fs": 1.0 / dt, "nperseg": size, "detrend": "linear"}
    f, cross = signal.csd(x, y, **how)
    coherence = signal.coherence(x, y, **how)[1]
    m = 0.6 * (2.0 * len(y) / size - 1.0)  # Hann windows that overlap by half are not independent
    on = (coherence > max(LEAST, 4.0 / m)) & (f > 1.5 / (size * dt)) & (f < 0.25 / dt)
    if on.sum() < FEWEST:
        return Delay(of, note=f"does not move with {of}")
    w, c = 2.0 * np.pi * f[on], np.clip(coherence[on], 0.0, 1.0 - 1e-9)
    phase = cross[on] / (1j * w) ** n
    phase = np.angle(phase * np.conj(np.sign(np.real(phase.sum())) or 1.0))
    weight = 2.0 * m * c / (1.0 - c)
    denominator = float(weight @ w**2)
    tau = -float(weight @ (w * phase)) / denominator
    left = np.angle(np.exp(1j * (phase + w * tau)))
    scatter = float(weight @ left**2) / (len(w) - 1)
    half = float(student.ppf(0.5 + level / 2.0, len(w) - 1)) * np.sqrt(max(1.0, scatter) / denominator)
    return Delay(of, tau, tau - half, tau + half, float(np.average(c, weights=weight)))


def rows(made: Prepared, level: float) -> list[dict[str, Any]]:
    """Return a row for each channel of a recording: noise and delay."""
    seen: dict[str, str] = {}  # the first of the signals that share a channel
    for name, mapped in made.map.signals.items():
        if mapped.channel and name in made.channels and name in made.sources and made.sources[name].kind != "model":
            seen.setdefault(mapped.channel, name)
    recorded = list(seen.values())
    return [_noise(made, name, level) | {"delay": asdict(_delay(made, name, recorded, level))} for name in recorded]


def on_grid(made: Prepared, names: list[str]) -> tuple[list[np.ndarray], float]:
    """Return (samples of each of the signals [SI], interval [s]) on ticks of the slowest of them, over the longest time
    in which all are valid."""
    dt = max(made.dt, *(clock.interval(made.channels[n][0]) for n in names))
    n = max(1, int(made.n * made.dt / dt))
    got = [
        sampled(made.map.signals[name], made.sources[name], made.channels[name], made.t_0, dt, n,
                shares(made.scenario, name, made.sources[name]))
        for name in names
    ]  # fmt: skip
    on = np.all([np.isfinite(v) & (valid > 0.0) for v, valid in got], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    spans = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2])]
    a, b = max(spans, key=lambda s: s[1] - s[0], default=(0, 0))
    return [v[a:b] for v, _ in got], dt


def _noise(made, name, level):
    mapped, source = made.map.signals[name], made.sources[name]
    t, y, flags = made.channels[name]
    factor = mapped.factor(source.unit, shares(made.scenario, name, source))
    y = np.where(np.isfinite(y), factor * y, np.nan)
    if flags is not None and len(flags[1]) == len(y):
        y = np.where(flags[1] > 0.5, y, np.nan)
    step = clock.interval(t)
    noise = white(np.insert(y, np.flatnonzero(np.diff(t) > 1.5 * step) + 1, np.nan), level)
    finite = y[np.isfinite(y)]
    held = float(np.mean(np.diff(finite) == 0.0)) if len(finite) > 1 else 1.0
    row = {"name": name, "channel": mapped.channel, "unit": source.unit, "rate_hz": 1.0 / step if step else math.nan}
    row |= {"repeated_pct": 100.0 * held}
    if noise is not None:
        return row | {"noise": noise.sigma, "noise_low": noise.low, "noise_high": noise.high,
                      "resolution": noise.resolution, "noise_note": noise.note}  # fmt: skip
    few = "no finite sample" if not len(finite) else "is constant" if np.ptp(finite) == 0.0 else "too few samples"
    return row | {"noise": None, "noise_note": few}


def _delay(made, name, recorded, level):
    """Return the Delay of a channel behind one that physics ties to it: the most certain where there are several."""
    found = []
    for later, other, n in PAIRS:
        if name in (later, other) and later in recorded and other in recorded:
            of, power = (other, n) if name == later else (later, -n)
            (y, x), dt = on_grid(made, [name, of])
            if len(y) and np.ptp(y) > 0.0 and np.ptp(x) > 0.0:
                found.append(lag(y, x, power, dt, of, level))
    none = Delay("", note="delay not identifiable: tied to no channel")
    return min(found, key=lambda d: d.high - d.low if d.high == d.high else math.inf, default=none)
