"""Map from the unit cube to the flights of a campaign file, for any sampler.

space = Space(load_campaign("fault-free"))
space(u)                     # the Scenario at u (size,) in [0, 1): grid keys, draws, seed, in this order
space.number(17)             # flight 17 of as many as one wants: it does not depend on how many are flown
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.campaign.spec import Campaign, scenario_of
from cosim.errors import CampaignError, did_you_mean
from cosim.scenario import Scenario
from fdi.registry import SHIPPED


def shipped(name: str, more: Sequence[str] = (), remedy: str = "") -> None:
    """Raise CampaignError, which allows `more`, too, where no detector of this name ships."""
    if name not in SHIPPED:
        near = remedy or did_you_mean(name, SHIPPED)
        raise CampaignError(f"{name!r} is no detector", allowed=", ".join((*SHIPPED, *more)), remedy=near)


class Space:
    """The flights of one campaign, or of its part; seeds are `seeds` from `first_seed` on, `detectors` alone fly."""

    def __init__(
        self, campaign: Campaign, *, first_seed: int, seeds: int = 100_000, detectors: Sequence[str] | None = None,
        part: str = "",
    ):  # fmt: skip
        """Raises CampaignError for a campaign with several parts of which `part` is none."""
        chosen = [p for p in campaign.parts if part in ("", p.name)]
        if len(chosen) != 1:
            names = ", ".join(p.name for p in campaign.parts if p.name)
            told = f"has no part {part!r}" if part else "has parts"
            raise CampaignError(
                told, place=campaign.name, allowed=names, remedy="Name one of them, or take a campaign without [[part]]"
            )
        self.campaign, self.part, self.detectors = campaign, chosen[0], detectors
        self.first_seed, self.seeds = first_seed, seeds
        drawn = enumerate(self.part.draw.items(), start=len(self.part.grid))
        self.normal = {i: (key, one) for i, (key, one) in drawn if not math.isnan(one.mean)}  # coordinate: (key, Draw)
        self.size = len(self.part.grid) + len(self.part.draw) + 1
        self.faults = bool(self(np.full(self.size, 0.5)).faults)

    def __call__(self, u: ArrayLike) -> Scenario:
        """Return the Scenario at u (size,)."""
        at = np.clip(np.asarray(u, float), 0.0, np.nextafter(1.0, 0.0))
        return self._scenario(at, self.first_seed + int(at[-1] * self.seeds))

    def number(self, n: int) -> Scenario:
        """Return flight `n` >= 0 of an endless campaign: the grid in turn, draws and seed its own."""
        u = np.random.default_rng([self.campaign.seed, n]).random(self.size)
        left = n
        for i, values in reversed(list(enumerate(self.part.grid.values()))):
            left, k = divmod(left, len(values))
            u[i] = (k + 0.5) / len(values)
        return self._scenario(u, self.first_seed + n)

    def sigmas(self, u: NDArray) -> dict[int, float]:
        """Return {coordinate: (value - mean) / sigma} of every normal draw."""
        return {i: (one(u[i]) - one.mean) / one.sigma for i, (_, one) in self.normal.items()}

    def log_likelihood(self, u: NDArray) -> float:
        """Return the log of the density of the draws at u over its largest: minus half the sum of squared sigmas."""
        return -0.5 * sum(z * z for z in self.sigmas(u).values())

    def away(self, u: NDArray) -> dict[str, float]:
        """Return {key: sigmas} of the normal draws that are away from their means, the farthest first."""
        found = {self.normal[i][0]: z for i, z in self.sigmas(u).items() if abs(z) > 0.05}
        return dict(sorted(found.items(), key=lambda pair: -abs(pair[1])))

    def nearer(self, u: NDArray, which: Sequence[int], factor: float) -> NDArray:
        """Return u with the normal draws `which` at `factor` times their distance from the mean."""
        out, z = np.array(u, float), self.sigmas(u)
        for i in which:
            out[i] = self.normal[i][1].quantile(self.normal[i][1].mean + factor * z[i] * self.normal[i][1].sigma)
        return out

    def _scenario(self, u, seed):
        keys = {key: values[int(q * len(values))] for (key, values), q in zip(self.part.grid.items(), u)}
        keys |= {key: draw(q) for (key, draw), q in zip(self.part.draw.items(), u[len(self.part.grid) :])}
        place = f"{self.campaign.name}, a flight"
        scenario, _ = scenario_of(self.part, {**keys, "seed": seed}, place)
        if self.detectors is None:
            return scenario
        alone = scenario.detectors.model_copy(update={"enabled": tuple(self.detectors)})
        return scenario.model_copy(update={"detectors": alone})
