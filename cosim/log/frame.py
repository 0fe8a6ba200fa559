"""Make one LZ4 frame of the content of a chunk, with a block for each topic, and take single topics out of a frame."""

import functools
import struct
from collections.abc import Collection, Mapping
from typing import Any

import lz4.block
import lz4.frame
import numpy as np

from actuators.object_cache import of_wholes

MOST = 1 << 18  # [byte] of a block before it is compressed
_KIND: dict[str, Any] = {"block_size": lz4.frame.BLOCKSIZE_MAX256KB, "block_linked": False}
_STATED = 6  # bytes of a frame's head that say its kind; the size of the content and a checksum follow
_SIZE = struct.Struct("<I")
_RAW = 1 << 31  # of a block's size: it is not compressed
SQUEEZE = of_wholes("cosim.log.lz4_rows", "squeeze", 5, f"{__name__}:SQUEEZE")


@functools.lru_cache(maxsize=16)
def _head(size):
    """Return what stands before the blocks of a frame of `size` bytes of content."""
    return lz4.frame.LZ4FrameCompressor(**_KIND).begin(source_size=size)


class Frame:
    """The blocks of the chunks of one Plan: each holds rows of one topic, a large topic takes several.

    `blocks` is the Plan's {topic number: Block}; a row has at most MAX_FIELDS fields.
    """

    def __init__(self, blocks: Mapping[int, Any]):
        self._numbers, cuts = [], []
        for number, b in blocks.items():
            fields, most = sum(run.stop - run.start for run, _, _ in b.runs), MOST // b.stride
            for row in range(0, b.rows, most):
                cuts.append((b.start + row * b.stride, min(most, b.rows - row), b.stride, fields))
                self._numbers.append(number)
        self._table = np.array(cuts, np.int64)
        self._out: np.ndarray | None = None  # where blocks are made
        self._written = np.zeros(1, np.int64)

    def pack(self, content: np.ndarray, tail: bytes) -> list[Any]:
        """Return the frame of a content that ends with `tail`, in parts; they last until the next call."""
        size = content.size - len(tail)
        if self._out is None:  # what the format may need at most, and eight bytes for those beyond the end
            self._out = np.empty(size + size // 255 + 32 * len(self._table) + 8, "u1")
        out, written = self._out, self._written
        SQUEEZE.call(self._table.ctypes.data, len(self._table), content.ctypes.data, out.ctypes.data,
                     written.ctypes.data)  # fmt: skip
        pieces = (tail[i : i + MOST] for i in range(0, len(tail), MOST))
        rest = b"".join(_SIZE.pack(len(piece) | _RAW) + piece for piece in pieces)
        return [_head(content.size), out[: int(written[0])], rest + _SIZE.pack(0)]

    def topics(self, file: Any, begin: int, end: int, wanted: Collection[int], content: np.ndarray) -> bool:
        """Put the topics `wanted` of the frame that stands in a file from byte `begin` to `end` where they stand in the
        content (uint8). Return False where the frame is not one of `pack`."""
        file.seek(begin)
        head = file.read(len(_head(1)))
        if head[:_STATED] != _head(1)[:_STATED]:
            return False
        at = begin + len(head)
        last = max((i for i, number in enumerate(self._numbers) if number in wanted), default=-1)
        for number, (start, rows, stride, _) in zip(self._numbers[: last + 1], self._table.tolist()):
            file.seek(at)
            held = file.read(_SIZE.size)
            (told,) = _SIZE.unpack(held) if len(held) == _SIZE.size else (0,)
            length, size = told & ~_RAW, rows * stride
            if not 0 < length <= min(size, end - at - _SIZE.size):
                return False
            if number in wanted:
                data = file.read(length)
                try:
                    data = data if told & _RAW else lz4.block.decompress(data, uncompressed_size=size)
                except (lz4.block.LZ4BlockError, MemoryError):
                    return False
                if len(data) != size:
                    return False
                content[start : start + size] = np.frombuffer(data, "u1")
            at += _SIZE.size + length
        return True
