"""Take one chunk of a log into memory, checked: its samples and the messages behind them."""

import struct
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO

import numpy as np
from isal.isal_zlib import crc32

from .compression import FrameError, decompress
from .format import Damage, LogError, log_error

_HEAD = struct.Struct("<BQHIQQ")  # a message record up to its payload, as chunk.HEAD


def drop_damaged_chunks(found: Any) -> None:
    """Leave only the whole chunks in the Contents of a log, and add the others to its damage."""
    whole = []
    with open(found.path, "rb") as file:
        for chunk in found.chunks:
            try:
                load_chunk(found, file, chunk)
                whole.append(chunk)
            except LogError as error:
                found.damage.append(Damage(chunk.offset, chunk.length, error.problem))
    found.whole = found.whole and len(whole) == len(found.chunks)
    found.chunks = whole


def load_chunk(
    found: Any, file: BinaryIO, chunk: Any, topics: Sequence[Any] | None = None, take: Callable[..., bool] | None = None
) -> tuple[Any, ...]:
    """Return (plan, content, tail) of a chunk; raises LogError when a single byte is not as it must be.

    The tail is the list of irregular messages (channel id, tick, payload). Beyond the checksum, which covers all, only
    the samples of `topics` (numbers, default all) are looked at, by `take(plan, content)` where that is given: it
    returns whether they are as they must be.
    """
    file.seek(chunk.data_offset)
    try:
        content = decompress(file.read(chunk.data_size), chunk.size, chunk.compression)
    except FrameError as error:
        raise log_error(str(error), found.path, chunk.offset) from error
    if len(content) != chunk.size or crc32(content) != chunk.crc:
        raise log_error("the chunk is damaged (CRC)", found.path, chunk.offset)
    k0, n = found.ticks(chunk)
    plan, content = found.layout.plan(k0, n), np.frombuffer(content, "u1")
    wrong = None if take and take(plan, content) else plan.differs(content, k0, topics)
    if wrong is not None:
        raise log_error(f"the chunk is not one message per sample (byte {wrong} of it)", found.path, chunk.offset)
    return plan, content, _tail(found, content[plan.size :].tobytes(), chunk)


def load_topics(
    found: Any, file: BinaryIO, chunk: Any, topics: Sequence[Any], take: Callable[..., bool] | None, content: np.ndarray
) -> tuple[Any, ...] | None:
    """Return (plan, content, ()) of a chunk as `load_chunk`, with these topics alone in the `content` that is given.

    None where the chunk does not let them be read alone, or something in it is not as it must be: `load_chunk` says
    what.
    """
    if chunk.compression != "lz4":
        return None
    k0, n = found.ticks(chunk)
    plan = found.layout.plan(k0, n)
    if not plan.frame.topics(file, chunk.data_offset, chunk.data_offset + chunk.data_size, topics, content):
        return None
    if not take(plan, content) if take else plan.differs(content, k0, topics) is not None:
        return None
    return plan, content, ()


def _tail(found, data, chunk):
    """Return the messages after the samples of a chunk; raises LogError unless they are whole and indexed."""
    irregular = {found.ids[name] for name in found.ids if name not in found.topics}
    tail, at = [], 0
    while at < len(data):
        whole = len(data) - at >= _HEAD.size
        op, length, channel, k, ns, publish = _HEAD.unpack_from(data, at) if whole else (0,) * 6
        end = at + 9 + length
        if not at + _HEAD.size <= end <= len(data) or op != 5 or channel not in irregular:
            raise log_error(f"byte {at} after the chunk's samples begins no message", found.path, chunk.offset)
        if not chunk.start_ns <= ns == publish <= chunk.end_ns or ns != k * found.dt_ns:
            raise log_error("a message has a time outside its chunk", found.path, chunk.offset)
        tail.append((channel, k, data[at + _HEAD.size : end]))
        at = end
    counts = Counter(channel for channel, _, _ in tail)
    if not found.tolerant and counts != {c: n for c, n in chunk.index_counts.items() if c in irregular}:
        raise log_error("the message indexes do not count what the chunk holds", found.path, chunk.offset)
    return tail
