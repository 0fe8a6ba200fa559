"""Scenarios of a campaign as compressed pickles: 3 kB each in place of 38, and what a worker gets."""

import pickle
import zlib
from collections.abc import Iterable, Sequence
from typing import NamedTuple, overload

from cosim.scenario import Scenario


class Pickled(NamedTuple):
    """A scenario: its seed, by which runs are grouped, and the whole as a compressed pickle."""

    seed: int
    data: bytes

    def scenario(self) -> Scenario:
        """Return the Scenario."""
        return pickle.loads(zlib.decompress(self.data))


class Packed(Sequence[Scenario]):
    """A sequence of scenarios, each made anew when it is asked for; `held` are their Pickled."""

    def __init__(self, scenarios: Iterable[Scenario] = ()):
        self.held: list[Pickled] = []
        for scenario in scenarios:
            self.append(scenario)

    def append(self, scenario: Scenario) -> None:
        """Take one more."""
        self.held.append(Pickled(scenario.seed, zlib.compress(pickle.dumps(scenario), 1)))

    def __len__(self) -> int:
        return len(self.held)

    @overload
    def __getitem__(self, i: int) -> Scenario: ...
    @overload
    def __getitem__(self, i: slice) -> list[Scenario]: ...
    def __getitem__(self, i):
        return [p.scenario() for p in self.held[i]] if isinstance(i, slice) else self.held[i].scenario()
