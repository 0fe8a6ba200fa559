"""Compress the content of a chunk, and decompress it within the memory that the chunk's head states."""

import ctypes
import functools
from contextlib import suppress
from typing import Any

import lz4.frame
import zstandard

# The rows of a flight are mostly noise in the last bits of doubles: slower searches look for what is not there.
# Measured on chunks of a flight: acceleration 25 takes 1.9 us a tick, 15 2.1 for 6 % less, 40 1.5 for 8 % more.
_FAST: dict[str, Any] = {"compression_level": -25, "block_size": lz4.frame.BLOCKSIZE_MAX64KB, "block_linked": False}
LEVEL = 3  # of zstd: a quarter smaller than LZ4, ten times its time; beyond a log hardly shrinks
COMPRESSIONS = ("", "lz4", "zstd")  # as MCAP names them

_TRIM, _MMAP = -1, -3  # M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's malloc.h
_KEPT = 32 << 20  # [byte]


@functools.cache
def keep_memory() -> None:
    """Let this process keep freed memory, up to some 32 MB, for the next chunk: glibc gives a megabyte back and the
    system clears it page by page, which takes longer than compressing. Elsewhere nothing is changed."""
    with suppress(OSError, AttributeError, TypeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP, _KEPT)
        mallopt(_TRIM, 2 * _KEPT)


def compress(content: bytes, name: str) -> bytes:
    """Return `content` compressed by one of COMPRESSIONS."""
    if name == "lz4":
        return lz4.frame.compress(content, store_size=True, **_FAST)
    return zstandard.ZstdCompressor(level=LEVEL).compress(content) if name else content


def decompress(data: bytes, size: int, name: str) -> bytes:
    """Return the content of `data`, which must have `size` bytes; no more memory is taken. Raises ValueError."""
    try:
        if name == "zstd":
            data = zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(data).read(size + 1)
        elif name == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise ValueError(f"the chunk cannot be decompressed: {error}") from error
    if len(data) != size:
        raise ValueError("the chunk cannot be decompressed: its frame is not whole, or not as long as its chunk says")
    return data
