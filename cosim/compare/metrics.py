"""How well faults were found: functions of counts and samples, each with the interval that its sample gives.

| question | function | method |
|---|---|---|
| how late | `delays` | order statistics; a missed fault counts as endless, it is not dropped |
| how often | `proportion`, `rate` | exact: binomial (Clopper and Pearson), Poisson (Garwood) |
| what an alarm is worth | `predictive_value` | Bayes' rule on both, each with half of the error |
| how large a fault must be | `fit` | probability of detection over size, binomial regression |

POD(a) = 1 / (1 + exp(-(b0 + b1 ln a))), fitted over all flights, seen and missed. a90 is where the curve reaches 0.9,
a90/95 where its lower 95 % confidence bound does: larger ones are seen in nine of ten flights, and only one sample in
twenty would have made it too small (MIL-HDBK-1823A).

Confidence is 0.95 unless said otherwise. Nothing here knows a scenario or reads a file.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats
from scipy.optimize import brentq

from cosim.table import number

MEDIAN = "median over all faults, from the onset on"
FEWER = "fewer than half"  # are seen, or named: there is no median
LEAST = 12  # flights, below which no curve is fitted
STEPS = 100  # of Newton's method; a sample that overlaps needs fewer than ten
SETTLED = 1e-12  # relative change of the deviance at which it ends
SINGULAR = 1e14  # condition number of the information, beyond which its inverse has no correct digit


class Share(NamedTuple):
    """A proportion or a rate with its two-sided interval: numbers, or arrays of them."""

    value: Any
    low: Any
    high: Any


UNKNOWN = Share(math.nan, math.nan, math.nan)


def proportion(k: Any, n: int, confidence: float = 0.95) -> Share:
    """Return the Share k/n, `k` a count of 0 to n or an array (m,) of them, with the exact interval of Clopper and
    Pearson; (nan, 0, 1) for n = 0."""
    a = (1.0 - confidence) / 2.0
    low, high = stats.beta.ppf(a, k, np.subtract(n + 1, k)), stats.beta.ppf(1.0 - a, np.add(k, 1), np.subtract(n, k))
    value = np.divide(k, n) if n else np.full(np.shape(k), math.nan)[()]
    return Share(value, np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=1.0))  # no quantile: none, or all


def rate(k: int, hours: float, confidence: float = 0.95) -> Share:
    """Return the Share k/hours [1/h] of a count in `hours` above 0, exact Poisson interval [Garwood 1936]."""
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
    """Return {median, low, high, p95, max} of `delay` (runs > 0,), NaN where the fault was missed.

    A missed run is later than all others: quantiles that reach it are inf, also the median of an even number where the
    later of the middle two is missed. `low` and `high` bound the median by order statistics, `max` is the largest of
    the detected ones, NaN without any.
    """
    delay = np.asarray(delay, float)
    n, seen = len(delay), delay[np.isfinite(delay)]
    ordered = np.sort(np.where(np.isfinite(delay), delay, np.inf))
    j = int(stats.binom.ppf((1.0 - confidence) / 2.0, n, 0.5))  # the extremes where n is small
    at = {"low": max(j - 1, 0), "high": min(n - j, n - 1), "p95": math.ceil(0.95 * n) - 1}
    median = float(0.5 * (ordered[(n - 1) // 2] + ordered[n // 2]))
    largest = float(np.max(seen)) if len(seen) else math.nan
    return {"median": median, **{name: float(ordered[i]) for name, i in at.items()}, "max": largest}


@dataclass(frozen=True)
class Pod:
    """What a sample says: a90 with its bounds (low, a90_95), in the unit of the sizes; None: `note` says why.

    `coefficients` (b0, b1) and their `covariance` ((b0 b0, b0 b1), (b1 b0, b1 b1)) of ln a in the sizes' unit; None
    without a curve.
    """

    n: int
    seen: int
    a90: float | None = None
    low: float | None = None
    a90_95: float | None = None
    note: str = ""
    coefficients: tuple[float, float] | None = None
    covariance: tuple[tuple[float, float], tuple[float, float]] | None = None

    def at(self, size: ArrayLike, confidence: float = 0.95) -> tuple[NDArray, NDArray, NDArray]:
        """Return (POD, lower, upper bound), each (n,), at `size` (n,), above 0; each bound holds with `confidence`.
        Raises ValueError without a curve."""
        if self.coefficients is None or self.covariance is None:
            raise ValueError(f"no curve: {self.note}")
        x, z = np.log(np.asarray(size, float)), float(stats.norm.ppf(confidence))
        bounds = (predictor(x, self.coefficients, np.array(self.covariance), sign * z) for sign in (0.0, -1.0, 1.0))
        return tuple(map(special.expit, bounds))  # type: ignore[return-value]


def predictor(x: Any, b: Any, cov: NDArray, z: float) -> Any:
    """Return b0 + b1 x and `z` of its standard deviations (delta method), at x = ln a."""
    return b[0] + b[1] * x + z * np.sqrt(cov[0, 0] + 2.0 * x * cov[0, 1] + x * x * cov[1, 1])


def fit(size: ArrayLike, seen: ArrayLike, share: float = 0.9, confidence: float = 0.95) -> Pod:
    """Return the Pod of flights with `size` (n,), above 0, and `seen` (n,), bool.

    There is no curve where all or none are seen, or where one size parts the seen from the missed: then the note says
    between which sizes the answer lies. Nothing is said beyond the sizes that were flown: a90 or a bound that the curve
    would only reach there is None, and the note says on which side it lies.
    """
    a, y = np.asarray(size, float), np.asarray(seen, bool)
    n, k = len(a), int(np.sum(y))
    if n < LEAST:
        return Pod(n, k, note="too few flights")
    least, most = number(a.min(), 2), number(a.max(), 2)
    if k in (0, n):
        return Pod(n, k, note=f"all seen from {least}" if k else f"none seen up to {most}")
    if a[~y].max() <= a[y].min():  # also where both are found at one size alone: the likelihood has no maximum
        return Pod(n, k, note=f"between {number(a[~y].max(), 2)} and {number(a[y].min(), 2)}")
    b, cov = logistic(np.log(a), y)
    if not (np.isfinite(cov).all() and b[1] > 0.0):
        return Pod(n, k, note="does not grow with size")
    curve: dict[str, Any] = {"coefficients": tuple(b.tolist()), "covariance": tuple(map(tuple, cov.tolist()))}
    wanted, z = special.logit(share), float(stats.norm.ppf(confidence))
    at, first, last = (wanted - b[0]) / b[1], math.log(a.min()), math.log(a.max())
    if not first <= at <= last:
        return Pod(n, k, note=f"beyond {most}" if at > last else f"below {least}", **curve)

    def bound(side: float, end: float) -> float | None:
        off = lambda x: predictor(x, b, cov, side * z) - wanted  # noqa: E731
        return None if side * off(end) >= 0.0 else math.exp(brentq(off, *sorted((at, end))))

    low, high = bound(1.0, first), bound(-1.0, last)
    return Pod(n, k, math.exp(at), low, high, "" if high is not None else f"bound beyond {most}", **curve)


def logistic(x: NDArray, y: NDArray[np.bool_]) -> tuple[NDArray, NDArray]:
    """Return coefficients (2,) and covariance (2, 2) of P(y) = 1 / (1 + exp(-(b0 + b1 x))) by maximum likelihood.

    Newton's method: b <- b + I^-1 X' (y - p) with the information I = X' diag(p (1 - p)) X, whose inverse is the
    covariance; it ends where the deviance settles, or after STEPS for a sample that is nearly parted, whose covariance
    is large. NaN where I is singular. `x` and `y` (n,).
    """
    design, b, before = np.column_stack([np.ones_like(x), x]), np.zeros(2), math.inf
    for _ in range(STEPS):
        p = special.expit(design @ b)
        information = design.T @ (design * (p * (1.0 - p))[:, None])
        deviance = -2.0 * float(np.sum(special.log_expit(np.where(y, 1.0, -1.0) * (design @ b))))
        if np.linalg.cond(information) > SINGULAR:
            return np.full(2, math.nan), np.full((2, 2), math.nan)
        if abs(before - deviance) <= SETTLED * (1.0 + deviance):
            break
        b, before = b + np.linalg.solve(information, design.T @ (y - p)), deviance
    return b, np.linalg.inv(information)
