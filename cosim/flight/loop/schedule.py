"""Schedule of a tick: a table of steps that one compiled function executes.

A part of a tick is either a segment, rows of eight whole numbers that say what to do at which addresses, or a call of
Python, which gets the tick. `walk` in cosim/flight/loop/schedule_kernel.py does the rows and says what each of them
means. Every array whose address is in a row is kept by the tape.
"""

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from actuators.block import Entry
from actuators.kernels import Native
from cosim.flight.loop.operations import ADD, CLOCK, COPY, GET, KEEP, NOISE, PUT, SCALE, SCATTER, STEP, TRUTH, WIDTH

LOOP = Path(__file__).parent
SOURCES = LOOP / "schedule_kernel.py", LOOP / "operations.py", LOOP.parent / "plant/jsbsim_signals.py"


def _walk():
    """Return what Numba compiles: it and the kernel are imported only then."""
    from numba import types

    from cosim.flight.loop.schedule_kernel import walk

    return walk, (types.int64,) * 5


WALK = Native(f"{__name__}:WALK", (ctypes.c_int64,) * 5, _walk, *SOURCES)


class Block:
    """A block in the loop: its module's `rollout` on its lanes in the bus; `advance()` steps every lane by one of its
    ticks, in place."""

    def __init__(
        self, bus: Any, name: str, module: Any, p: np.ndarray, x0: np.ndarray, dt: float, every: int = 1,
        rollout: Any = None,
    ):  # fmt: skip
        self.name, self.module, self.p, self.every, self.dt = name, module, p, every, dt * every
        self.rollout = rollout or module.rollout
        self.x, self.u = bus[name], bus[name + "_in"].reshape(-1, 1)
        self.x[:] = x0

    def advance(self) -> None:
        """Advance every lane by `every` ticks."""
        self.rollout(self.x, self.u, self.p, self.dt)


class Tape:
    """Record what a tick does to the bus vector `v` (n,), then `run` it tick by tick."""

    def __init__(self, v: np.ndarray, dt: float):
        self.v, self.dt = v, dt
        self._kept: list[Any] = [v]  # every array, and every block, that a row points to
        self._rows: list[tuple[int, ...]] = []
        self.parts: list[Callable[[int], Any]] = []  # of a tick: callables that take k

    def call(self, function: Callable[..., Any]) -> None:
        """Call `function(k)` in Python."""
        self._cut()
        self.parts.append(function)

    def first(self, function: Callable[..., Any]) -> None:
        """Call `function(k)` in Python before anything else of a tick."""
        self.parts.insert(0, function)

    def clock(self, position: float) -> None:
        """v[position] = k dt."""
        self._row(CLOCK, position, self._at(np.array([self.dt])))

    def copy(self, to: np.ndarray, source: np.ndarray) -> Any:
        """v[to] = v[source], in order."""
        if len(to):
            self._row(COPY, len(to), self._at(to), self._at(source))

    def add(self, clear: np.ndarray, to: np.ndarray, source: np.ndarray) -> None:
        """v[clear] = 0, then v[to] += v[source], in order: several sources may act on one place."""
        if len(clear):
            self._row(ADD, len(clear), self._at(clear), len(to), self._at(to), self._at(source))

    def truth(self, raw: np.ndarray, scale: np.ndarray, start: int, frame: np.ndarray) -> None:
        """v[start:] = truth in SI from JSBSim's own units; `frame` (3,) as `to_si` takes it."""
        self._row(TRUTH, len(raw), self._at(raw), self._at(scale), start, self._at(frame))

    def get(self, nodes: np.ndarray, getter: Any, out: np.ndarray) -> None:
        """out = what the getter at an address gives for each of the nodes (cosim/flight/plant/fast_properties.py)."""
        self._row(GET, len(nodes), self._at(nodes), getter, self._at(out))

    def put(self, nodes: np.ndarray, setter: Any, values: np.ndarray) -> None:
        """Give each of the nodes its value by the setter at an address."""
        self._row(PUT, len(nodes), self._at(nodes), setter, self._at(values))

    def noise(self, to: np.ndarray, block: np.ndarray, vector: np.ndarray | None = None) -> None:
        """vector[to] = block[k % rows], in the bus or another vector."""
        into = self.v if vector is None else vector
        self._row(NOISE, len(to), self._at(to), self._at(block), len(block), self._at(into))

    def scale(self, values: np.ndarray, factors: np.ndarray, divisors: np.ndarray, out: np.ndarray) -> None:
        """out = values * factors / divisors."""
        self._row(SCALE, len(values), *map(self._at, (values, factors, divisors, out)))

    def table(self, to: Any = (), rows: Any = ()) -> None:
        """v[to] = rows[k], from the first row again after the last."""
        if len(to):
            self.noise(to, rows)

    def step(self, block: Any) -> None:
        """Advance every lane of a block by one tick, every `block.every` ticks; blocks in Python advance themselves."""
        entry = block.rollout if isinstance(block, Block) else None
        if not isinstance(entry, Entry):
            self.call(lambda k: block.advance() if k % block.every == 0 else None)
        elif len(block.x):
            self.advance(entry, block.x, block.u, block.p, block.dt, block.every)

    def advance(self, entry: Entry, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, every: int = 1) -> None:
        """Advance the lanes of these arrays by one tick of `dt` [s] every `every` ticks."""
        self._kept.append(entry)
        self._row(STEP, entry.address, *map(self._at, (x, u, p, np.array([dt]))), len(x), every)

    def keep(self, index: np.ndarray, rows: Any) -> None:
        """rows[k % len(rows)] = v[index], in the precision of `rows` (some ticks, n)."""
        self._row(KEEP, len(index), self._at(index), self._at(rows), rows.itemsize, max(1, len(rows)))

    def scatter(self, index: np.ndarray, at: np.ndarray, rows: np.ndarray, every: int) -> None:
        """Every `every` ticks, store v[index] as doubles at the byte offsets at[:-1] of the row k // every % len(rows)
        of bytes; at[-1] = k + 1 at every tick."""
        self._row(SCATTER, len(index), *map(self._at, (index, at, rows)), rows.shape[1], every, len(rows))

    def run(self, k: Any) -> Any:
        """Do all of tick `k`."""
        if self._rows:
            self._cut()
        for part in self.parts:
            part(k)

    def _at(self, array):
        """Return the address of an array without gaps, which is kept from now on."""
        if not array.flags.c_contiguous:
            raise ValueError("a tape points only to arrays without gaps")
        self._kept.append(array)
        return array.ctypes.data

    def _row(self, *values):
        self._rows.append(values + (0,) * (WIDTH - len(values)))

    def _cut(self):
        """End a segment: what follows is Python."""
        if self._rows:
            table = np.array(self._rows, np.int64)
            self._rows = []
            walk, rows, n, v = WALK.call, self._at(table), len(table), self._at(self.v)
            self.parts.append(lambda k: walk(rows, n, v, k, k + 1))
