"""How well faults were found: functions of counts and samples, each with the interval that its sample gives.

| question | function | method |
|---|---|---|
| how late | `delays` | order statistics; a missed fault counts as endless, it is not dropped |
| how often | `proportion`, `rate` | exact: binomial (Clopper and Pearson), Poisson (Garwood) |
| what an alarm is worth | `predictive_value` | Bayes' rule on both, each with half of the error |
| at which threshold | `roc` | run-level maxima |

Confidence is 0.95 unless said otherwise. Nothing here knows a scenario or reads a file.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats


class Share(NamedTuple):
    """A proportion or a rate with its two-sided interval."""

    value: float
    low: float
    high: float


UNKNOWN = Share(math.nan, math.nan, math.nan)


def proportion(k: int, n: int, confidence: float = 0.95) -> Share:
    """Return the Share k/n with the exact interval of Clopper and Pearson; (nan, 0, 1) for n = 0. Raises ValueError
    unless 0 <= k <= n."""
    if n == 0:
        return Share(math.nan, 0.0, 1.0)
    found = stats.binomtest(k, n).proportion_ci(confidence)
    return Share(k / n, float(found.low), float(found.high))


def rate(k: int, hours: float, confidence: float = 0.95) -> Share:
    """Return the Share k/hours [1/h], exact Poisson interval [Garwood 1936]. Raises ValueError without hours."""
    if k < 0 or not hours > 0.0:
        raise ValueError(f"{k} events in {hours} h: the count must be 0 or more, the exposure above 0 h")
    a = (1.0 - confidence) / 2.0
    low, high = (stats.gamma.ppf(q, shape) if shape else 0.0 for q, shape in ((a, k), (1.0 - a, k + 1)))
    return Share(k / hours, float(low) / hours, float(high) / hours)


def predictive_value(
    seen: int, faults: int, false_alarms: int, hours: float, fault_rate: float, confidence: float = 0.95
) -> Share:
    """Return the Share of alarms behind which there is a fault: rate seen / (rate seen + false alarms per hour).

    `seen` of `faults` were detected, `false_alarms` counted in `hours`; `fault_rate` is that of such faults per flight
    hour. The interval takes the exact ones of both, each at half of 1 - confidence, so that it holds at least that
    often (Bonferroni). UNKNOWN without faults. Raises ValueError without hours.
    """
    if faults == 0:
        return UNKNOWN
    half = 0.5 * (1.0 + confidence)
    p, f = proportion(seen, faults, half), rate(false_alarms, hours, half)

    def value(true, false):
        return fault_rate * true / (fault_rate * true + false) if true or false else math.nan

    return Share(value(p.value, f.value), value(p.low, f.high), value(p.high, f.low))


MEDIAN = "median over all faults, from the onset on"
FEWER = "fewer than half"  # are seen, or named: there is no median


class Delays(NamedTuple):
    """Delay over runs; quantiles take missed runs as later than all others: inf when they reach them."""

    median: float  # of an even number the mean of the middle two: inf where the later of them is missed
    median_low: float  # order-statistic interval of the median
    median_high: float
    p95: float
    largest: float  # of the detected ones, NaN without any


def delays(delay: ArrayLike, confidence: float = 0.95) -> Delays:
    """Return Delays of `delay` (runs,), NaN where the fault was missed. Raises ValueError without a run or with a
    negative delay."""
    delay = np.asarray(delay, float)
    n, seen = len(delay), np.isfinite(delay)
    if n == 0 or np.any(delay[seen] < 0.0):
        raise ValueError("no run, or a negative delay")
    ordered = np.sort(np.where(seen, delay, np.inf))
    j = int(stats.binom.ppf((1.0 - confidence) / 2.0, n, 0.5))  # the extremes where n is small
    return Delays(
        median=float(0.5 * (ordered[(n - 1) // 2] + ordered[n // 2])),
        median_low=float(ordered[max(j - 1, 0)]),
        median_high=float(ordered[min(n - j, n - 1)]),
        p95=float(ordered[math.ceil(0.95 * n) - 1]),
        largest=float(np.max(delay[seen])) if seen.any() else math.nan,
    )


class Roc(NamedTuple):
    """Shares of healthy and of faulty runs at or beyond each threshold, thresholds falling from inf."""

    threshold: NDArray
    false_alarm: NDArray
    detection: NDArray


def roc(healthy: ArrayLike, faulty: ArrayLike) -> Roc:
    """Return the Roc of run-level maxima: an alarm is a maximum at or beyond the threshold. Raises ValueError without
    runs, or for one without a number."""
    each = [np.sort(np.asarray(sample, float)) for sample in (healthy, faulty)]
    if not all(map(len, each)) or np.isnan(np.concatenate(each)).any():
        raise ValueError("a ROC needs healthy and faulty runs, all with a number")
    t = np.append(np.inf, np.unique(np.concatenate(each))[::-1])
    return Roc(t, *(1.0 - np.searchsorted(own, t) / len(own) for own in each))
