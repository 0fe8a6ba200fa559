"""Extreme-value fit: peaks over threshold, rates beyond the largest value flown, with intervals.

    tail = fit(peaks, hours)                                # of independent ones, the largest of each flight
    tail.rate(1.7)                                          # events per hour at level 1.7: (value, low, high)

Above a level u the heights of independent peaks tend to the generalised Pareto law (Pickands 1975, Balkema and de Haan
1974), S(x) = (1 + xi x / sigma)^(-1/xi), and the peaks to a Poisson process of rate nu:

    rate(c) = nu S(c - u)

The interval at c is that of the profile likelihood of (nu, sigma, xi): what rate(c) may be over all parameters with a
deviance up to the critical value, which is that of 97 % for 95 %: at a level that is observed the law holds but nearly.
A shape below 0 means that no level beyond u - sigma / xi is ever reached, which 100 peaks of a Gaussian residual will
claim and which is wrong: the Gaussian law has shape 0 in the limit and below it at every level that is observed. So the
upper end also holds the exponential tail (xi = 0) through the mean excess.

The number of peaks is fixed, not chosen by looking: with PEAKS of them the spread of xi exceeds its bias for all
processes that tests/compare/test_extreme_value.py knows the exact answer of. Where the law does not fit there is no
curve.

    found = gaussian(Moments.of(flight) for every flight)   # by test, else `found.note` says what is against it
    found.rate(c)                                           # crossings of |r| = c from below, per hour

Every alarm that needs |r| >= c needs a crossing, so that the rate of a stationary Gaussian residual's bounds the alarms
of a flight that begins below c. In samples `dt` apart it is P(|r_k| < c <= |r_k+1|) / dt, a normal integral of the
variance and of the correlation of neighbours; with a second derivative it tends to Rice's
1/pi sqrt(m2/m0) exp(-c^2 / 2 m0) (Rice 1945). Tests, each at 1 %: mean, skewness and kurtosis of the pooled residual,
and one variance in all flights (Bartlett 1937), for as many independent samples as the autocorrelation leaves.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats
from scipy.optimize import brentq

from cosim.campaign.fault_free import Moments
from cosim.compare.metrics import UNKNOWN, Band, Share, rate

PEAKS = 100  # highest peaks that are fitted
SHARE = 0.2  # of all peaks at most: below lies the body of the distribution, not its tail
LEAST = 40  # peaks, below which nothing is fitted
GRID = 45  # values of each parameter in a pass over the likelihood; twice as many in the last one
FOR_BIAS = 0.6  # of the doubt is that of the sample; the rest pays for the law being one of the limit only
SHAPES, SCALES = (-0.5, 1.5), (-1.6, 1.8)  # where it is looked for: xi, log(sigma / median excess)
CROWDED = 0.25  # of the flights that they would come from by chance: below, a rare condition makes the highest peaks
TIES = 0.1  # share of equal peaks from which the statistic saturates
FAR = 1e7  # mean excesses: beyond this no level is looked for
# 1 % points of the Anderson-Darling statistic of 100 peaks of shape xi, both fitted (derived: 1,500 samples each)
SHAPE_OF_AD = (-0.4, -0.2, 0.0, 0.2, 0.4, 0.7, 1.0)
AD_1_PCT = (1.78, 1.42, 1.38, 1.24, 1.21, 1.13, 1.10)


@dataclass(frozen=True)
class Tail:
    """A fitted tail; `note` says why there is none."""

    hours: float
    k: int = 0  # peaks above u
    u: float = math.nan  # the highest peak that is not among them
    sigma: float = math.nan
    shape: Share = UNKNOWN
    ad: float = math.nan  # Anderson-Darling statistic of the k excesses
    note: str = ""
    excess: NDArray = field(default_factory=lambda: np.empty(0), repr=False)  # (k,)
    region: tuple = field(default=(), repr=False)  # xi, sigma, log rate at u: low, high

    def rate(self, level: ArrayLike) -> Band:
        """Return the rate at each level, 1/h. Raises ValueError below u, or without a fit."""
        c = np.atleast_1d(np.asarray(level, float)) - self.u
        if self.note or (c < 0.0).any():
            raise ValueError(self.note or f"the fit holds from {self.u:g} on")
        xi, sigma, low, high = self.region
        above = log_survival(c[:, None], xi, sigma)
        nu = math.log(self.k / self.hours)
        value = nu + log_survival(c, self.shape.value, self.sigma)
        most = np.maximum((high + above).max(axis=1), nu - c / self.excess.mean())
        return Band(np.exp(value), np.exp((low + above).min(axis=1)), np.exp(most))

    def level(self, wanted: float) -> Share:
        """Return the Share of the level at which the rate is `wanted` [1/h]; inf for a bound that no level keeps."""
        found = []
        for pick in (0, 1, 2):
            gap = lambda c, pick=pick: math.log(max(self.rate(c)[pick][0], 1e-300)) - math.log(wanted)  # noqa: E731
            far = self.u + FAR * float(self.excess.mean())
            found.append(self.u if gap(self.u) < 0.0 else math.inf if gap(far) > 0.0 else brentq(gap, self.u, far))
        return Share(*found)


def log_survival(x: NDArray, xi: ArrayLike, sigma: ArrayLike) -> NDArray:
    """Return log S(x) of the generalised Pareto law, -inf beyond its end."""
    xi = np.where(np.abs(xi) < 1e-9, 1e-9, xi)
    z = 1.0 + xi * x / sigma
    return np.where(z > 0.0, -np.log(np.where(z > 0.0, z, 1.0)) / xi, -np.inf)


def fit(
    peak: ArrayLike, hours: float, k: int = PEAKS, confidence: float = 0.95, flights: ArrayLike | None = None
) -> Tail:
    """Return the Tail of independent peaks (n,) in `hours`, by the k highest, or SHARE of them where there are few.
    `flights` (n,) are the numbers of their flights; None: one each."""
    p = np.asarray(peak, float)
    order = np.argsort(-p)
    p, k = p[order], min(k, int(SHARE * len(p)))
    if k < LEAST:
        return Tail(hours, note=f"only {len(p)} peaks: less than {LEAST / SHARE:.0f}")
    x = p[:k] - p[k]
    if len(np.unique(x)) < (1.0 - TIES) * k or x.mean() <= 0.0:
        return Tail(hours, k, note="saturates: its highest peaks are equal")
    if flights is not None and (few := _crowded(np.asarray(flights), order[:k])):
        return Tail(hours, k, note=f"its highest peaks are of {few:.0f} flights: their share of all is not known")
    scale = float(np.median(x))
    wide = 1.0 - FOR_BIAS * (1.0 - confidence)
    most = float(stats.t.ppf(0.5 + wide / 2.0, k - 2)) ** 2
    xi, log_sigma, deviance = _likelihood(x / scale, most)
    best = int(np.argmin(deviance))
    inside = deviance <= most
    at_edge = xi[best] >= SHAPES[1] - 0.02
    shape = Share(float(xi[best]), float(xi[inside].min()), float(xi[inside].max()))
    sigma = scale * np.exp(log_sigma)
    ad = anderson_darling(x, shape.value, float(sigma[best]))
    note = "its tail is so heavy that it has no mean" if at_edge else ""
    if not note and k == PEAKS and ad > np.interp(shape.value, SHAPE_OF_AD, AD_1_PCT):
        note = "its peaks do not follow the generalised Pareto law (Anderson-Darling, 1 %)"
    # what is left of the deviance is for the rate at u: 2 k (r - 1 - log r), r the rate over k / hours
    w = -np.exp(-1.0 - (most - deviance[inside]) / (2.0 * k))
    low, high = (np.log(-special.lambertw(w, branch).real * k / hours) for branch in (0, -1))
    region = xi[inside], sigma[inside], low, high
    return Tail(hours, k, float(p[k]), float(sigma[best]), shape, ad, note, x, region)


def _crowded(flights, highest):
    """Return how many flights the highest peaks come from, 1 over the sum of squared shares; 0 where that is enough."""
    share = np.unique(flights[highest], return_counts=True)[1] / len(highest)
    every = len(np.unique(flights))
    found, chance = 1.0 / float(share @ share), len(highest) * every / (len(highest) + every)
    return found if found < CROWDED * chance else 0.0


def _likelihood(x, most):
    """Return (xi, log sigma, deviance) over a grid that holds all that deviate by `most`; x has median 1."""
    a, b = SHAPES, SCALES
    for n, slack in ((GRID, 4.0), (GRID, 2.0), (2 * GRID, 0.0)):
        xi, s = np.linspace(*a, n), np.linspace(*b, n)
        L = np.array([_log_likelihood(x, one, s) for one in np.where(np.abs(xi) < 1e-9, 1e-9, xi)])
        deviance = 2.0 * (L.max() - L)
        near = np.argwhere(deviance <= most + slack)
        (i, j), (i_end, j_end) = np.maximum(near.min(axis=0) - 1, 0), np.minimum(near.max(axis=0) + 1, n - 1)
        a, b = (xi[i], xi[i_end]), (s[j], s[j_end])
    return np.repeat(xi, n), np.tile(s, n), deviance.ravel()


def _log_likelihood(x, xi, log_sigma):
    """Return the log likelihood (n,) of x for one xi and log_sigma (n,)."""
    z = 1.0 + xi * x * np.exp(-log_sigma)[:, None]
    possible = z.min(axis=1) > 0.0
    return np.where(
        possible, -len(x) * log_sigma - (1.0 + 1.0 / xi) * np.log(np.maximum(z, 1e-300)).sum(axis=1), -np.inf
    )


def anderson_darling(x: ArrayLike, xi: float, sigma: float) -> float:
    """Return A^2 of excesses x (k,) against the law with these parameters: large where they do not follow it."""
    log_s = np.maximum(log_survival(np.sort(np.asarray(x, float)), xi, sigma), -700.0)
    n, i = len(log_s), np.arange(1, len(log_s) + 1)
    log_f = np.log(np.maximum(-np.expm1(log_s), 1e-300))
    return float(-n - np.mean((2 * i - 1) * (log_f + log_s[::-1])))


def stability(peak: ArrayLike, hours: float, ks: Sequence[int] = (50, 70, 100, 140, 200, 280, 400)) -> list[dict]:
    """Return {k, u, shape, low, high} for other numbers of peaks: the shape of a tail does not hang on their number."""
    tails = [fit(peak, hours, k) for k in ks if k <= SHARE * len(np.asarray(peak))]
    return [{"k": t.k, "u": t.u, "shape": t.shape.value, "low": t.shape.low, "high": t.shape.high} for t in tails
            if len(t.region)]  # fmt: skip


def counted(peak: ArrayLike, hours: float, level: ArrayLike) -> Band:
    """Return peaks at or beyond each level, 1/h, with exact Poisson intervals (Garwood 1936)."""
    p = np.sort(np.asarray(peak, float))
    found = [rate(int(len(p) - np.searchsorted(p, c)), hours) for c in np.atleast_1d(level)]
    return Band(*(np.array(x) for x in zip(*found)))


TEST = 0.01  # of each test
INDEPENDENT = 100.0  # independent samples, below which a residual is not called Gaussian
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
    if N < INDEPENDENT or not variance > 0.0:
        return Gaussian(dt, note="too few independent samples" if variance > 0.0 else "its residual does not move")
    mean, third, fourth = (float(s.sum() / total) / variance**j for s, j in ((s1, 0.5), (s3, 1.5), (s4, 2.0)))
    # Hermite polynomials of a Gaussian are uncorrelated: H3 has variance 6, H4 has 24
    away = mean * math.sqrt(N1), (third - 3.0 * mean) * math.sqrt(N / 6.0), (fourth - 3.0) * math.sqrt(N / 24.0)
    tests = [*(2.0 * float(stats.norm.sf(abs(z))) for z in away), _one_variance(s2 / n, n / total * N)]
    names = (
        "its residual has a mean", "it is skewed", "it has other tails than a Gaussian",
        "its variance differs from flight to flight",
    )  # fmt: skip
    note = "; ".join(name for name, p in zip(names, tests) if p < TEST)
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
