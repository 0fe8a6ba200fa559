"""Tape: the table of what a tick does, which one compiled function executes.

A part of a tick is either a segment, rows of eight whole numbers that say what to do at which addresses, or a call of
Python, which gets the tick. `walk` does the rows and says what each of them means. Every array whose address is in a
row is kept by the tape.
"""

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.block import Entry
from actuators.kernels import NOTHING, Native
from cosim.flight.plant.jsbsim_signals import last_step

CLOCK, COPY, ADD, TRUTH, TABLE, STEP, SCATTER, GET, PUT = range(9)  # operations of rows
WIDTH = 8  # whole numbers of a row


def _walk():
    """Return what Numba compiles; only that imports Numba."""
    from actuators import numba_intrinsics

    native: Any = numba_intrinsics  # Numba gives them the context
    float64_at, int64_at, store = native.float64_at, native.int64_at, native.store_float64

    def walk(table, n, bus, nothing, k):
        """Do the `n` rows at address `table` on the bus vector at address `bus` for tick k.

        `nothing` is the address where a block would put its result and its exception.
        """
        v = float64_at(bus)
        for i in range(n):
            row = int64_at(table + 8 * WIDTH * i)
            operation, a = row[0], row[1]
            if operation == STEP:
                if k % row[7] == 0:
                    dt = float64_at(row[5])[0]
                    native.call(a, (nothing, nothing, row[2], row[3], row[4], dt, row[6], 1, 0))
            elif operation == COPY:
                to, source = int64_at(row[2]), int64_at(row[3])
                for j in range(a):
                    v[to[j]] = v[source[j]]
            elif operation == TABLE:
                to, held = int64_at(row[2]), float64_at(row[3] + 8 * a * (k % row[4]))
                vector = float64_at(row[5])
                for j in range(a):
                    vector[to[j]] = held[j]
            elif operation == ADD:
                clear, to, source = int64_at(row[2]), int64_at(row[4]), int64_at(row[5])
                for j in range(a):
                    v[clear[j]] = 0.0
                for j in range(row[3]):
                    v[to[j]] += v[source[j]]
            elif operation == GET:
                nodes, units, out = int64_at(row[2]), float64_at(row[4]), float64_at(row[5])
                for j in range(a):
                    out[j] = native.call_float64(row[3], (nodes[j],)) * units[j]
            elif operation == PUT:
                nodes, units, values = int64_at(row[2]), float64_at(row[4]), float64_at(row[5])
                for j in range(a):
                    native.call(row[3], (nodes[j], values[j] / units[j]))
            elif operation == TRUTH:
                frame = float64_at(row[3])
                last_step(float64_at(row[2]), a, frame[0], frame[1], frame[2])
            elif operation == SCATTER:
                wanted, at = int64_at(row[2]), int64_at(row[3])
                if k % row[6] == 0:
                    base = row[4] + row[5] * (k // row[6] % row[7])
                    for j in range(a):
                        store(base + at[j], v[wanted[j]])
                at[a] = k + 1
            elif operation == CLOCK:
                v[a] = k * float64_at(row[2])[0]

    return walk


WALK = Native(f"{__name__}:WALK", (ctypes.c_int64,) * 5, _walk, last_step)


class Block:
    """A block in the loop: its module's `rollout` on its lanes in the bus; `advance()` steps every lane by one of its
    ticks, in place."""

    def __init__(
        self, bus: Any, name: str, module: Any, p: np.ndarray, x0: np.ndarray, dt: float, rollout: Any, every: int = 1
    ):
        self.name, self.module, self.p, self.every, self.dt = name, module, p, every, dt * every
        self.rollout = rollout
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

    def call(self, *functions: Callable[..., Any]) -> None:
        """Call each `function(k)` in Python."""
        if functions:
            self._cut()
        self.parts.extend(functions)

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

    def truth(self, out: np.ndarray, frame: np.ndarray) -> None:
        """Give the truth `out` its last step to SI; `frame` (3,) as `last_step` takes it."""
        self._row(TRUTH, len(out), self._at(out), self._at(frame))

    def get(self, nodes: np.ndarray, getter: int, units: np.ndarray, out: np.ndarray) -> None:
        """out = what the getter at an address gives for each of the nodes, times its unit."""
        self._row(GET, len(nodes), self._at(nodes), getter, self._at(units), self._at(out))

    def put(self, nodes: np.ndarray, setter: int, units: np.ndarray, values: np.ndarray) -> None:
        """Give each of the nodes its value over its unit by the setter at an address."""
        self._row(PUT, len(nodes), self._at(nodes), setter, self._at(units), self._at(values))

    def table(self, to: Any = (), rows: Any = (), vector: np.ndarray | None = None) -> None:
        """vector[to] = rows[k], from the first row again after the last; in the bus or another vector."""
        if len(to):
            into = self.v if vector is None else vector
            self._row(TABLE, len(to), self._at(to), self._at(rows), len(rows), self._at(into))

    def step(self, block: Any) -> None:
        """Advance every lane of a block by one tick, every `block.every` ticks; blocks in Python advance themselves."""
        if not isinstance(block.rollout, Entry):
            self.call(lambda k: block.advance() if k % block.every == 0 else None)
        elif len(block.x):
            self._kept.append(block.rollout)
            arrays = map(self._at, (block.x, block.u, block.p, np.array([block.dt])))
            self._row(STEP, block.rollout.native.address, *arrays, len(block.x), block.every)

    def keep(self, index: np.ndarray, rows: np.ndarray) -> None:
        """rows[k % len(rows)] = v[index]; `rows` are doubles (some ticks, n)."""
        self.scatter(index, 8 * np.arange(len(index) + 1), rows.view(np.uint8), 1)

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
            given = self._at(table), len(table), self._at(self.v), NOTHING[0]
            self.parts.append(functools.partial(WALK.call, *given))
