"""Walk the records of a log with limits, refuse whatever this package would not have written, and say where.

Strict: both CRCs first, then every record must re-encode to its own bytes, and the summary must be the one that follows
from the data section; so nothing in the file is taken unchecked. Tolerant (for a log that was cut): keep what is whole.
"""

import io
import os
import struct
import zlib
from dataclasses import dataclass, field

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from . import foxglove
from .chunk import Layout
from .format import LIBRARY, ChunkRef, Damage, Limits, LogError, log_error, parse_topic
from .records import MAGIC, closing

_FOOTER = 9 + 20 + len(MAGIC)  # the last bytes of a log: footer record and magic
_DATA_END = 9 + 4
_TEXT = {Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata}
_RECOVER = "`cosim recover` makes a readable log of what is whole."
BAD = (McapError, struct.error, ValueError, KeyError, TypeError, OverflowError, MemoryError)


@dataclass
class Scan:
    """Hold what the records of one log say; `ids` maps a topic to its channel id, `damage` lists what is lost."""

    path: str
    size: int
    limits: Limits
    schemas: list = field(default_factory=list)
    channels: list = field(default_factory=list)
    metadata: list = field(default_factory=list)  # (offset, length, record)
    attachments: list = field(default_factory=list)  # (offset, length, record)
    chunks: list = field(default_factory=list)
    topics: dict = field(default_factory=dict)  # name -> TopicInfo without rows
    ids: dict = field(default_factory=dict)
    dt_ns: int = 0
    layout: Layout = None
    damage: list = field(default_factory=list)
    closed: bool = False  # it has an intact end
    end: int = 0  # of the last good record of the data section
    crc: int = 0  # of the bytes before `end`

    def fail(self, message, offset=None, remedy=""):
        raise log_error(message, self.path, offset, remedy)


def scan(path, limits, tolerant=False):
    """Return the Scan of a log; raises LogError when it cannot be read, is foreign, damaged or beyond a limit."""
    path = os.fspath(path)
    try:
        with open(path, "rb") as file:
            out = Scan(path, os.fstat(file.fileno()).st_size, limits)
            if file.read(len(MAGIC)) != MAGIC:
                out.fail("not an MCAP file", 0)
            if tolerant:
                _tolerant(out, file)
            else:
                stop = _check_end(out, file)
                _walk(out, file, stop)
                _check_summary(out, file)
                out.closed = True
            return out
    except OSError as error:
        raise log_error(f"cannot read the log: {error.strerror}", path) from error


def _check_end(out, file):
    """Check footer, summary CRC and data CRC; return where the data section ends."""
    cut = "the log has no end: its run was killed or the disk was full"
    if out.size < len(MAGIC) + _DATA_END + _FOOTER:
        out.fail(cut, out.size, _RECOVER)
    file.seek(out.size - _FOOTER)
    tail = file.read(_FOOTER)
    opcode, length, start, _, crc = struct.unpack("<BQQQI", tail[:-8])
    if tail[-8:] != MAGIC or opcode != Opcode.FOOTER or length != 20:
        out.fail(cut, out.size - _FOOTER, _RECOVER)
    if not len(MAGIC) + _DATA_END <= start <= out.size - _FOOTER:
        out.fail("the footer points outside the file", out.size - _FOOTER)
    if _crc(file, start, out.size - 12) != crc:
        out.fail("the summary is damaged (CRC)", start, _RECOVER)
    stop = start - _DATA_END
    file.seek(stop)
    opcode, length, crc = struct.unpack("<BQI", file.read(_DATA_END))
    if opcode != Opcode.DATA_END or length != 4:
        out.fail("no end of the data before the summary", stop)
    if _crc(file, 0, stop) != crc:
        out.fail("the data are damaged (CRC)", None, _RECOVER)
    out.crc = crc
    return stop


def _crc(file, start, stop):
    file.seek(start)
    crc = 0
    while start < stop:
        block = file.read(min(1 << 20, stop - start))
        if not block:
            break
        crc, start = zlib.crc32(block, crc), start + len(block)
    return crc


def _walk(out, file, stop):
    """Read the records from after the magic to `stop`; raises LogError at the first that is wrong."""
    file.seek(len(MAGIC))
    at, records, total = len(MAGIC), 0, 0
    out.end = at
    while at < stop:
        records += 1
        head = file.read(9)
        if len(head) < 9:
            out.fail("the file ends inside a record", at)
        opcode, length = struct.unpack("<BQ", head)
        if length > out.limits.record_bytes or records > out.limits.records:
            out.fail(f"a record of {length} bytes, number {records}, goes beyond the reader's limits", at)
        if length > stop - at - 9:
            out.fail(f"a record of {length} bytes does not fit before byte {stop}", at)
        body = file.read(length)
        if len(body) < length:
            out.fail("the file ends inside a record", at)
        try:
            if opcode == Opcode.CHUNK:
                total += _chunk(out, at, body)
                if total > out.limits.total_bytes:
                    raise ValueError(f"the chunks hold more than {out.limits.total_bytes} bytes")
            elif opcode == Opcode.MESSAGE_INDEX:
                _message_index(out, at, body)
            else:
                _record(out, at, opcode, body)
        except BAD as error:
            out.fail(f"damaged or foreign record {opcode}: {_say(error)}", at)
        at += 9 + length
        out.end = at
    _finish_chunk(out, at)


def _say(error):
    return f"{error}" or type(error).__name__


def _record(out, at, opcode, body):
    """Take one record that is neither chunk nor message index."""
    _finish_chunk(out, at)
    kind = Attachment if opcode == Opcode.ATTACHMENT else _TEXT.get(opcode)
    if kind is None:
        raise ValueError("it has no place here")
    if kind is not Attachment and len(body) > out.limits.text_bytes:
        raise ValueError(f"{len(body)} bytes go beyond the reader's limit of {out.limits.text_bytes}")
    record = decode(kind, opcode, body)
    if kind is Header:
        if at != len(MAGIC):
            raise ValueError("a second header")
        if record.library != LIBRARY or record.profile:
            raise ValueError(f"written by {record.library!r}, not {LIBRARY!r}; cosim.foreign reads such files")
    elif at == len(MAGIC):
        raise ValueError("a header must come first")
    elif kind is Schema:
        if record.id != len(out.schemas) + 1 or len(out.schemas) != len(out.channels):
            raise ValueError(f"schema {record.id} is out of order or defined again")
        out.schemas.append(record)
    elif kind is Channel:
        _channel(out, record)
    else:
        place = out.metadata if kind is Metadata else out.attachments
        if any(r.name == record.name for _, _, r in place):
            raise ValueError(f"{kind.__name__.lower()} {record.name!r} is there twice")
        if any(r.name == "result" for _, _, r in out.metadata):
            raise ValueError("nothing may follow the result")
        place.append((at, 9 + len(body), record))
        if kind is Metadata and record.name == "log":
            _layout(out, record.metadata)


def decode(kind, opcode, body):
    """Return the record of a body; raises ValueError unless it encodes back to the same bytes."""
    record = kind.read(ReadDataStream(io.BytesIO(body)))
    builder = RecordBuilder()
    record.write(builder)
    if builder.end() != struct.pack("<BQ", opcode, len(body)) + body:
        raise ValueError("its lengths or checksum do not agree with its content")
    return record


def _channel(out, record):
    number = len(out.channels) + 1
    if record.id != number or record.schema_id != number or number != len(out.schemas):
        raise ValueError(f"channel {record.id} is out of order or defined again")
    if number > out.limits.channels or out.layout is not None:
        raise ValueError("too many channels, or one after the first data")
    if record.topic in out.ids or record.message_encoding != "protobuf":
        raise ValueError(f"topic {record.topic!r} is there twice or not protobuf")
    schema = out.schemas[-1]
    if record.topic in foxglove.TOPICS:
        name, data = foxglove.TOPICS[record.topic]
        if (schema.name, schema.data, record.metadata) != (name, data(), {}):
            raise ValueError(f"topic {record.topic} has a schema of its own")
    else:
        out.topics[record.topic] = parse_topic(record, schema)
    out.ids[record.topic] = number
    out.channels.append(record)


def _layout(out, texts):
    if set(texts) != {"dt_ns"} or not 0 < int(texts["dt_ns"]) < 2**63 or str(int(texts["dt_ns"])) != texts["dt_ns"]:
        raise ValueError("the metadata `log` do not give the tick")
    if not any(t.every == 1 for t in out.topics.values()):
        raise ValueError("no topic is logged at every tick")
    out.dt_ns = int(texts["dt_ns"])
    out.layout = Layout([(out.ids[t.name], len(t.fields), t.every) for t in out.topics.values()], out.dt_ns)


def _chunk(out, at, body):
    """Take the head of a chunk record; its content is decompressed and compared when it is asked for."""
    _finish_chunk(out, at)
    if out.layout is None:
        raise ValueError("a chunk before the channels and the metadata `log`")
    start, end, size, crc, name_length = struct.unpack_from("<QQQII", body)
    if name_length > 16:
        raise ValueError("the name of the compression is too long")
    compression = body[32 : 32 + name_length].decode()
    if compression not in ("", "zstd"):
        raise ValueError(f"unknown compression {compression!r}")
    (data_size,) = struct.unpack_from("<Q", body, 32 + name_length)
    head = 40 + name_length
    if data_size != len(body) - head:
        raise ValueError(f"{data_size} bytes of data in a record that holds {len(body) - head}")
    if size > out.limits.chunk_bytes or (not compression and size != data_size):
        raise ValueError(f"a chunk of {size} bytes is not as long as it says, or beyond {out.limits.chunk_bytes}")
    if start % out.dt_ns or end % out.dt_ns or end < start or end >= 2**63:
        raise ValueError(f"times {start} to {end} ns are no ticks")
    if out.chunks and start <= out.chunks[-1].end_ns:
        raise ValueError("the chunk begins before the one before it ends")
    least = out.layout.counts(start // out.dt_ns, (end - start) // out.dt_ns + 1)[1]
    if size < least:
        raise ValueError(f"{size} bytes cannot hold its ticks, which take {least}")
    if any(r.name == "result" for _, _, r in out.metadata):
        raise ValueError("nothing may follow the result")
    out.chunks.append(ChunkRef(at, 9 + len(body), at + 9 + head, data_size, compression, size, crc, start, end))
    return size


def _message_index(out, at, body):
    chunk = out.chunks[-1] if out.chunks else None
    if chunk is None or at != chunk.offset + chunk.length + chunk.index_length:
        raise ValueError("a message index that follows no chunk")
    channel, size = struct.unpack_from("<HI", body)
    if size != len(body) - 6 or size % 16 or channel in chunk.index_counts or not 0 < channel <= len(out.channels):
        raise ValueError("a message index of wrong length or channel")
    chunk.index_offsets[channel], chunk.index_counts[channel] = at, size // 16
    chunk.index_length += 9 + len(body)


def ticks(chunk, dt_ns):
    """Return (first tick, number of ticks) of a chunk."""
    return chunk.start_ns // dt_ns, (chunk.end_ns - chunk.start_ns) // dt_ns + 1


def _finish_chunk(out, at):
    """Check that the message indexes of the last chunk count what its ticks must hold."""
    if not out.chunks:
        return
    chunk = out.chunks[-1]
    counts, size = out.layout.counts(*ticks(chunk, out.dt_ns))
    sampled = {c: n for c, n in chunk.index_counts.items() if out.channels[c - 1].topic in out.topics}
    if sampled != counts:
        out.fail("the chunk's message indexes do not count one message per sample", chunk.offset)
    if (size == chunk.size) != (len(sampled) == len(chunk.index_counts)):
        out.fail("the chunk holds messages that no index counts", chunk.offset)


def _check_summary(out, file):
    """Compare the end of the file with the end that its data section calls for."""
    if out.layout is None:
        out.fail("the log has no metadata `log`", out.end)
    expected = closing(out.end, out.crc, out.schemas, out.channels, out.chunks, out.attachments, out.metadata)
    file.seek(out.end)
    if out.size - out.end != len(expected) or file.read(len(expected)) != expected:
        out.fail("the summary does not agree with the data", out.end)


def _tolerant(out, file):
    try:
        _walk(out, file, out.size)
    except LogError as error:
        out.damage.append(Damage(out.end, out.size - out.end, str(error)))
