"""Distributions of a campaign's numbers: a point of the unit cube becomes a value, so that any sampler serves.

{ low = 1.0, high = 2.0 }                 uniform; with scale = "log" uniform in the logarithm
{ low = 1, high = 6, integer = true }     whole numbers, both ends included
{ mean = 1.0, sigma = 0.02 }              normal; low and high truncate it
{ choice = ["a", "b", "c"] }              any of these; a table sets several keys at once
{ choice = "points.csv" }                 any row of a file beside the campaign's, its columns are keys
"""

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo

from cosim.scenario.problem import Problems, Table, within

MOST = 1e15  # beyond it a number has no digits behind its point
Bound = Annotated[float, within(-MOST, MOST)]


class Draw(Table):
    """One number (or word, or set of keys) that a campaign draws."""

    low: Bound | None = None
    high: Bound | None = None
    scale: Literal["linear", "log"] = "linear"
    integer: bool = False
    mean: float | None = None
    sigma: float | None = None
    choice: Annotated[list[Any] | str, Field(min_length=1)] | None = None

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that it says one distribution."""
        given, numbers = self.model_fields_set, {"low", "high"} & self.model_fields_set
        low, high, whole = self.low or 0.0, self.high or 0.0, self.integer
        normal = given & {"mean", "sigma"}
        refused = (  # in this order
            (self.choice and len(given) > 1, "choice stands alone"),
            (normal and (len(normal) < 2 or (self.sigma or 0.0) <= 0.0 or given - normal - numbers),
             "a normal distribution has mean and sigma above 0, perhaps low and high"),
            (not self.choice and not normal and len(numbers) < 2,
             "says neither low and high, nor mean and sigma, nor choice"),
            (len(numbers) == 2 and low >= high, f"low = {low:g} is not below high = {high:g}"),
            (self.scale == "log" and low <= 0.0, f"low = {low:g} has no logarithm; allowed: above 0"),
            (whole and (low % 1 or high % 1), "low and high of a whole number are whole"),
        )  # fmt: skip
        if said := next((said for is_wrong, said in refused if is_wrong), ""):
            wrong.add(said)

    def __call__(self, u: Any) -> Any:
        """Return the value at quantile u in [0, 1)."""
        if self.choice:
            return self.choice[int(u * len(self.choice))]
        low, high = (default if x is None else x for x, default in ((self.low, -math.inf), (self.high, math.inf)))
        if self.mean is not None and self.sigma is not None:
            from scipy.special import ndtr, ndtri  # a tenth of a second: `cosim list` reads campaigns, too

            a, b = (float(ndtr((x - self.mean) / self.sigma)) for x in (low, high))
            return float(self.mean + self.sigma * ndtri(a + u * (b - a)))
        if self.integer:
            return int(low) + int(u * (int(high) - int(low) + 1))
        if self.scale == "log":
            return float(low * (high / low) ** u)
        return float(low + u * (high - low))


def unit_cube(n: int, d: int, *, sampling: str, seed: int) -> np.ndarray:
    """Return (n, d) points in [0, 1): independent, or a Latin hypercube (every column hits each n-th part once)."""
    rng = np.random.default_rng(seed)
    if sampling == "latin_hypercube":
        from scipy.stats import qmc  # a second, as above

        return qmc.LatinHypercube(d, seed=rng).random(n)
    return rng.random((n, d))
