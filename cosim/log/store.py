"""Put a row of a log where it will stand in its chunk, compiled; `LogWriter` lays out the `head` that this reads."""

from typing import Any

from numba import njit, types

from actuators import pointers
from actuators.pointers import reals, wholes

KINDS = (types.int64, types.int64)
put: Any = pointers.put  # Numba gives it the context


@njit(error_model="numpy")
def store(address: Any, bus: Any) -> None:
    """Store what the head at `address` asks for of the vector at `bus`, and count the row."""
    head, v = wholes(address), reals(bus)
    row, n = head[0], head[3]
    for i in range(n):
        about = wholes(address + 8 * (4 + 7 * i))
        every, first, count = about[0], about[1], about[2]
        if row < first or (row - first) % every:
            continue
        take, base, offsets, strides = wholes(about[3]), about[4], wholes(about[5]), wholes(about[6])
        k = (row - first) // every
        for j in range(count):
            put(base + offsets[j] + k * strides[j], v[take[j]])
    head[0] = row + 1


def entry(address: Any, bus: Any) -> None:
    """Call `store`."""
    store(address, bus)
