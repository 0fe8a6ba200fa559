"""Row writer: put a row of a log where it will stand in its chunk, compiled; `LogWriter` lays out the `head` that this
reads."""

from typing import Any

from numba import njit

from actuators import numba_intrinsics
from actuators.numba_intrinsics import reals, wholes
from cosim.log.message_layout import HEAD, LOG_TIME, MIDDLE, PUBLISH_TIME, SEQUENCE, SHORT, STORE_HEAD, STORE_TARGET

HEAD_BYTES = HEAD.itemsize
put: Any = numba_intrinsics.put  # Numba gives them the context
lay_quad: Any = numba_intrinsics.lay_quad
lay_word: Any = numba_intrinsics.lay_word


@njit(error_model="numpy")
def store(address: Any, bus: Any) -> None:
    """Store what the head at `address` asks for of the vector at `bus`, and count the row."""
    head, v = wholes(address), reals(bus)
    row, tick = head[0], head[1] + head[0]
    ns = tick * head[4]
    for i in range(head[3]):
        about = wholes(address + 8 * (STORE_HEAD + STORE_TARGET * i))
        every, first, topics = about[0], about[1], about[5]
        if row < first or (row - first) % every:
            continue
        below, taken, take = (row - first) // every, 0, wholes(about[3])
        if topics == 0:  # numbers side by side
            for j in range(about[2]):
                put(about[4] + 8 * (below * about[2] + j), v[take[j]])
        for j in range(topics):
            topic = wholes(about[6] + 24 * j)
            here, fields = about[4] + topic[0] + below * topic[1], topic[2]
            lay_quad(here + SEQUENCE, tick)
            lay_word(here + LOG_TIME, ns)
            lay_word(here + PUBLISH_TIME, ns)
            here += HEAD_BYTES + 1
            for m in range(taken, taken + min(fields, SHORT)):
                put(here, v[take[m]])
                here += 9
            here += 1
            for m in range(taken + SHORT, taken + min(fields, MIDDLE)):
                put(here, v[take[m]])
                here += 10
            here += 1
            for m in range(taken + MIDDLE, taken + fields):
                put(here, v[take[m]])
                here += 11
            taken += fields
    head[0] = row + 1
