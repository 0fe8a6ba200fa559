"""Contents of one log: what its records say; a record out of order is refused."""

import io
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from . import foxglove
from .chunk import Layout
from .compression import COMPRESSIONS
from .format import LIBRARY, ChunkRef, Damage, Limits, log_error, parse_topic
from .records import MAGIC

_KINDS = {
    Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}  # fmt: skip


LARGE = (Opcode.CHUNK, Opcode.MESSAGE_INDEX)  # records of which only the head is taken here
HEAD_BYTES = 64  # that a chunk's head takes at most, with its compression's name and the length of its data


@dataclass
class Contents:
    """Gather the records of one log; `metadata` and `attachments` are lists of (offset, length, record).

    `topics` {name: TopicInfo without rows}, `ids` {topic: channel id}, `layout` of the chunks, `damage` what is lost,
    `trusted` whether all before the first chunk is as written, `whole` whether the checksum of all data agrees,
    `closed` whether the log has its end too. A tolerant reader goes on after what a strict one refuses.
    """

    path: str
    size: int
    limits: Limits
    tolerant: bool = False
    identity: tuple = ()  # of the file, cosim/log/validate.py
    schemas: list = field(default_factory=list)
    channels: list = field(default_factory=list)
    metadata: list = field(default_factory=list)
    attachments: list = field(default_factory=list)
    chunks: list = field(default_factory=list)
    topics: dict = field(default_factory=dict)
    ids: dict = field(default_factory=dict)
    dt_ns: int = 0
    layout: Layout | None = None
    damage: list = field(default_factory=list)
    trusted: bool = False
    whole: bool = False
    closed: bool = False
    place: int = 0  # of the record at hand [byte]
    records: int = 0
    total: int = 0  # content of the chunks so far [byte]

    def take(self, at: Any, opcode: Any, length: Any, body: Any, digest: Any) -> None:
        """Take the record at byte `at`, of `length`; `digest` hashes all before it. Raises ValueError or its like."""
        if opcode == Opcode.MESSAGE_INDEX:
            self._message_index(at, length, body)
            return
        if not self.tolerant:  # whose caller compares the content itself
            self.finish()
        if opcode == Opcode.CHUNK:
            self._chunk(at, length, body)
            return
        kind = _KINDS.get(opcode)
        if kind is None:
            raise ValueError("it has no place here")
        if kind is not Attachment and len(body) > self.limits.text_bytes:
            raise ValueError(f"{len(body)} bytes are beyond the reader's limit of {self.limits.text_bytes}")
        record = decode(kind, opcode, body)
        if (kind is Header) != (at == len(MAGIC)):
            raise ValueError("a log has one header, and it comes first")
        if kind is Header:
            if record.library != LIBRARY or record.profile:
                raise ValueError(f"written by {record.library!r}, not {LIBRARY!r}; cosim.replay.foreign reads it")
        elif kind is Schema:
            if record.id != len(self.schemas) + 1 or len(self.schemas) != len(self.channels):
                raise ValueError(f"schema {record.id} is out of order or defined again")
            self.schemas.append(record)
        elif kind is Channel:
            self._channel(record)
        else:
            self._extra(at, 9 + len(body), record, digest)

    def _extra(self, at, length, record, digest):
        place = self.metadata if isinstance(record, Metadata) else self.attachments
        if any(r.name == record.name for _, _, r in place):
            raise ValueError(f"{type(record).__name__.lower()} {record.name!r} is there twice")
        self._nothing_after_the_result()
        place.append((at, length, record))
        if place is self.metadata and record.name == "log":
            self._layout(record.metadata)
        elif place is self.metadata and record.name == "preamble":
            self.trusted = digest is not None and record.metadata == {"sha256": digest.hexdigest()}
            if not self.trusted and self.tolerant:
                self.damage.append(Damage(0, at, "the parameters before the first tick are not what was written"))
            elif not self.trusted:
                raise ValueError("what precedes the first chunk is not what was written")

    def _nothing_after_the_result(self):
        if self.metadata and self.metadata[-1][2].name == "result":
            raise ValueError("nothing may follow the result")

    def _channel(self, record):
        number = len(self.channels) + 1
        if record.id != number or record.schema_id != number or number != len(self.schemas):
            raise ValueError(f"channel {record.id} is out of order or defined again")
        if number > self.limits.channels or self.layout is not None:
            raise ValueError("too many channels, or one that comes too late")
        if record.topic in self.ids or record.message_encoding != "protobuf":
            raise ValueError(f"topic {record.topic!r} is there twice or not protobuf")
        schema = self.schemas[-1]
        if schema.encoding != "protobuf":
            raise ValueError(f"schema {schema.id} is {schema.encoding!r}, not protobuf")
        if record.topic in foxglove.TOPICS:
            name, data = foxglove.TOPICS[record.topic]
            if (schema.name, schema.data, record.metadata) != (name, data(), {}):
                raise ValueError(f"topic {record.topic} has a schema of its own")
        else:
            self.topics[record.topic] = parse_topic(record, schema)
        self.ids[record.topic] = number
        self.channels.append(record)

    def _layout(self, texts):
        dt_ns = int(texts["dt_ns"])
        if texts != {"dt_ns": str(dt_ns)} or not 0 < dt_ns < 2**63:
            raise ValueError("the metadata `log` do not give the tick")
        if not any(t.every == 1 for t in self.topics.values()):
            raise ValueError("no topic is logged at every tick")
        self.dt_ns = dt_ns
        self.layout = Layout([(self.ids[t.name], len(t.fields), t.every) for t in self.topics.values()], dt_ns)

    def _chunk(self, at, length, body):
        """Take the head of a chunk; its content is decompressed and compared when it is asked for."""
        if self.layout is None or not (self.trusted or self.tolerant):
            raise ValueError("a chunk before the hash of the channels and metadata")
        self._nothing_after_the_result()
        start, end, size, crc, name_length = struct.unpack_from("<QQQII", body)
        compression = body[32 : 32 + min(name_length, 16)].decode()
        if len(compression) != name_length or compression not in COMPRESSIONS:
            raise ValueError(f"unknown compression {compression!r}")
        head = 40 + name_length
        (data_size,) = struct.unpack_from("<Q", body, 32 + name_length)
        if data_size != length - head:
            raise ValueError(f"{data_size} bytes of data in a record that holds {length - head}")
        self.total += size
        if size > self.limits.chunk_bytes or self.total > self.limits.total_bytes:
            raise ValueError(f"{size} bytes of content, {self.total} so far, are beyond the reader's limits")
        if size > self.limits.expansion * max(data_size, 1):
            raise ValueError(f"{data_size} bytes cannot hold {size} of samples")
        if start % self.dt_ns or end % self.dt_ns or not start <= end < 2**63:
            raise ValueError(f"times {start} to {end} ns are no ticks")
        if self.chunks and start <= self.chunks[-1].end_ns:
            raise ValueError("it begins before the chunk before it ends")
        chunk = ChunkRef(at, 9 + length, at + 9 + head, data_size, compression, size, crc, start, end)
        least = self.layout.counts(*self.ticks(chunk))[1]
        if size < least or (not compression and size != data_size):
            raise ValueError(f"{size} bytes of content cannot hold its ticks, which take {least}, or are not there")
        self.chunks.append(chunk)

    def _message_index(self, at, length, body):
        chunk = self.chunks[-1] if self.chunks else None
        if chunk is None or at != chunk.offset + chunk.length + chunk.index_length:
            raise ValueError("it follows no chunk")
        channel, size = struct.unpack_from("<HI", body)
        if size != length - 6 or size % 16 or not size:
            raise ValueError("its length is wrong")
        if channel in chunk.counts or channel in chunk.others or not 0 < channel <= len(self.channels):
            raise ValueError(f"channel {channel} is unknown or indexed twice")
        chunk.others[channel] = at, size // 16
        chunk.index_length += 9 + length

    def indexes(self, file: Any, stop: Any) -> int:
        """Take all message indexes of the last chunk's samples at once; return their size, 0 where it cannot be."""
        assert self.layout is not None  # or the chunk had been refused
        chunk = self.chunks[-1]
        at, ticks = chunk.offset + chunk.length, self.ticks(chunk)
        plan = self.layout.plan(*ticks)
        expected = plan.index(ticks[0])
        size, count = len(expected), len(plan.index_offsets)
        if at + size > stop or self.records + count > self.limits.records:
            return 0
        file.seek(at)
        block = np.frombuffer(file.read(size), "u1")
        if not np.array_equal(block, expected):
            if len(block) == size and np.array_equal(block[plan.heads], expected[plan.heads]):
                raise log_error("the message indexes point elsewhere than at their messages", self.path, at)
            return 0
        chunk.places, chunk.counts = plan.index_offsets, self.layout.counts(*ticks)[0]
        chunk.index_length, self.records = size, self.records + count
        return size

    def ticks(self, chunk: ChunkRef) -> tuple[Any, ...]:
        """Return (first tick, number of ticks) of a chunk."""
        return chunk.start_ns // self.dt_ns, (chunk.end_ns - chunk.start_ns) // self.dt_ns + 1

    def finish(self) -> None:
        """Check that the message indexes of the last chunk count what its ticks must hold; raises LogError."""
        if self.layout is None or not self.chunks or self.chunks[-1].checked:
            return
        chunk = self.chunks[-1]
        chunk.checked = True
        counts, size = self.layout.counts(*self.ticks(chunk))
        sampled = {c: n for c, n in chunk.index_counts.items() if self.channels[c - 1].topic in self.topics}
        if sampled != counts or (size == chunk.size) != (len(sampled) == len(chunk.index_counts)):
            raise log_error("the message indexes do not count what the chunk holds", self.path, chunk.offset)


def decode(kind: Any, opcode: int, body: Any) -> Any:
    """Return the record of a body; raises ValueError unless it encodes back to the same bytes."""
    record = kind.read(ReadDataStream(io.BytesIO(body)))
    builder = RecordBuilder()
    record.write(builder)
    if builder.end() != struct.pack("<BQ", opcode, len(body)) + body:
        raise ValueError("its lengths or checksum do not agree with its content")
    return record
