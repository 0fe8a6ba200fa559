"""Rice's rate: how often a stationary Gaussian residual crosses a level.

    found = gaussian(Moments.of(flight) for every flight)       # by test, else `found.note` says what is against it
    found.rate(c)                                               # crossings of |r| = c from below, per hour

In samples `dt` apart the rate is P(|r_k| < c <= |r_k+1|) / dt, a normal integral of the variance and of the correlation
of neighbours; with a second derivative it tends to Rice's 1/pi sqrt(m2/m0) exp(-c^2 / 2 m0) (Rice 1945). Every alarm
that needs |r| >= c needs a crossing, so that this bounds the alarms of a flight that begins below c.

Tests, each at 1 %: mean, skewness and kurtosis of the pooled residual, and one variance in all flights (Bartlett 1937),
for as many independent samples as the autocorrelation leaves.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from cosim.campaign.fault_free import Moments
from cosim.compare.metrics import UNKNOWN, Band, Share

LEVEL = 0.01  # of each test
LEAST = 100.0  # independent samples, below which a residual is not called Gaussian
NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian residual, or a `note` with what is against it."""

    dt: float
    sigma: Share = UNKNOWN
    rho: float = math.nan  # correlation of neighbouring samples
    note: str = ""
    p: tuple = ()  # probabilities of the tests: mean, skewness, kurtosis, one variance

    def rate(self, level: ArrayLike) -> Band:
        """Return the crossings of |r| = level from below, 1/h; the interval is that of sigma."""
        if self.note:
            raise ValueError(self.note)
        c = np.atleast_1d(np.asarray(level, float))
        return Band(*(crossing(c / s, self.rho) * 3600.0 / self.dt for s in self.sigma))


def crossing(c: NDArray, rho: float) -> NDArray:
    """Return P(|x| < c <= |y|) of standard normal x, y with correlation rho, for each c (n,)."""
    s = math.sqrt(1.0 - rho * rho)
    out = []
    for level in c:
        # x counts where y can still be reached from it: within 12 standard deviations of the step below the level
        low = max(-level, level - 12.0 * s - (1.0 - rho) * level)
        x = 0.5 * (level - low) * NODES + 0.5 * (level + low)
        jump = stats.norm.sf((level - rho * x) / s) + stats.norm.sf((level + rho * x) / s)
        both = 2.0 if low > -level else 1.0  # the other side does the same
        out.append(both * 0.5 * (level - low) * float(WEIGHTS @ (stats.norm.pdf(x) * jump)))
    return np.array(out)


def gaussian(flights: Iterable[Moments], dt: float, confidence: float = 0.95) -> Gaussian:
    """Return the Gaussian of a residual with zero mean that all `flights` share, samples `dt` [s] apart."""
    m = [f for f in flights if f.n > 1]
    if not m:
        return Gaussian(dt, note="too few independent samples")
    n, s1, s2, s3, s4, lag1 = (
        np.array([getattr(f, x) for f in m], float) for x in ("n", "s1", "s2", "s3", "s4", "lag1")
    )
    total = n.sum()
    N1, N = (float(total * len(m) / sum(getattr(f, x) for f in m)) for x in ("memory", "memory2"))
    variance = float(s2.sum() / total)
    if N < LEAST or not variance > 0.0:
        return Gaussian(dt, note="too few independent samples" if variance > 0.0 else "its residual does not move")
    mean, third, fourth = (float(s.sum() / total) / variance**j for s, j in ((s1, 0.5), (s3, 1.5), (s4, 2.0)))
    # Hermite polynomials of a Gaussian are uncorrelated: H3 has variance 6, H4 has 24
    away = mean * math.sqrt(N1), (third - 3.0 * mean) * math.sqrt(N / 6.0), (fourth - 3.0) * math.sqrt(N / 24.0)
    tests = [*(2.0 * float(stats.norm.sf(abs(z))) for z in away), _one_variance(s2 / n, n / total * N)]
    names = (
        "its residual has a mean", "it is skewed", "it has other tails than a Gaussian",
        "its variance differs from flight to flight",
    )  # fmt: skip
    note = "; ".join(name for name, p in zip(names, tests) if p < LEVEL)
    a = 0.5 - confidence / 2.0
    low, high = (math.sqrt(variance * N / stats.chi2.ppf(q, N)) for q in (1.0 - a, a))
    rho = float(lag1.sum() / (n - 1.0).sum()) / variance
    return Gaussian(dt, Share(math.sqrt(variance), low, high), rho, note, tuple(tests))


def _one_variance(own, free):
    """Return the probability of Bartlett's test: variances (m,) of as many flights, with `free` (m,) samples each."""
    m, all_free = len(own), float(free.sum())
    if m < 2:
        return 1.0
    if not (own > 0.0).all():
        return 0.0
    t = all_free * math.log(float(free @ own) / all_free) - float(free @ np.log(own))
    return float(stats.chi2.sf(t / (1.0 + (float((1.0 / free).sum()) - 1.0 / all_free) / (3.0 * (m - 1))), m - 1))
