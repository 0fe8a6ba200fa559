"""Distributions of a campaign's numbers: a point of the unit cube becomes a value, so that any sampler serves.

{ low = 1.0, high = 2.0 }                 uniform; with scale = "log" uniform in the logarithm
{ low = 1, high = 6, integer = true }     whole numbers, both ends included
{ mean = 1.0, sigma = 0.02 }              normal; low and high truncate it
{ choice = ["a", "b", "c"] }              any of these; a table sets several keys at once
{ choice = "points.csv" }                 any row of a file beside the campaign's, its columns are keys
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.errors import CampaignError, did_you_mean

MOST = 1e15  # beyond it a number has no digits behind its point
KEYS = ("low", "high", "scale", "integer", "mean", "sigma", "choice")


@dataclass(frozen=True)
class Draw:
    """One number (or word, or set of keys) that a campaign draws."""

    low: float = -math.inf
    high: float = math.inf
    scale: str = "linear"
    integer: bool = False
    mean: float = math.nan  # NaN: not normal
    sigma: float = math.nan
    choice: tuple[Any, ...] = ()

    def __call__(self, u: Any) -> Any:
        """Return the value at quantile u in [0, 1)."""
        if self.choice:
            return self.choice[int(u * len(self.choice))]
        if self.integer:
            return int(self.low) + int(u * (int(self.high) - int(self.low) + 1))
        if not math.isnan(self.mean):
            from scipy.special import ndtr, ndtri  # a tenth of a second: `cosim list` reads campaigns, too

            a, b = (float(ndtr((x - self.mean) / self.sigma)) for x in (self.low, self.high))
            return float(self.mean + self.sigma * ndtri(a + u * (b - a)))
        if self.scale == "log":
            return float(self.low * (self.high / self.low) ** u)
        return float(self.low + u * (self.high - self.low))


def draw(table: dict, place: str) -> Draw:
    """Return the Draw of a table of the campaign file; raises CampaignError that says what is wrong at `place`."""
    if not isinstance(table, dict):
        raise CampaignError("is no distribution", place=place, allowed=f"a table of {', '.join(KEYS)}")
    for key in (key for key in table if key not in KEYS):
        near = did_you_mean(key, KEYS)
        raise CampaignError(f"unknown key {key!r}", place=place, allowed=", ".join(KEYS), remedy=near)
    if said := _wrong(table):
        raise CampaignError(said, place=place)
    values: dict[str, Any] = {key: tuple(value) if key == "choice" else value for key, value in table.items()}
    return Draw(**values)


def _wrong(table):
    """Return what is wrong with a table of known keys, "" where nothing is."""
    if "choice" in table:
        wrong = len(table) > 1 or not isinstance(table["choice"], list) or not table["choice"]
        return "choice is a list with something in it, and stands alone" * wrong
    numbers = {key: value for key, value in table.items() if key in ("low", "high", "mean", "sigma")}
    for key, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return f"{key} = {value!r} is no number"
    low, high = (numbers.get(key, default) for key, default in (("low", -math.inf), ("high", math.inf)))
    scale, whole = table.get("scale", "linear"), table.get("integer", False)
    normal = "mean" in table or "sigma" in table
    refused = (  # in this order
        (not isinstance(whole, bool) or not isinstance(scale, str), "integer is true or false, scale a word"),
        (normal and ({"mean", "sigma"} - set(table) or numbers["sigma"] <= 0.0 or whole or scale != "linear"),
         "a normal distribution has mean and sigma above 0, perhaps low and high"),
        (not normal and not {"low", "high"} <= set(table), "says neither low and high, nor mean and sigma, nor choice"),
        (low >= high, f"low = {low:g} is not below high = {high:g}"),
        (not normal and max(abs(low), abs(high)) > MOST,
         f"low = {low:g} and high = {high:g} are beyond what can be drawn; allowed: {-MOST:g} to {MOST:g}"),
        (scale not in ("linear", "log"), f"unknown scale {scale!r}; allowed: linear, log"),
        (scale == "log" and low <= 0.0, f"low = {low:g} has no logarithm; allowed: above 0"),
        (whole and not normal and any(x % 1 for x in (low, high)), "low and high of a whole number are whole"),
    )  # fmt: skip
    return next((said for wrong, said in refused if wrong), "")


def unit_cube(n: int, d: int, *, sampling: str, seed: int) -> np.ndarray:
    """Return (n, d) points in [0, 1): independent, or a Latin hypercube (every column hits each n-th part once)."""
    rng = np.random.default_rng(seed)
    if sampling == "latin_hypercube":
        from scipy.stats import qmc  # a second, as above

        return qmc.LatinHypercube(d, seed=rng).random(n)
    return rng.random((n, d))
