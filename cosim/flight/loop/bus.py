"""The bus: one float64 vector that holds everything of one tick, and typed views of it for the blocks.

Every block's inputs and states are sections of the vector. A section has lanes (one per actuator, sensor, fault, ...).
Wiring is a list of (destination, source) names, turned into index arrays; the log writes any selection of positions. So
nothing of a tick can escape the log, and a detector can only read what is wired to it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim.errors import ScenarioError, among
from cosim.scenario import vocabulary


def place(name: str) -> str:
    """Return `section.lane.field` of a word of `cosim list signals`, such as "n_z" or "left_inner.rod"; any other name
    as it is. Raises ScenarioError for a word of an elevator segment without the segment."""
    if name.count(".") > 1:  # "hinge_model.left_inner.hm0" ends in a word, and is none
        return name
    try:
        found = vocabulary.find(name)
    except KeyError:
        return name
    if found.technologies and "." not in name:
        raise ScenarioError(f"{name!r} is a signal of each elevator segment", remedy=f"Name one: left_inner.{name}")
    return found.source


class Bus:
    """Lay sections out in one vector; give views, positions and wires by name.

    `sections` is a list of (name, dtype, lanes): dtype of a block (every element f8), lanes a tuple of lane names.
    """

    def __init__(self, sections: Any):
        self.kinds: dict[str, np.dtype] = {}
        self.lanes: dict[str, tuple] = {}
        self._start: dict[str, int] = {}
        n = 0
        for name, kind, lanes in sections:
            if name in self.kinds:
                raise ScenarioError("is a name of the loop's own", place=name, remedy="Choose another id")
            self.kinds[name], self.lanes[name], self._start[name] = kind, tuple(lanes), n
            n += kind.itemsize // 8 * len(lanes)
        self._positions: dict[tuple[str, str], dict[str, int]] = {}  # {(section, lane): {field: position}}
        self.v = np.zeros(n)

    def __getitem__(self, name):
        """Return the typed view of a section, shape (lanes,)."""
        kind, start = self.kinds[name], self._start[name]
        return self.v[start : start + kind.itemsize // 8 * len(self.lanes[name])].view(kind)

    def index(self, name: str) -> int:
        """Return the position of a signal: `section.lane.field`, an element of an array field as `field[3]`, or a word
        (`place`). Raises ScenarioError for what is not there."""
        section, _, rest = place(name).partition(".")
        lane, _, field = rest.partition(".")
        said = f"no signal {name!r}"
        among(section, self.lanes, said)
        among(lane, self.lanes[section], said)
        if (section, lane) not in self._positions:
            self._positions[section, lane] = dict(self.columns(section, lane))
        among(field, self._positions[section, lane], said)
        return self._positions[section, lane][field]

    def columns(self, section: str, lane: str, fields: Any = None) -> list:
        """Return [(name, position)] of a lane's elements in memory order, of `fields` only when given."""
        kind = self.kinds[section]
        every = vocabulary.elements(kind, kind.names or ())
        first = self._start[section] + self.lanes[section].index(lane) * len(every)
        return [(name, first + i) for i, name in enumerate(every) if fields is None or name.split("[")[0] in fields]

    def wires(self, pairs: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
        """Compile [(destination path, source path)] to two index arrays."""
        to = np.array([self.index(d) for d, _ in pairs], np.int64)
        source = np.array([self.index(s) for _, s in pairs], np.int64)
        return to, source
