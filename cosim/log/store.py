"""Put a row of a log where it will stand in its chunk, compiled; `LogWriter` lays out the `head` that this reads."""

from typing import Any

from numba import njit, types

from actuators import pointers
from actuators.pointers import reals, wholes
from cosim.log.chunk import LOG_TIME, PUBLISH_TIME, SEQUENCE, STORE_HEAD, STORE_TARGET

KINDS = (types.int64, types.int64)
put: Any = pointers.put  # Numba gives them the context
lay_quad: Any = pointers.lay_quad
lay_word: Any = pointers.lay_word


@njit(error_model="numpy")
def store(address: Any, bus: Any) -> None:
    """Store what the head at `address` asks for of the vector at `bus`, and count the row."""
    head, v = wholes(address), reals(bus)
    row, n = head[0], head[3]
    for i in range(n):
        about = wholes(address + 8 * (STORE_HEAD + STORE_TARGET * i))
        every, first, count = about[0], about[1], about[2]
        if row < first or (row - first) % every:
            continue
        take, base, offsets, strides = wholes(about[3]), about[4], wholes(about[5]), wholes(about[6])
        starts, lengths = wholes(about[8]), wholes(about[9])
        below = (row - first) // every
        tick = head[1] + row
        ns = tick * head[4]
        for j in range(about[7]):
            here = base + starts[j] + below * lengths[j]
            lay_quad(here + SEQUENCE, tick)
            lay_word(here + LOG_TIME, ns)
            lay_word(here + PUBLISH_TIME, ns)
        for j in range(count):
            put(base + offsets[j] + below * strides[j], v[take[j]])
    head[0] = row + 1


def entry(address: Any, bus: Any) -> None:
    """Call `store`."""
    store(address, bus)
