"""Noise by name: each lane draws from a counter-based generator of its own, in blocks of ticks before they fly.

A lane's numbers depend on the flight's seed and the lane's name alone, so that another sensor, segment or detector
changes no other number. The generator is Philox 4x64, keyed by a hash of both.
"""

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

TICKS = 1000  # of a block: a tick costs one copy


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the generator of what is called `name`, such as "noise.alpha", in the flights of `seed`.

    [Salmon] Parallel random numbers: as easy as 1, 2, 3 (2011): counter-based, independent for different keys.
    """
    key = np.frombuffer(hashlib.sha256(f"{seed}:{name}".encode()).digest()[:16], "<u8").astype(np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


class Draw:
    """Draw standard normal noise, one number per lane and tick."""

    def __init__(self, seed: int, lanes: Sequence[str]):
        """`lanes` are the names of the generators, in the order of the positions that `schedule` takes."""
        self._rng = [generator(seed, lane) for lane in lanes]
        self._block, self._lane = np.zeros((TICKS, len(lanes))), np.zeros(TICKS)

    def schedule(self, tape: Any, to: np.ndarray) -> None:
        """Schedule on a tape to put each tick's numbers at the positions `to` of the bus."""
        tape.first(self._next)
        tape.table(to, self._block)

    def _next(self, k):
        if k % TICKS == 0:
            for i, rng in enumerate(self._rng):
                self._block[:, i] = rng.standard_normal(out=self._lane)
