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
    for key in table:
        if key not in KEYS:
            raise CampaignError(
                f"unknown key {key!r}", place=place, allowed=", ".join(KEYS), remedy=did_you_mean(key, KEYS)
            )
    if "choice" in table:
        if len(table) > 1 or not isinstance(table["choice"], list) or not table["choice"]:
            raise CampaignError("choice is a list with something in it, and stands alone", place=place)
        return Draw(choice=tuple(table["choice"]))
    for key in ("low", "high", "mean", "sigma"):
        value = table.get(key, 0.0)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise CampaignError(f"{key} = {value!r} is no number", place=place)
    if not isinstance(table.get("integer", False), bool) or not isinstance(table.get("scale", ""), str):
        raise CampaignError("integer is true or false, scale a word", place=place)
    made = Draw(**table)
    normal = {"mean", "sigma"} & set(table)
    if normal and (len(normal) < 2 or made.sigma <= 0.0 or made.integer or made.scale != "linear"):
        raise CampaignError("a normal distribution has mean and sigma above 0, perhaps low and high", place=place)
    if not normal and not {"low", "high"} <= set(table):
        raise CampaignError("says neither low and high, nor mean and sigma, nor choice", place=place)
    if made.low >= made.high:
        raise CampaignError(f"low = {made.low:g} is not below high = {made.high:g}", place=place)
    if max(abs(made.low), abs(made.high)) > 1e15 and not normal:
        raise CampaignError(f"low = {made.low:g} and high = {made.high:g} are beyond what can be drawn", place=place,
                            allowed="-1e15 to 1e15")
    if made.scale not in ("linear", "log"):
        raise CampaignError(f"unknown scale {made.scale!r}", place=place, allowed="linear, log")
    if made.scale == "log" and made.low <= 0.0:
        raise CampaignError(f"low = {made.low:g} has no logarithm", place=place, allowed="above 0")
    if made.integer and any(x != int(x) for x in (made.low, made.high)):
        raise CampaignError("low and high of a whole number are whole", place=place)
    return made


def unit_cube(n: int, d: int, *, sampling: str, seed: int) -> np.ndarray:
    """Return (n, d) points in [0, 1): independent, or a Latin hypercube (every column hits each n-th part once)."""
    rng = np.random.default_rng(seed)
    if sampling == "latin_hypercube":
        from scipy.stats import qmc  # a second, as above

        return qmc.LatinHypercube(d, seed=rng).random(n)
    return rng.random((n, d))
