"""How well faults were found: functions of counts and samples, each with the interval that its sample gives.

| question | function | method |
|---|---|---|
| how late | `delays` | order statistics; a missed fault counts as endless, it is not dropped |
| how often | `proportion`, `rate` | exact: binomial (Clopper and Pearson), Poisson (Garwood) |
| what an alarm is worth | `predictive_value` | Bayes' rule on both, each with half of the error |

Confidence is 0.95 unless said otherwise. Nothing here knows a scenario or reads a file.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

MEDIAN = "median over all faults, from the onset on"
FEWER = "fewer than half"  # are seen, or named: there is no median


class Share(NamedTuple):
    """A proportion or a rate with its two-sided interval: numbers, or arrays of them."""

    value: Any
    low: Any
    high: Any


UNKNOWN = Share(math.nan, math.nan, math.nan)


def proportion(k: Any, n: int, confidence: float = 0.95) -> Share:
    """Return the Share k/n, `k` a count or an array (m,), with the exact interval of Clopper and Pearson; (nan, 0, 1)
    for n = 0. Raises ValueError unless 0 <= k <= n."""
    if np.any(np.less(k, 0)) or np.any(np.greater(k, n)):
        raise ValueError(f"{k} of {n}: a count must be 0 to {n}")
    a = (1.0 - confidence) / 2.0
    low, high = stats.beta.ppf(a, k, np.subtract(n + 1, k)), stats.beta.ppf(1.0 - a, np.add(k, 1), np.subtract(n, k))
    value = np.divide(k, n) if n else np.full(np.shape(k), math.nan)[()]
    return Share(value, np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=1.0))  # no quantile: none, or all


def rate(k: int, hours: float, confidence: float = 0.95) -> Share:
    """Return the Share k/hours [1/h], exact Poisson interval [Garwood 1936]. Raises ValueError without hours."""
    if k < 0 or not hours > 0.0:
        raise ValueError(f"{k} events in {hours} h: the count must be 0 or more, the exposure above 0 h")
    a = (1.0 - confidence) / 2.0
    low, high = np.nan_to_num(stats.gamma.ppf((a, 1.0 - a), (k, k + 1))) / hours
    return Share(k / hours, low, high)


def predictive_value(
    seen: int, faults: int, false_alarms: int, hours: float, fault_rate: float, confidence: float = 0.95
) -> Share:
    """Return the Share of alarms behind which there is a fault: rate seen / (rate seen + false alarms per hour).

    `seen` of `faults` were detected, `false_alarms` counted in `hours`; `fault_rate` is that of such faults per flight
    hour. The interval takes the exact ones of both, each at half of 1 - confidence, so that it holds at least that
    often (Bonferroni). UNKNOWN without faults or hours.
    """
    if not faults or not hours > 0.0:
        return UNKNOWN
    half = 0.5 * (1.0 + confidence)
    p, f = proportion(seen, faults, half), rate(false_alarms, hours, half)

    def value(true, false):
        return fault_rate * true / (fault_rate * true + false) if true or false else math.nan

    return Share(value(p.value, f.value), value(p.low, f.high), value(p.high, f.low))


def delays(delay: ArrayLike, confidence: float = 0.95) -> dict[str, float]:
    """Return {median, low, high, p95, max} of `delay` (runs,), NaN where the fault was missed.

    A missed run is later than all others: quantiles that reach it are inf, also the median of an even number where the
    later of the middle two is missed. `low` and `high` bound the median by order statistics, `max` is the largest of
    the detected ones, NaN without any. Raises ValueError without a run or with a negative delay.
    """
    delay = np.asarray(delay, float)
    n, seen = len(delay), delay[np.isfinite(delay)]
    if n == 0 or np.any(seen < 0.0):
        raise ValueError("no run, or a negative delay")
    ordered = np.sort(np.where(np.isfinite(delay), delay, np.inf))
    j = int(stats.binom.ppf((1.0 - confidence) / 2.0, n, 0.5))  # the extremes where n is small
    at = {"low": max(j - 1, 0), "high": min(n - j, n - 1), "p95": math.ceil(0.95 * n) - 1}
    median = float(0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]))
    largest = float(np.max(seen)) if len(seen) else math.nan
    return {"median": median, **{name: float(ordered[i]) for name, i in at.items()}, "max": largest}
