"""Probability of detection over size: how large an oscillation must be so that 90 % are seen, at 95 % confidence.

POD(a) = 1 / (1 + exp(-(b0 + b1 ln a))), fitted by binomial regression over all flights, seen and missed. a90 is where
the curve reaches 0.9, a90/95 where its lower 95 % confidence bound does: larger ones are seen in nine of ten flights,
and only one sample in twenty would have made it too small (MIL-HDBK-1823A).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats
from scipy.optimize import brentq

from cosim.table import number

LEAST = 12  # flights, below which no curve is fitted
STEPS = 100  # of Newton's method; a sample that overlaps needs fewer than ten
SETTLED = 1e-12  # relative change of the deviance at which it ends
SINGULAR = 1e14  # condition number of the information, beyond which its inverse has no correct digit


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
