"""Stationary processes whose rate of first passages beyond a level is known: by an operator, not by simulation.

x_k+1 = rho x_k + e_k leaves (-c, c) at the rate -log(lambda) per step, lambda the largest eigenvalue of its transition
operator killed outside. With pi the left eigenfunction (what is left looks like it in the long run),
1 - lambda = integral of pi(x) P(leave | x), which loses no digits where lambda is nearly 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.ndimage import maximum_filter1d
from scipy.optimize import brentq
from scipy.signal import lfilter

DT = 1.0  # [s] from sample to sample
MEMORY = 0.2  # correlation of two windows at which they count as unrelated


@dataclass(frozen=True)
class Process:
    """An autoregression of order 1 with unit variance (df 0: Gaussian), or innovations of Student's t with df; its
    standard deviation is `levels` in the `shares` of the flights, which are `flight_s` long."""

    rho: float
    df: int = 0
    levels: tuple = (1.0,)
    shares: tuple = (1.0,)
    flight_s: float = 3600.0

    def rate(self, c):
        """Return the exact rate of first passages of |x| beyond c [1/h]."""
        hazard = (_student if self.df else _gauss)(self)
        return sum(w * (-math.log1p(-hazard(c / s)) * 3600.0 / DT) for s, w in zip(self.levels, self.shares)
                   if self.df or c / s < 12.0)  # fmt: skip

    def level(self, rate):
        """Return the level that is passed at `rate` [1/h]."""
        low, high = 2.5, 11.9 * max(self.levels)
        if self.df:  # one innovation alone, and with what came before it
            low = 0.9 * float(stats.t(self.df).isf(0.5 * rate * DT / 3600.0))
            high = 2.0 * low / (1.0 - self.rho)
        gap = lambda c: math.log(self.rate(math.exp(c)) / rate)  # noqa: E731
        return math.exp(brentq(gap, math.log(low), math.log(high), xtol=1e-5))

    def windows(self, hours, seed, window=2):
        """Return the maxima of |x| per `window` samples (n,) and the numbers of their flights (n,)."""
        rng = np.random.default_rng(seed)
        flights, steps = round(hours * 3600.0 / self.flight_s), round(self.flight_s / DT)
        sigma = rng.choice(self.levels, flights, p=self.shares)
        late = 200 if self.df else 0  # heavy tails begin anywhere and forget it; the others begin as they go on
        size = flights, late + steps
        e = rng.standard_t(self.df, size) if self.df else math.sqrt(1.0 - self.rho**2) * rng.standard_normal(size)
        before = 0.0 * e[:, :1] if self.df else self.rho * rng.standard_normal((flights, 1))
        x = lfilter([1.0], [1.0, -self.rho], e, zi=before)[0][:, late:]
        m = np.abs(x).reshape(flights, steps // window, window).max(axis=2) * sigma[:, None]
        return m.ravel(), np.repeat(np.arange(flights), steps // window)


def _gauss(process):
    s = math.sqrt(1.0 - process.rho**2)

    def hazard(c):
        x, w = np.polynomial.legendre.leggauss(max(60, int(8.0 * c / s)))
        x, w = c * x, c * w
        P = stats.norm.pdf((x[None, :] - process.rho * x[:, None]) / s) / s * w[None, :]
        return _leaving(P, stats.norm.sf((c - process.rho * x) / s) + stats.norm.sf((c + process.rho * x) / s))

    return hazard


def _student(process):
    law = stats.t(process.df)

    def hazard(c, n=500):
        """Cells that widen outwards; what leaves a cell's middle arrives exactly, in one cell or outside."""
        edges = 2.0 * np.sinh(np.linspace(-1.0, 1.0, n + 1) * math.asinh(c / 2.0))
        x = 0.5 * (edges[1:] + edges[:-1])
        P = np.diff(law.cdf(edges[None, :] - process.rho * x[:, None]), axis=1)
        return _leaving(P, law.sf(c - process.rho * x) + law.sf(c + process.rho * x))

    return hazard


def _leaving(P, out):
    """Return 1 - lambda: iterate the left eigenvector, then ask what leaves from it."""
    pi = np.full(len(out), 1.0 / len(out))
    for _ in range(100_000):
        new = pi @ P
        new /= new.sum()
        done = np.abs(new - pi).sum() < 1e-13
        pi = new
        if done:
            break
    return float(pi @ out)


def memory(windows, flights):
    """Return after how many windows the maxima `windows` (n,) are unrelated, each taken against its flight's mean.

    `flights` (n,) are their numbers, rising. At least 1, at most the longest flight.
    """
    m, f = np.asarray(windows, float), np.asarray(flights)
    first = np.flatnonzero(np.diff(f, prepend=f[0] - 1))
    count = np.diff(first, append=len(f))
    d = m - np.repeat(np.add.reduceat(m, first) / count, count)
    power = float(d @ d) / len(d)
    for lag in range(1, int(count.max())):
        same = f[lag:] == f[:-lag]
        if power <= 0.0 or float((d[lag:] * d[:-lag])[same].mean()) < MEMORY * power:
            return lag
    return int(count.max())


def peaks(windows, flights, run):
    """Return the maxima that are the largest of the `run` windows before and after them in their flight, and the
    numbers of their flights.
    """
    m, f = np.asarray(windows, float), np.asarray(flights)
    gaps = np.repeat(np.flatnonzero(np.diff(f)) + 1, run)
    apart = np.insert(m, gaps, -np.inf)  # a flight does not see its neighbours
    largest = maximum_filter1d(apart, 2 * run + 1, mode="constant", cval=-np.inf)
    highest = (apart == largest) & np.isfinite(apart)
    return apart[highest], np.insert(f, gaps, -1)[highest]
