"""Compress the content of a chunk, and decompress it within the memory that the chunk's head states."""

import ctypes
import functools
from contextlib import suppress
from typing import Any

import lz4.frame
import zstandard

# Measured on chunks of a flight with 7030 bytes/tick, other processes on both cores [us/tick, bytes/tick]: lz4 at
# acceleration 10 in one piece 4.1, 4188; in independent blocks of 64 kB, whose tables are half as large, 15 2.7, 4563;
# 20 2.6, 4643; 40 2.1, 4935. zstd level -3 6.2, 3553; -20 3.6, 4502. The rows of a flight are mostly noise in the last
# bits of doubles: the slower ones search for what is not there. What cosim/log/lz4_rows.py makes, which the writer
# takes where it has compiled code, takes 1.7 where lz4 at acceleration 15 takes 2.5, with as many bytes.
_ACCELERATION, _BLOCK = 15, lz4.frame.BLOCKSIZE_MAX64KB
_FAST: dict[str, Any] = {"compression_level": -_ACCELERATION, "block_size": _BLOCK, "block_linked": False}
# smaller, but a topic cannot be read without all others; beyond 6 a log hardly shrinks, and takes forty times as long
LEVELS = {"zstd": 6, "zstd-fast": 3}
COMPRESSIONS = ("", "lz4", "zstd")  # as MCAP names them


_TRIM, _MMAP = -1, -3  # M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's malloc.h
_KEPT = 32 << 20  # [byte]


@functools.cache
def keep_memory() -> None:
    """Let this process keep freed memory, up to some 32 MB, for the next chunk.

    Otherwise glibc gives the megabyte of every chunk back and takes it anew, and the system clears it page by page: on
    some machines that takes longer than compressing. Elsewhere nothing is changed.
    """
    with suppress(OSError, AttributeError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP, _KEPT)
        mallopt(_TRIM, 2 * _KEPT)


class FrameError(ValueError):
    """Say that compressed data are not one whole frame of the size that they should have."""


def compressor(name: str) -> Any:
    """Return bytes-like -> bytes for a name of COMPRESSIONS or LEVELS; raises ValueError for another."""
    if name == "lz4":
        return lambda content: lz4.frame.compress(content, store_size=True, **_FAST)
    if name in LEVELS:
        return zstandard.ZstdCompressor(level=LEVELS[name]).compress
    if name == "":
        return bytes
    raise ValueError(f"compression {name!r}; there is {', '.join(map(repr, (*COMPRESSIONS, 'zstd-fast')))}")


def decompress(data: Any, size: int, name: str, *, others: bool = False) -> Any:
    """Return the content of one frame, which must have `size` bytes; no more memory than that is taken.

    The frame states its size, and nothing follows it; those of `others` need not. Raises FrameError.
    """
    try:
        if name == "zstd":
            stated = zstandard.get_frame_parameters(data).content_size
            _same(size if others and stated == zstandard.CONTENTSIZE_UNKNOWN else stated, size)
            frame = zstandard.ZstdDecompressor(max_window_size=1 << 27)
            # 0 would stand for a size that the frame states
            data = frame.decompress(data, max_output_size=max(size, 1), allow_extra_data=others)
        elif name == "lz4":
            if not others:
                _same(lz4.frame.get_frame_info(data)["content_size"], size)
            frame = lz4.frame.LZ4FrameDecompressor()
            data = frame.decompress(data, max_length=size + 1)
            if not frame.eof or (frame.unused_data and not others):
                said = "its frame is not whole, or not as long as its chunk says"
                raise FrameError(f"the chunk cannot be decompressed: {said}")
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise FrameError(f"the chunk cannot be decompressed: {error}") from error
    _same(len(data), size)
    return data


def _same(stated, size):
    if stated != size:
        raise FrameError("the compressed frame is not as long as its chunk says")
