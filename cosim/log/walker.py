"""Records of an MCAP file within bounds, and what those of a log of ours say.

Strict: checksums of all data and of the preamble are compared before anything is parsed, and whatever this package
would not have written is refused with its place. Tolerant: what is whole is kept, what is lost is listed.
"""

import hashlib
import io
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from google.protobuf.message import DecodeError
from isal.isal_zlib import crc32
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, ChunkIndex, Header, Metadata, Schema

from cosim.files import regular

from . import foxglove
from .compression import COMPRESSIONS, FrameError, decompress
from .format import LIBRARY, MAGIC, READ_BY, Damage, Limits, LogError, log_error, parts_of
from .layout import HEAD, Layout, content_hash, schema_data, schema_name
from .log_file import Chunk

_RECORD = struct.Struct("<BQ")
_FOOTER = 9 + 20 + len(MAGIC)  # the last bytes of a log: footer record and magic
_DATA_END = 9 + 4
_CHUNK_HEAD = 64  # bytes that a chunk's head takes at most, with its compression's name and the length of its data
_RECOVER = "`cosim recover` makes a readable log of what is whole."
# what a record's parser may raise on bytes that are not what they should be
BAD = (
    McapError, DecodeError, struct.error, ValueError, KeyError, TypeError, AttributeError, OverflowError, MemoryError,
    RecursionError,
)  # fmt: skip
_KINDS = {Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata,
          Opcode.ATTACHMENT: Attachment, Opcode.CHUNK_INDEX: ChunkIndex}  # fmt: skip


@dataclass
class Contents:
    """What the records of one log say.

    `topics` {name: TopicInfo without rows}, `ids` {channel: id}, `declared` [(channel, message name, descriptors,
    metadata)], `layout` of the chunks, `damage` what is lost, `trusted` whether all before the first chunk is as
    written, `whole` whether the checksum of all data agrees, `closed` whether the log has its end too.
    """

    path: str
    size: int
    limits: Limits
    tolerant: bool
    declared: list = field(default_factory=list)
    metadata: dict = field(default_factory=dict)
    attachments: dict = field(default_factory=dict)  # name -> (media type, bytes)
    chunks: list[Chunk] = field(default_factory=list)
    topics: dict = field(default_factory=dict)
    ids: dict = field(default_factory=dict)
    dt_ns: int = 0
    layout: Layout | None = None
    damage: list = field(default_factory=list)
    trusted: bool = False
    whole: bool = False
    closed: bool = False

    def ticks(self, chunk: Chunk) -> tuple[int, int]:
        """Return (first tick, number of ticks) of a chunk."""
        return chunk.start_ns // self.dt_ns, (chunk.end_ns - chunk.start_ns) // self.dt_ns + 1


def scan(path: str | Path, limits: Limits, tolerant: bool = False) -> Contents:
    """Return the Contents of a log; raises LogError when it cannot be read, is foreign, damaged or beyond a limit.

    With `tolerant`, damage is listed in the Contents instead, as long as there is a log to speak of.
    """
    path = os.fspath(path)
    regular(path, LogError)
    try:
        with open(path, "rb") as file:
            out = Contents(path, os.fstat(file.fileno()).st_size, limits, tolerant)
            if file.read(len(MAGIC)) != MAGIC:
                raise log_error("not an MCAP file", path, 0, "" if out.size else "It is empty.")
            return _tolerant(out, file) if tolerant else _strict(out, file)
    except OSError as error:
        raise log_error(f"cannot read the log: {error.strerror}", path) from error


def records(file: BinaryIO, at: int, stop: int, limits: Limits, path: str) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield (offset, opcode, length of the content, content) of the records from `at` to `stop`.

    Of a chunk only the head is read, of a message index nothing. Raises LogError for one that does not fit.
    """
    count = 0
    while at < stop:
        file.seek(at)
        head = file.read(9)
        if len(head) < 9:
            raise log_error("the file ends inside a record", path, at)
        opcode, length = _RECORD.unpack(head)
        count += 1
        if length > limits.record_bytes or count > limits.records:
            raise log_error(f"record {count}, of {length} bytes, is beyond the reader's limits", path, at)
        if length > stop - at - 9:
            raise log_error(f"a record of {length} bytes does not fit before byte {stop}", path, at)
        needed = {Opcode.CHUNK: min(length, _CHUNK_HEAD), Opcode.MESSAGE_INDEX: 0}.get(opcode, length)  # type: ignore[call-overload]
        body = file.read(needed)
        if len(body) < needed:
            raise log_error("the file ends inside a record", path, at)
        yield at, opcode, length, body
        at += 9 + length


def parse(opcode: int, body: bytes) -> Any:
    """Return the library's record of a content; raises one of BAD."""
    kind = _KINDS.get(opcode)  # type: ignore[call-overload]
    if kind is None:
        raise ValueError("it has no place here")
    return kind.read(ReadDataStream(io.BytesIO(body)))


def _strict(out, file):
    stop, crc = _ends(out, file)
    if _crc(file, 0, stop) != crc:
        raise log_error("the data are damaged (CRC)", out.path, None, _RECOVER)
    taken = _Records(out)
    for at, opcode, length, body in records(file, len(MAGIC), stop, out.limits, out.path):
        taken.take(at, opcode, length, body)
    if out.layout is None:
        raise log_error("it has no channels", out.path)
    result = out.metadata.get("result")
    if result is not None and result.get("content") != content_hash(out.chunks):
        raise log_error("the samples are not those of the result", out.path)
    out.whole = out.closed = True
    return out


def _tolerant(out, file):
    """Take what is whole; where a record's own length is damaged, go on at the next chunk that the summary names."""
    try:
        stop, crc = _ends(out, file)
        out.whole = _crc(file, 0, stop) == crc
        starts = [parse(opcode, body).chunk_start_offset for _, opcode, _, body in
                  records(file, stop + _DATA_END, out.size - _FOOTER, out.limits, out.path)
                  if opcode == Opcode.CHUNK_INDEX]  # fmt: skip
    except (LogError, *BAD) as error:
        out.damage.append(Damage(out.size, 0, getattr(error, "problem", str(error))))
        stop, starts = out.size, []
    taken, at = _Records(out), len(MAGIC)
    while at < stop:
        place = at
        try:
            for place, opcode, length, body in records(file, at, stop, out.limits, out.path):
                if opcode == Opcode.DATA_END:
                    out.whole = length == 4 and struct.unpack("<I", body)[0] == _crc(file, 0, place)
                    at = stop
                    break
                taken.take(place, opcode, length, body)
                place += 9 + length
            at = stop
        except LogError as error:
            at = next((start for start in starts if start > place), stop)
            out.damage.append(Damage(place, at - place, error.problem))
    if out.layout is None:
        try:
            taken.first_chunk(stop)
        except BAD as error:
            out.damage.append(Damage(0, stop, f"the channels are damaged: {error}"))
    if out.layout is None:
        reason = out.damage[0].reason if out.damage else "it has no channels"
        raise log_error(f"nothing can be recovered: {reason}", out.path, out.damage[0].offset if out.damage else None)
    return out


def _ends(out, file):
    """Check footer and summary; return (end of the data section, its CRC-32)."""

    def fail(problem, offset):
        raise log_error(problem, out.path, offset, _RECOVER)

    footer = out.size - _FOOTER
    cut = "the log has no end: its run was killed or the disk was full"
    if footer < len(MAGIC) + _DATA_END:
        fail(cut, out.size)
    file.seek(footer)
    tail = file.read(_FOOTER)
    opcode, length, start, _, crc = struct.unpack("<BQQQI", tail[:-8])
    if tail[-8:] != MAGIC or opcode != Opcode.FOOTER or length != 20:
        fail(cut, footer)
    if not len(MAGIC) + _DATA_END <= start <= footer:
        fail("the footer points outside the file", footer)
    if _crc(file, start, out.size - 12) != crc:
        fail("the summary is damaged (CRC)", start)
    stop = start - _DATA_END
    file.seek(stop)
    opcode, length, crc = struct.unpack("<BQI", file.read(_DATA_END))
    if opcode != Opcode.DATA_END or length != 4:
        fail("no end of the data before the summary", stop)
    return stop, crc


def _crc(file, start, stop):
    file.seek(start)
    crc = 0
    while start < stop and (block := file.read(min(1 << 20, stop - start))):
        crc, start = crc32(block, crc), start + len(block)
    return crc


class _Records:
    """Takes the records of a log one by one into its Contents; a record out of order is refused."""

    def __init__(self, out: Contents):
        self._out, self._digest, self._total = out, hashlib.sha256(MAGIC), 0
        self._preamble: list | None = []  # records before the first chunk: parsed when their hash is known

    def take(self, at: int, opcode: int, length: int, body: bytes) -> None:
        """Take the record at byte `at`; raises LogError for one that is damaged or foreign."""
        out = self._out
        try:
            if opcode == Opcode.MESSAGE_INDEX:
                return
            if opcode not in (Opcode.CHUNK, Opcode.ATTACHMENT) and length > out.limits.text_bytes:
                raise ValueError(f"{length} bytes are beyond the reader's limit of {out.limits.text_bytes}")
            if self._preamble == [] and not out.declared:
                self._header(opcode, body)
            if opcode == Opcode.CHUNK:
                self.first_chunk(at)
                self._chunk(at, length, body)
            elif self._preamble is None:
                record = parse(opcode, body)
                if not isinstance(record, Metadata) or record.name in out.metadata or "result" in out.metadata:
                    raise ValueError("it has no place here")
                out.metadata[record.name] = record.metadata
            elif opcode == Opcode.METADATA and body[4:12] == b"preamble":
                self._end_preamble(at, {"sha256": self._digest.hexdigest()} == parse(opcode, body).metadata)
                out.metadata["preamble"] = parse(opcode, body).metadata
            else:
                self._digest.update(_RECORD.pack(opcode, length) + body)
                self._preamble.append((at, opcode, body))
        except BAD as error:
            problem = f"damaged or foreign record {opcode}: {str(error) or type(error).__name__}"
            raised = error if isinstance(error, LogError) else log_error(problem, out.path, at)
            if not out.tolerant or self._preamble is not None:
                raise raised from error
            out.damage.append(Damage(at, 9 + length, raised.problem))

    def first_chunk(self, at: int) -> None:
        """End a preamble that has no hash: only a tolerant reader goes on."""
        if self._preamble is not None:
            if not self._out.tolerant:
                raise ValueError("a chunk before the hash of the channels and metadata")
            self._end_preamble(at, False)

    def _header(self, opcode, body):
        library = parse(opcode, body).library if opcode == Opcode.HEADER else ""
        name, _, number = library.rpartition(" ")
        if name == LIBRARY.rpartition(" ")[0] and number in READ_BY:
            raise log_error(f"written in format {number}, which {READ_BY[number]} reads", self._out.path)
        if library != LIBRARY:
            raise ValueError(f"written by {library!r}, not {LIBRARY!r}; cosim.replay.foreign reads it")

    def _end_preamble(self, at, trusted):
        out, kept, self._preamble = self._out, self._preamble or [], None
        out.trusted = trusted
        if not trusted and not out.tolerant:
            raise ValueError("what precedes the first chunk is not what was written")
        if not trusted:
            out.damage.append(Damage(0, at, "the parameters before the first tick are not what was written"))
        schemas: list = []
        for place, opcode, body in kept[1:]:
            try:
                self._declare(parse(opcode, body), schemas)
            except BAD as error:
                raise log_error(f"damaged or foreign record {opcode}: {error}", out.path, place) from error
        dt_ns = int(out.metadata["log"]["dt_ns"])
        if not 0 < dt_ns < 2**63 or not any(t.every == 1 for t in out.topics.values()):
            raise ValueError("the metadata `log` do not give the tick, or no topic is logged at every tick")
        out.dt_ns, out.layout = dt_ns, Layout(list(out.topics.values()), out.ids, dt_ns)

    def _declare(self, record, schemas):
        """Take a schema, channel, metadata or attachment record of the preamble."""
        out = self._out
        if isinstance(record, Schema):
            schemas.append(record)
        elif isinstance(record, Channel):
            self._channel(record, schemas)
        elif isinstance(record, Metadata) and record.name not in out.metadata:
            out.metadata[record.name] = record.metadata
        elif isinstance(record, Attachment) and record.name not in out.attachments:
            out.attachments[record.name] = record.media_type, record.data
        else:
            raise ValueError("it has no place here, or is there twice")

    def _channel(self, record, schemas):
        out, number, schema = self._out, len(self._out.declared) + 1, schemas[-1]
        if not record.id == record.schema_id == schema.id == number == len(schemas) <= out.limits.channels:
            raise ValueError(f"channel {record.id} is out of order or defined again")
        if record.topic in foxglove.TOPICS:
            name, data = foxglove.TOPICS[record.topic]
            parts, expected = [], (name, data())
        else:
            parts = parts_of(record.topic, record.metadata)
            expected = schema_name(record.topic), schema_data(record.topic, parts)
        encodings = record.message_encoding, schema.encoding
        if record.topic in out.ids or (schema.name, schema.data) != expected or encodings != ("protobuf",) * 2:
            raise ValueError(f"topic {record.topic!r} is there twice, or its schema is not that of its fields")
        if set(out.topics) & {p.name for p in parts}:
            raise ValueError(f"topic {record.topic!r} has a part of another")
        out.topics |= {p.name: p for p in parts}
        out.ids[record.topic] = number
        out.declared.append((record.topic, schema.name, schema.data, record.metadata))

    def _chunk(self, at, length, body):
        """Take the head of a chunk; its content is decompressed and compared when it is asked for."""
        out, limits = self._out, self._out.limits
        start, end, size, crc, name_length = struct.unpack_from("<QQQII", body)
        compression = body[32 : 32 + min(name_length, 16)].decode()
        if len(compression) != name_length or compression not in COMPRESSIONS:
            raise ValueError(f"unknown compression {compression!r}")
        if out.layout is None:
            raise ValueError("a chunk without its channels")
        head = 40 + name_length
        (data_size,) = struct.unpack_from("<Q", body, 32 + name_length)
        if data_size != length - head or "result" in out.metadata:
            raise ValueError("its length is wrong, or it follows the result")
        self._total += size
        if size > min(limits.chunk_bytes, limits.expansion * max(data_size, 1)) or self._total > limits.total_bytes:
            raise ValueError(f"{size} bytes of content, {self._total} so far, are beyond the reader's limits")
        if start % out.dt_ns or end % out.dt_ns or not start <= end < 2**63:
            raise ValueError(f"times {start} to {end} ns are no ticks")
        if out.chunks and start <= out.chunks[-1].end_ns:
            raise ValueError("it begins before the chunk before it ends")
        chunk = Chunk(at, 9 + length, at + 9 + head, data_size, compression, size, crc, start, end)
        if size < sum(out.layout.sizes(*out.ticks(chunk))):
            raise ValueError(f"{size} bytes of content cannot hold its ticks")
        out.chunks.append(chunk)


def load(found: Contents, file: BinaryIO, chunk: Chunk) -> tuple[bytes, np.ndarray]:
    """Return (compressed data, content) of a chunk; raises LogError when a single byte is not as it must be."""
    file.seek(chunk.data_offset)
    data = file.read(chunk.data_size)
    try:
        raw = decompress(data, chunk.size, chunk.compression)
    except FrameError as error:
        raise log_error(str(error), found.path, chunk.offset) from error
    if crc32(raw) != chunk.crc:
        raise log_error("the chunk is damaged (CRC)", found.path, chunk.offset)
    assert found.layout is not None
    content = np.frombuffer(raw, "u1")
    wrong = found.layout.wrong(content, *found.ticks(chunk))
    if wrong is not None:
        raise log_error(f"the chunk is not one message per sample (byte {wrong} of it)", found.path, chunk.offset)
    tail(found, chunk, content)
    return data, content


def tail(found: Contents, chunk: Chunk, content: np.ndarray) -> list[tuple[int, int, int, bytes]]:
    """Return [(channel id, tick, offset, payload)] of the messages after the samples; raises LogError unless whole."""
    assert found.layout is not None
    at = sum(found.layout.sizes(*found.ticks(chunk)))
    data, out, irregular = content.tobytes() if at < len(content) else b"", [], set(found.ids.values())
    irregular -= {found.ids[t.channel] for t in found.topics.values()}
    while at < len(content):
        whole = len(content) - at >= HEAD.size
        op, length, channel, k, ns, publish = HEAD.unpack_from(data, at) if whole else (0,) * 6
        end = at + 9 + length
        if not at + HEAD.size <= end <= len(data) or op != 5 or channel not in irregular:
            raise log_error(f"byte {at} of the chunk begins no message", found.path, chunk.offset)
        if not chunk.start_ns <= ns == publish <= chunk.end_ns or ns != k * found.dt_ns:
            raise log_error("a message has a time outside its chunk", found.path, chunk.offset)
        out.append((channel, k, at, data[at + HEAD.size : end]))
        at = end
    return out


def drop_damaged(found: Contents) -> None:
    """Leave only the whole chunks in the Contents of a log, and add the others to its damage."""
    whole = []
    with open(found.path, "rb") as file:
        for chunk in found.chunks:
            try:
                load(found, file, chunk)
                whole.append(chunk)
            except LogError as error:
                found.damage.append(Damage(chunk.offset, chunk.length, error.problem))
    found.whole = found.whole and len(whole) == len(found.chunks)
    found.chunks = whole
