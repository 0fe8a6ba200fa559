"""The sensors' noise: drawn in blocks of ticks, so that a tick costs one copy."""

from typing import Any

import numpy as np

TICKS = 1000  # of a block


class Draw:
    """Draw standard normal noise, one number per lane and tick."""

    def __init__(self, rng: np.random.Generator, lanes: Any):
        self._rng, self._block = rng, np.zeros((TICKS, lanes))

    def tell(self, tape: Any, to: np.ndarray) -> None:
        """Tell a tape to put each tick's numbers at the positions `to` of the bus."""
        tape.first(self._next)
        tape.noise(to, self._block)

    def _next(self, k):
        if k % TICKS == 0:
            self._rng.standard_normal(out=self._block)
