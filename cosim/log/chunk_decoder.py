"""Chunk decoder: check the messages of a chunk and place their values in one pass, compiled; `Plan.gather` in
cosim/log/chunk.py lays out the `table` that this reads.
"""

from typing import Any

from numba import njit

from actuators import numba_intrinsics
from actuators.numba_intrinsics import reals, wholes
from cosim.log.message_layout import ABOUT, HEAD, MIDDLE, SHORT

HEAD_BYTES = HEAD.itemsize
byte: Any = numba_intrinsics.byte  # Numba gives them the context
pair: Any = numba_intrinsics.pair
quad: Any = numba_intrinsics.quad
word: Any = numba_intrinsics.word
real: Any = numba_intrinsics.real


def gather(table: int, n: int, content: int, k0: int, dt_ns: int, wrong: int) -> None:
    """Count in the whole number at `wrong` the messages of a chunk of ticks from `k0` that are not as they must be.

    The `n` rows of `table` say of each topic: start, bytes from message to message, messages, fields, tick of the
    first after k0, every; the first eight bytes of a message, and the last four before its times; the address for its
    values, and the messages low <= i < high whose values go there.
    """
    bad = 0
    for i in range(n):
        about = wholes(table + 8 * ABOUT * i)
        at, k = content + about[0], k0 + about[4]
        fields, low, high = about[3], about[9], about[10]
        for row in range(about[2]):
            odd = (word(at) ^ about[6]) | (quad(at + 7) ^ about[7]) | (quad(at + 11) ^ (k & 0xFFFFFFFF))
            odd |= (word(at + 15) ^ (k * dt_ns)) | (word(at + 23) ^ (k * dt_ns))
            here = at + HEAD_BYTES
            wanted = low <= row < high
            out = reals(about[8] + 8 * fields * (row - low))
            for j in range(min(fields, SHORT)):
                odd |= byte(here) ^ (8 * (j + 1) | 1)
                if wanted:
                    out[j] = real(here + 1)
                here += 9
            for j in range(SHORT, min(fields, MIDDLE)):
                odd |= pair(here) ^ _two(j + 1)
                if wanted:
                    out[j] = real(here + 2)
                here += 10
            for j in range(MIDDLE, fields):
                odd |= (pair(here) ^ (_two(j + 1) & 0x7FFF | 0x8000)) | (byte(here + 2) ^ (j + 1) >> 11)
                if wanted:
                    out[j] = real(here + 3)
                here += 11
            bad += odd != 0
            at += about[1]
            k += about[5]
    wholes(wrong)[0] = bad


@njit(error_model="numpy")
def _two(number):
    """Return the first two bytes of a field's tag, little endian, as if there were no third; see `empty_message`."""
    return (8 * number & 0x7F) | 0x81 | (number >> 4) << 8
