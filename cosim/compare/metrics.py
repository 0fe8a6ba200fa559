"""How well faults were found: pure functions of counts and samples, each with the interval that its sample gives.

| question | function | method |
|---|---|---|
| how late | `delays` | order statistics; a missed fault is censored at the end of its run, not dropped |
| how often a false alarm | `clopper_pearson`, `rate` | exact: binomial per flight, Poisson per hour |
| how many missed | `wilson` | score interval |
| what it was called | `confusion` | rows fault class, columns verdict with none and ambiguous |
| at which threshold | `roc`, `auc`, `trade` | sweep over run-level maxima |
| how large | `estimate` | RMSE, bias, largest error; bootstrap over runs |
| is the filter honest | `nis`, `nis_bounds`, `ljung_box`, `mean_test` | chi-square, whiteness, mean of innovations |
| can it be seen at all | `fault_to_noise` | smallest fault gain over largest disturbance gain |

Confidence is 0.95 unless said otherwise. Nothing here knows a scenario or reads a file.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import special, stats


class Share(NamedTuple):
    """A proportion or a rate with its two-sided interval."""

    value: float
    low: float
    high: float


def clopper_pearson(k, n, confidence=0.95):
    """Return the Share k/n with the exact binomial interval [Clopper, Pearson 1934].

    0 of n gives high = 1 - (alpha/2)^(1/n). Raises ValueError unless 0 <= k <= n, n > 0.
    """
    _counted(k, n)
    a = (1.0 - confidence) / 2.0
    low = 0.0 if k == 0 else float(special.betaincinv(k, n - k + 1, a))
    high = 1.0 if k == n else float(special.betaincinv(k + 1, n - k, 1.0 - a))
    return Share(k / n, low, high)


def upper_bound(k, n, confidence=0.95):
    """Return the exact one-sided upper bound of a probability after k of n: 0 in 300 is below 1 % at 95 %."""
    _counted(k, n)
    return 1.0 if k == n else float(special.betaincinv(k + 1, n - k, confidence))


def wilson(k, n, confidence=0.95):
    """Return the Share k/n with the score interval [Wilson 1927]. Raises ValueError unless 0 <= k <= n, n > 0."""
    _counted(k, n)
    z = float(stats.norm.ppf(0.5 + confidence / 2.0))
    p, z2 = k / n, z * z
    centre, half = p + z2 / (2 * n), z * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    scale = 1.0 + z2 / n
    return Share(p, max(0.0, (centre - half) / scale), min(1.0, (centre + half) / scale))


def rate(k, hours, confidence=0.95):
    """Return the Share k/hours [1/h], exact Poisson interval [Garwood 1936]. Raises ValueError without hours."""
    if k < 0 or not hours > 0.0:
        raise ValueError(f"{k} events in {hours} h is no count")
    a = (1.0 - confidence) / 2.0
    low = 0.0 if k == 0 else float(stats.chi2.ppf(a, 2 * k)) / 2.0
    return Share(k / hours, low / hours, float(stats.chi2.ppf(1.0 - a, 2 * k + 2)) / 2.0 / hours)


def _counted(k, n):
    if n <= 0 or not 0 <= k <= n:
        raise ValueError(f"{k} of {n} is no count")


class Delays(NamedTuple):
    """Detection delay over runs; quantiles take missed runs as later than all others: inf when they reach them."""

    runs: int
    detected: int
    missed: Share  # with the Wilson interval
    median: float
    median_low: float  # order-statistic interval of the median
    median_high: float
    p95: float
    largest: float  # of the detected ones, NaN without any
    restricted_mean: float  # area under the Kaplan-Meier curve up to the longest time watched


def delays(delay, watched=None, confidence=0.95):
    """Return Delays of `delay` (runs,), NaN where the fault was missed.

    `watched` (runs,) is how long each missed run was watched after the onset, the censoring time of Kaplan and Meier;
    by default the largest delay seen. Raises ValueError without a run or with a negative delay.
    """
    delay = np.asarray(delay, float)
    n, seen = len(delay), np.isfinite(delay)
    if n == 0 or np.any(delay[seen] < 0.0):
        raise ValueError("no run, or a negative delay")
    ordered = np.sort(np.where(seen, delay, np.inf))
    low, high = _median_ranks(n, confidence)
    k = int(seen.sum())
    return Delays(
        runs=n,
        detected=k,
        missed=wilson(n - k, n, confidence),
        median=float(ordered[(n - 1) // 2]),
        median_low=float(ordered[low]),
        median_high=float(ordered[high]),
        p95=float(ordered[math.ceil(0.95 * n) - 1]),
        largest=float(ordered[k - 1]) if k else math.nan,
        restricted_mean=_area(delay, seen, watched),
    )


def _median_ranks(n, confidence):
    """Return the two ranks (from 0) that hold the median with at least `confidence`; the extremes when n is small."""
    j = int(stats.binom.ppf((1.0 - confidence) / 2.0, n, 0.5))
    return max(j - 1, 0), min(n - j, n - 1)


def _area(delay, seen, watched):
    times, survival = kaplan_meier(delay, watched)
    end = np.max(np.where(seen, delay, 0.0)) if watched is None else np.max(np.where(seen, delay, watched))
    edges = np.concatenate([[0.0], times, [end]])
    return float(np.sum(np.diff(edges) * np.concatenate([[1.0], survival])))


def kaplan_meier(delay, watched=None):
    """Return (times, S): share not yet detected just after each time at which one was [Kaplan, Meier 1958]."""
    delay = np.asarray(delay, float)
    seen = np.isfinite(delay)
    last = np.max(delay[seen], initial=0.0)
    until = np.where(seen, delay, last if watched is None else np.asarray(watched, float))
    times = np.unique(delay[seen])
    factors = [1.0 - np.sum(delay[seen] == t) / np.sum(until >= t) for t in times]
    return times, np.cumprod(factors)


class Confusion(NamedTuple):
    """Counts of (fault class, verdict); columns end with none and ambiguous."""

    classes: tuple
    verdicts: tuple
    counts: np.ndarray

    @property
    def accuracy(self):
        """Return the Share of runs whose verdict is their class, with the Wilson interval."""
        right = sum(
            int(self.counts[i, self.verdicts.index(c)]) for i, c in enumerate(self.classes) if c in self.verdicts
        )
        return wilson(right, int(self.counts.sum()))


def confusion(truth, verdict, classes=None):
    """Return the Confusion of fault classes and verdicts (sequences of words; no verdict is None or "none")."""
    verdict = ["none" if v is None or v != v or v == "" else str(v) for v in verdict]
    truth = [str(t) for t in truth]
    classes = tuple(classes or sorted(set(truth)))
    rest = ("none", "ambiguous")
    verdicts = (*dict.fromkeys([c for c in classes if c not in rest] + sorted(set(verdict) - set(rest))), *rest)
    counts = np.zeros((len(classes), len(verdicts)), int)
    for t, v in zip(truth, verdict, strict=True):
        counts[classes.index(t), verdicts.index(v)] += 1
    return Confusion(classes, verdicts, counts)


class Roc(NamedTuple):
    """Detection against false alarm, threshold falling; the first point is (0, 0) at an infinite threshold."""

    threshold: np.ndarray
    false_alarm: np.ndarray
    detection: np.ndarray


def roc(healthy, faulty):
    """Return the Roc of run-level maxima, `healthy` without and `faulty` with a fault; an alarm is >= threshold.

    Raises ValueError when one of them is empty or holds NaN.
    """
    healthy, faulty = np.asarray(healthy, float), np.asarray(faulty, float)
    if not len(healthy) or not len(faulty) or np.isnan(healthy).any() or np.isnan(faulty).any():
        raise ValueError("a ROC needs healthy and faulty runs, all with a number")
    t = np.concatenate([[np.inf], np.unique(np.concatenate([healthy, faulty]))[::-1]])
    share = [np.searchsorted(np.sort(x), t, side="left") for x in (healthy, faulty)]
    return Roc(t, 1.0 - share[0] / len(healthy), 1.0 - share[1] / len(faulty))


def auc(curve):
    """Return the area under a Roc: the probability that a faulty run exceeds a healthy one, ties counted half."""
    return float(np.trapezoid(curve.detection, curve.false_alarm))


def threshold(healthy, probability, confidence=0.95):
    """Return (threshold, upper bound): an alarm at >= threshold hits at most the share `probability` of `healthy`.

    `healthy` are run-level maxima.
    The bound is the exact one-sided one of the false-alarm probability per run that this sample supports.
    """
    ordered = np.sort(np.asarray(healthy, float))
    n = len(ordered)
    allowed = math.floor(probability * n + 1e-9)  # runs that may alarm
    at = float(np.nextafter(ordered[n - 1 - allowed], np.inf))
    return at, upper_bound(int(np.sum(ordered >= at)), n, confidence)


def trade(healthy, crossing, thresholds):
    """Return [(threshold, false-alarm Share, Delays)]: delay against false-alarm rate.

    `healthy` (runs,) maxima of fault-free runs; `crossing(threshold)` -> delays (runs,) with NaN for missed.
    """
    healthy = np.asarray(healthy, float)
    return [(t, clopper_pearson(int(np.sum(healthy >= t)), len(healthy)), delays(crossing(t))) for t in thresholds]


class Error(NamedTuple):
    """An estimate against its truth over runs: pooled RMSE and bias with bootstrap intervals, largest error."""

    runs: int
    rmse: Share
    bias: Share
    largest: float


def estimate(rmse, bias, largest, confidence=0.95, draws=2000, seed=1):
    """Return the Error of runs with their own `rmse`, `bias` and `largest` (runs,) of equal length in time.

    Pooled RMSE = sqrt(mean rmse^2). Samples within a run are correlated, so the bootstrap draws whole runs (percentile
    interval, seeded). Raises ValueError without a run.
    """
    rmse, bias = np.asarray(rmse, float), np.asarray(bias, float)
    n = len(rmse)
    if n == 0:
        raise ValueError("no run with an estimate")
    index = np.random.default_rng(seed).integers(0, n, (draws, n))
    ends = (50 * (1 - confidence), 50 * (1 + confidence))
    shares = []
    for value, sample in (
        (math.sqrt(np.mean(rmse**2)), np.sqrt(np.mean(rmse[index] ** 2, axis=1))),
        (float(np.mean(bias)), np.mean(bias[index], axis=1)),
    ):
        shares.append(Share(float(value), *(float(x) for x in np.percentile(sample, ends))))
    return Error(n, shares[0], shares[1], float(np.max(np.abs(largest))))


def nis_bounds(samples, dimension, confidence=0.95):
    """Return (low, high) of the mean NIS (or NEES) over `samples` independent values of `dimension` degrees of freedom.

    samples * dimension degrees of freedom in the sum [Bar-Shalom 2001, section 5.4]; both bounds tend to `dimension`.
    """
    a, n = (1.0 - confidence) / 2.0, samples * dimension
    return tuple(float(stats.chi2.ppf(q, n)) / samples for q in (a, 1.0 - a))


def nis(innovation, S):
    """Return NIS e' S^-1 e per sample: `innovation` (samples, m), `S` (..., m, m); NEES: state error and P."""
    e = np.atleast_2d(np.asarray(innovation, float))
    return np.einsum(
        "ki,ki->k", e, np.linalg.solve(np.broadcast_to(S, (len(e), *np.shape(S)[-2:])), e[..., None])[..., 0]
    )


class Test(NamedTuple):
    """A test statistic and the probability of a larger one under the hypothesis."""

    statistic: float
    p_value: float


def ljung_box(innovation, lags=20, fitted=0):
    """Return the Test of whiteness Q = n (n + 2) sum_k rho_k^2 / (n - k) [Ljung, Box 1978].

    Chi-square with `lags` - `fitted` degrees of freedom. Raises ValueError when that or the sample is too small.
    """
    x = np.asarray(innovation, float) - np.mean(innovation)
    n = len(x)
    if not 0 < lags < n or lags <= fitted:
        raise ValueError(f"{lags} lags of {n} samples with {fitted} fitted parameters")
    power = float(x @ x)
    rho = np.array([x[k:] @ x[:-k] for k in range(1, lags + 1)]) / power
    q = float(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return Test(q, float(stats.chi2.sf(q, lags - fitted)))


def mean_test(innovation):
    """Return the Test of a zero mean: Student's t of white samples, two-sided."""
    x = np.asarray(innovation, float)
    t = float(np.mean(x) / (np.std(x, ddof=1) / math.sqrt(len(x))))
    return Test(t, float(2 * stats.t.sf(abs(t), len(x) - 1)))


def fault_to_noise(fault, disturbance):
    """Return the gap min_w sigma_min(G_f(jw)) / max_w sigma_max(G_d(jw)) over the frequencies of the band.

    `fault` (w, residuals, faults) and `disturbance` (w, residuals, disturbances) are complex gains at the same
    frequencies, inputs scaled to what is to be seen and what is to be expected.
    """
    seen = np.linalg.svd(np.asarray(fault), compute_uv=False).min(axis=-1).min()
    noise = np.linalg.svd(np.asarray(disturbance), compute_uv=False).max()
    return float(seen / noise) if noise > 0.0 else math.inf
