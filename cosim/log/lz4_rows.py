"""LZ4 encoder of a topic's rows, compiled; `Frame` in cosim/log/frame.py lays out the `table` that this
reads.

The row of a topic is compared with the row before it, eight bytes at a time, and what has stayed the same becomes a
reference to it: tags, heads, numbers that stand still, the upper bytes of those that hardly move. Nothing is searched
for. The format of a block: a byte with the numbers of literal bytes and of bytes referred to (15: more follow), the
literal bytes, two bytes of how far back the reference is; a block ends with literal bytes.
"""

from typing import Any

from numba import njit

from actuators import numba_intrinsics
from actuators.numba_intrinsics import wholes
from cosim.log.message_layout import LOG_TIME, MIDDLE, SEQUENCE, SHORT

LEAST = 5
MATCH, LAST = 4, 12  # of the format: a reference is to four bytes or more, and to none of the last twelve
RAW = 1 << 31  # of the format of a frame: the block that follows is not compressed
byte: Any = numba_intrinsics.byte  # Numba gives them the context
quad: Any = numba_intrinsics.quad
word: Any = numba_intrinsics.word
lay_byte: Any = numba_intrinsics.lay_byte
lay_pair: Any = numba_intrinsics.lay_pair
lay_quad: Any = numba_intrinsics.lay_quad
lay_word: Any = numba_intrinsics.lay_word
leading: Any = numba_intrinsics.leading_zeros


def squeeze(table: int, n: int, content: int, out: int, written: int) -> None:
    """Write to address `out` the blocks of the `n` cuts of the `table`, each behind its size, and to the whole number
    at `written` how many bytes there are.

    A row of the table says of a cut: where it begins in the content, rows, bytes per row (<= 65535), fields. Up to
    seven bytes beyond what is written are overwritten.
    """
    at = out
    for i in range(n):
        cut = wholes(table + 32 * i)
        begin, size = content + cut[0], cut[1] * cut[2]
        end = _block(begin, cut[1], cut[2], cut[3], at + 4)
        if end - at - 4 < size:
            lay_quad(at, end - at - 4)
        else:
            _copy(at + 4, begin, size)
            end = at + 4 + size
            lay_quad(at, size | RAW)
        at = end
    wholes(written)[0] = at - out


@njit(error_model="numpy")
def _block(begin, rows, stride, fields, out):
    """Compress `rows` rows from address `begin` to `out`; return where that ends."""
    fresh, same = begin, begin + stride  # first byte not written yet; first of those that are as in the row before
    for row in range(1, rows):
        at = begin + row * stride
        here = at + SEQUENCE
        odd = quad(here) ^ quad(here - stride)
        if odd != 0:
            if here - same >= LEAST:
                out = _refer(out, fresh, same, here, stride)
                fresh = here
            same = here + 4 - ((leading(odd) - 32) >> 3)
        here = at + LOG_TIME  # -1, 0: the times of the head; from 1 on the fields, each behind its tag
        for j in range(-1, fields + 1):
            odd = word(here) ^ word(here - stride)
            if odd != 0:
                if here - same >= LEAST:
                    out = _refer(out, fresh, same, here, stride)
                    fresh = here
                same = here + 8 - (leading(odd) >> 3)
            here += 8 if j < 0 else 9 if j < SHORT else 10 if j < MIDDLE else 11
    stop = begin + rows * stride
    if stop - LAST - same >= LEAST:
        out = _refer(out, fresh, same, stop - LAST, stride)
        fresh = stop - LAST
    size = stop - fresh
    out = _begin(out, size, 0)
    _copy(out, fresh, size)
    return out + size


@njit(error_model="numpy")
def _refer(out, fresh, same, here, back):
    """Write the literal bytes from `fresh` to `same`, and a reference for those from there to `here`."""
    size, match = same - fresh, here - same - MATCH
    out = _begin(out, size, min(match, 15))
    for i in range(0, size, 8):
        lay_word(out + i, word(fresh + i))
    out += size
    lay_pair(out, back)
    return _rest(out + 2, match)


@njit(error_model="numpy")
def _begin(out, size, match):
    """Write the byte before `size` literal bytes, and what did not fit into it."""
    lay_byte(out, min(size, 15) << 4 | match)
    return _rest(out + 1, size)


@njit(error_model="numpy")
def _rest(out, size):
    """Write what of a number of bytes the four bits before did not hold."""
    if size >= 15:
        left = size - 15
        while left >= 255:
            lay_byte(out, 255)
            out += 1
            left -= 255
        lay_byte(out, left)
        out += 1
    return out


@njit(error_model="numpy")
def _copy(out, source, size):
    """Copy `size` bytes and read none beyond them."""
    whole = size - size % 8
    for i in range(0, whole, 8):
        lay_word(out + i, word(source + i))
    for i in range(whole, size):
        lay_byte(out + i, byte(source + i))
