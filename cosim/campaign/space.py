"""The flights of a campaign file as a space: every point of the unit cube is one of them, so that any sampler serves.

space = Space(load_campaign("fault-free"))
space(u)                     # the Scenario at u (size,) in [0, 1): grid keys, draws, seed, in this order
space.number(17)             # flight 17 of as many as one wants: it does not depend on how many are flown
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cosim.campaign.spec import Campaign, scenario_of
from cosim.campaign.store import CampaignError
from cosim.scenario import Scenario


class Space:
    """The flights of one campaign without parts; seeds are `seeds` from `first_seed` on, `detectors` alone fly."""

    def __init__(
        self, campaign: Campaign, *, first_seed: int, seeds: int = 100_000, detectors: Sequence[str] | None = None
    ):
        """Raises CampaignError for a campaign with parts."""
        if len(campaign.parts) != 1:
            raise CampaignError("has parts", place=campaign.name, remedy="Take a campaign without [[part]]")
        self.campaign, self.part, self.detectors = campaign, campaign.parts[0], detectors
        self.first_seed, self.seeds = first_seed, seeds
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

    def _scenario(self, u, seed):
        keys = {key: values[int(q * len(values))] for (key, values), q in zip(self.part.grid.items(), u)}
        keys |= {key: draw(q) for (key, draw), q in zip(self.part.draw.items(), u[len(self.part.grid) :])}
        scenario, _ = scenario_of(self.part.base, {**keys, "seed": seed}, f"{self.campaign.name}, a flight")
        if self.detectors is None:
            return scenario
        alone = scenario.detectors.model_copy(update={"enabled": tuple(self.detectors)})
        return scenario.model_copy(update={"detectors": alone})
