"""Build the records around the content: a chunk with its message indexes, and the end of a log."""

import hashlib
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, DataEnd, Footer, MetadataIndex, Statistics, SummaryOffset

from .format import ChunkRef

_OFFSETS = np.dtype([("channel", "<u2"), ("offset", "<u8")])

MAGIC = b"\x89MCAP0\r\n"


def closing(
    offset: Any, crc: Any, schemas: Any, channels: Any, chunks: Any, attachments: Any, metadata: Any
) -> Iterator[bytes]:
    """Yield the bytes that follow a data section of `offset` bytes and CRC-32 `crc`, piece by piece.

    `chunks` are ChunkRefs; `attachments` and `metadata` are lists of (offset, length, record). A reader builds the same
    bytes from what it found in the data section and compares.
    """

    def encoded(record):
        record.write(builder)
        return builder.end()

    builder = RecordBuilder()
    end = encoded(DataEnd(crc))
    yield end
    at = start = offset + len(end)
    check = 0
    groups = (
        (Opcode.SCHEMA, schemas),
        (Opcode.CHANNEL, channels),
        (Opcode.STATISTICS, [_statistics(schemas, channels, chunks, attachments, metadata)]),
        (Opcode.CHUNK_INDEX, map(_ChunkIndex, chunks)),
        (Opcode.ATTACHMENT_INDEX, [AttachmentIndex(at, length, r.log_time, r.create_time, len(r.data), r.name,
                                                   r.media_type) for at, length, r in attachments]),
        (Opcode.METADATA_INDEX, [MetadataIndex(at, length, record.name) for at, length, record in metadata]),
    )
    offsets = []
    for opcode, records in groups:
        before = at
        for record in records:
            blob = encoded(record)
            at, check = at + len(blob), crc32(blob, check)
            yield blob
        if at > before:
            offsets.append(SummaryOffset(opcode, before, at - before))
    last = b"".join(map(encoded, offsets))
    yield last
    check = crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, at), crc32(last, check))
    yield encoded(Footer(start, at, check)) + MAGIC


def content_hash(chunks: Any) -> str:
    """Return the SHA-256 of the chunks' first tick times, sizes and CRCs: it changes with any sample."""
    digest = hashlib.sha256()
    for chunk in chunks:
        digest.update(struct.pack("<QQQI", chunk.start_ns, chunk.end_ns, chunk.size, chunk.crc))
    return digest.hexdigest()


def pack_chunk(
    layout: Any, content: np.ndarray, data: Any, compression: str, k0: Any, n: Any, tail: dict, offset: int
) -> tuple[Any, ...]:
    """Return (list of bytes, ChunkRef) of the chunk record at `offset` and its message indexes; they last until the
    next call.

    `data` are the parts of the compressed `content` of the ticks k0 <= k < k0 + n; `tail` is
    {channel id: [(time, offset), ...]}.
    """
    start, end, size, crc = k0 * layout.dt_ns, (k0 + n - 1) * layout.dt_ns, len(content), crc32(content.data)
    held, name = sum(map(len, data)), compression.encode()
    # the library's own would copy the data three times
    head = struct.pack("<BQQQQII", Opcode.CHUNK, 40 + len(name) + held, start, end, size, crc, len(name))
    head += name + struct.pack("<Q", held)
    plan, length = layout.plan(k0, n), len(head) + held
    index = plan.index(k0)
    begin, more = offset + length, b""
    others = {}
    for channel, entries in tail.items():
        others[channel] = begin + len(index) + len(more), len(entries)
        more += _message_index(channel, entries)
    place, shared = (offset, length, offset + len(head), held), (plan.index_offsets, layout.counts(k0, n)[0])
    ref = ChunkRef(*place, compression, size, crc, start, end, *shared, others, len(index) + len(more))
    return [head, *data, index, more], ref


def _message_index(channel, entries):
    """Return a message index record (the library's own takes a call per number)."""
    size = 16 * len(entries)
    numbers = [number for entry in entries for number in entry]
    return struct.pack(f"<BQHI{len(numbers)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *numbers)


def _statistics(schemas, channels, chunks, attachments, metadata):
    counts = {c.id: 0 for c in channels}
    for chunk in chunks:
        for channel, count in chunk.index_counts.items():
            counts[channel] += count
    return Statistics(
        attachment_count=len(attachments), channel_count=len(channels),
        channel_message_counts={c: n for c, n in counts.items() if n}, chunk_count=len(chunks),
        message_count=sum(counts.values()), message_end_time=max((c.end_ns for c in chunks), default=0),
        message_start_time=min((c.start_ns for c in chunks), default=0), metadata_count=len(metadata),
        schema_count=len(schemas),
    )  # fmt: skip


class _ChunkIndex:
    """A chunk index record that `write`s its bytes as the library's own would, which takes a hundred calls."""

    def __init__(self, chunk):
        self._chunk = chunk

    def write(self, builder):
        chunk, name = self._chunk, self._chunk.compression.encode()
        offsets = np.fromiter(chunk.index_offsets.items(), _OFFSETS, len(chunk.index_offsets)).tobytes()
        body = struct.pack("<QQQQI", chunk.start_ns, chunk.end_ns, chunk.offset, chunk.length, len(offsets)) + offsets
        body += struct.pack("<QI", chunk.index_length, len(name)) + name
        body += struct.pack("<QQ", chunk.data_size, chunk.size)
        builder.write(struct.pack("<BQ", Opcode.CHUNK_INDEX, len(body)) + body)
