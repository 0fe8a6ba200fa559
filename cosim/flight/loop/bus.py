"""The bus: one float64 vector that holds everything of one tick, and typed views of it for the blocks.

Every block's inputs and states are sections of the vector. A section has lanes (one per actuator, sensor, fault, ...).
Wiring is a list of (destination, source) names, turned into index arrays; the log writes any selection of positions. So
nothing of a tick can escape the log, and a detector can only read what is wired to it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np


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
                raise ValueError(f"section {name!r} is declared twice")
            self.kinds[name], self.lanes[name], self._start[name] = kind, tuple(lanes), n
            n += kind.itemsize // 8 * len(lanes)
        self._positions: dict[tuple[str, str], dict[str, int]] = {}  # {(section, lane): {field: position}}
        self.v = np.zeros(n)

    def __getitem__(self, name):
        """Return the typed view of a section, shape (lanes,)."""
        kind, start = self.kinds[name], self._start[name]
        return self.v[start : start + kind.itemsize // 8 * len(self.lanes[name])].view(kind)

    def index(self, path: str) -> int:
        """Return the position of `section.lane.field`; an element of an array field is `field[3]`. KeyError names what
        is missing."""
        section, lane, field = path.split(".", 2)
        positions = self._positions.get((section, lane))
        if positions is None:
            positions = self._positions[section, lane] = dict(self.columns(section, lane))
        if field not in positions:
            raise KeyError(f"{path}: no such field; there is {', '.join(positions)}")
        return positions[field]

    def columns(self, section: str, lane: str, fields: Any = None) -> list:
        """Return [(name, position)] of a lane's elements in memory order, of `fields` only when given."""
        kind = self.kinds[section]
        base = self._start[section] + self.lanes[section].index(lane) * (kind.itemsize // 8)
        out = []
        for name in kind.names or ():
            if fields is not None and name not in fields:
                continue
            sub, offset = kind.fields[name][:2]  # type: ignore[index]
            first = base + offset // 8
            out += [(f"{name}[{i}]" if sub.shape else name, first + i) for i in range(sub.itemsize // 8)]
        return out

    def wires(self, pairs: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
        """Compile [(destination path, source path)] to two index arrays."""
        to = np.array([self.index(d) for d, _ in pairs], np.int64)
        source = np.array([self.index(s) for _, s in pairs], np.int64)
        return to, source
