"""Records of an MCAP file within bounds, and what those of a log of ours say.

Strict: checksums of all data and of the preamble are compared, and whatever is not as it was written is refused with
its place. Tolerant: the chunks that are whole are kept up to the first record that is damaged, what is lost is listed.
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
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from cosim.files import regular

from . import foxglove
from .compression import COMPRESSIONS, FrameError, decompress
from .format import LIBRARY, MAGIC, MOST_CHUNK, READ_BY, Damage, LogError, log_error, parts_of
from .layout import HEAD, Layout
from .log_file import Chunk

_RECORD, _FOOTER, _DATA_END = struct.Struct("<BQ"), struct.Struct("<BQQQI8s"), struct.Struct("<BQI")
_CHUNK_HEAD = 64  # bytes that a chunk's head takes at most, with its compression's name and the length of its data
_CUT = "the log has no end: its run was killed or the disk was full"
_RECOVER = "`cosim recover` makes a readable log of what is whole."
# what a record's parser may raise on bytes that are not what they should be
BAD = (
    McapError, DecodeError, struct.error, ValueError, KeyError, TypeError, AttributeError, OverflowError, MemoryError,
    RecursionError,
)  # fmt: skip
_KINDS: dict[int, Any] = {Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel,
                          Opcode.METADATA: Metadata, Opcode.ATTACHMENT: Attachment}  # fmt: skip
_READ = {Opcode.CHUNK: _CHUNK_HEAD, Opcode.MESSAGE_INDEX: 0}  # bytes that are read of a record, if not all


@dataclass
class Contents:
    """What the records of one log say.

    `topics` {name: Topic without rows}, `ids` {channel: id}, `declared` [(channel, message name, descriptors,
    metadata)], `layout` of the chunks, `damage` what is lost, `whole` whether the checksum of all data agrees,
    `closed` whether the log has its end too, `at` the byte at which the record being read begins.
    """

    path: str
    size: int
    at: int = 0
    declared: list = field(default_factory=list)
    metadata: dict = field(default_factory=dict)
    attachments: dict = field(default_factory=dict)  # name -> (media type, bytes)
    chunks: list[Chunk] = field(default_factory=list)
    topics: dict = field(default_factory=dict)
    ids: dict = field(default_factory=dict)
    dt_ns: int = 0
    layout: Any = None
    damage: list = field(default_factory=list)
    whole: bool = False
    closed: bool = False

    def ticks(self, chunk: Chunk) -> tuple[int, int]:
        """Return (first tick, number of ticks) of a chunk."""
        return chunk.start_ns // self.dt_ns, (chunk.end_ns - chunk.start_ns) // self.dt_ns + 1


def scan(path: str | Path, tolerant: bool = False) -> Contents:
    """Return the Contents of a log; raises LogError when it cannot be read, is foreign or damaged.

    With `tolerant` damage after the preamble is listed in the Contents instead.
    """
    path = os.fspath(path)
    regular(path, LogError)
    try:
        with open(path, "rb") as file:
            found = Contents(path, os.fstat(file.fileno()).st_size)
            try:
                _walk(found, file)
            except LogError as error:
                if not tolerant or found.layout is None:
                    raise
                found.damage.append(Damage(found.at, found.size - found.at, error.problem))
            if tolerant:
                found.chunks = [chunk for chunk in found.chunks if _is_whole(found, file, chunk)]
            return found
    except OSError as error:
        raise log_error(f"cannot read the log: {error.strerror}", path) from error


def _walk(found, file):
    """Take all records of a log."""
    if file.read(len(MAGIC)) != MAGIC:
        raise log_error("not an MCAP file", found.path, 0, "" if found.size else "It is empty.")
    opcode, stream = None, _records(found, file)
    try:
        _preamble(found, file, stream)
        for opcode, length, body in stream:
            if opcode == Opcode.CHUNK:
                found.chunks.append(_chunk(found, length, body))
            elif opcode == Opcode.METADATA:
                record = Metadata.read(ReadDataStream(io.BytesIO(body)))
                found.metadata[record.name] = record.metadata
            elif opcode == Opcode.DATA_END:
                return _end(found, file)
            elif opcode != Opcode.MESSAGE_INDEX:
                raise ValueError("it has no place here")
        raise log_error(_CUT, found.path, found.at, _RECOVER)
    except LogError:
        raise
    except BAD as error:
        said = f"damaged or foreign record: {str(error) or type(error).__name__}"
        raise log_error(said, found.path, found.at) from error


def _records(found: Contents, file: BinaryIO) -> Iterator[tuple[int, int, bytes]]:
    """Yield (opcode, length of the content, content) of the records behind the magic; `found.at` is where one begins.

    Of a chunk only the head is read, of a message index nothing. Raises LogError for one that does not fit.
    """
    found.at = len(MAGIC)
    while found.at < found.size:
        file.seek(found.at)
        head = file.read(_RECORD.size)
        opcode, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, found.size)
        if length > found.size - found.at - _RECORD.size:
            raise log_error(_CUT, found.path, found.at, _RECOVER)
        yield opcode, length, file.read(min(length, _READ.get(opcode, length)))
        found.at += _RECORD.size + length


def _preamble(found, file, stream):
    """Take the records before the first chunk; their hash is compared before any is parsed."""
    kept: list[tuple[int, bytes]] = []
    for opcode, _, body in stream:
        if not kept:
            _check_header(found, _KINDS[opcode].read(ReadDataStream(io.BytesIO(body))))
        if opcode == Opcode.CHUNK or (opcode == Opcode.METADATA and body[4:12] == b"preamble"):
            break
        kept.append((opcode, body))
    else:
        raise log_error("the log ends before its first tick", found.path, found.at)
    file.seek(0)
    digest = hashlib.sha256(file.read(found.at)).hexdigest()
    if digest.encode() not in body:
        raise ValueError("the parameters before the first tick are not what was written")
    schemas, found.metadata["preamble"] = {}, {"sha256": digest}
    for opcode, body in kept:
        record = _KINDS[opcode].read(ReadDataStream(io.BytesIO(body)))
        if opcode == Opcode.SCHEMA:
            schemas[record.id] = record
        elif opcode == Opcode.CHANNEL:
            schema = schemas[record.schema_id]
            found.ids[record.topic] = record.id
            found.declared.append((record.topic, schema.name, schema.data, record.metadata))
            parts = [] if record.topic in foxglove.TOPICS else parts_of(record.topic, record.metadata)
            found.topics |= {p.name: p for p in parts}
        elif opcode == Opcode.METADATA:
            found.metadata[record.name] = record.metadata
        elif opcode == Opcode.ATTACHMENT:
            found.attachments[record.name] = record.media_type, record.data
    found.dt_ns = int(found.metadata["log"]["dt_ns"])
    if found.dt_ns <= 0 or not found.topics:
        raise ValueError("it has no tick, or no topic")
    found.layout = Layout(list(found.topics.values()), found.ids, found.dt_ns)


def _check_header(found, header):
    name, _, number = header.library.rpartition(" ")
    if name == LIBRARY.rpartition(" ")[0] and number in READ_BY:
        raise log_error(f"written in format {number}, which {READ_BY[number]} reads", found.path)
    if header.library != LIBRARY:
        raise ValueError(f"written by {header.library!r}, not {LIBRARY!r}; `cosim replay --map` reads it")


def _chunk(found, length, body):
    """Return the Chunk of a head; its content is decompressed and compared when it is asked for."""
    start, end, size, crc, name_length = struct.unpack_from("<QQQII", body)
    compression = body[32 : 32 + min(name_length, 16)].decode()
    if compression not in COMPRESSIONS or len(compression) != name_length:
        raise ValueError(f"unknown compression {compression!r}")
    head = 40 + name_length
    if struct.unpack_from("<Q", body, 32 + name_length) != (length - head,):
        raise ValueError("its length is wrong")
    if size > MOST_CHUNK:
        raise ValueError(f"{size} bytes of content are beyond the reader's limit")
    if not start <= end < 2**63 or (found.chunks and start <= found.chunks[-1].end_ns):
        raise ValueError(f"times {start} to {end} ns do not follow those before")
    begin = found.at + _RECORD.size
    chunk = Chunk(found.at, begin + length, begin + head, length - head, compression, size, crc, start, end)
    if size < sum(found.layout.sizes(*found.ticks(chunk))):
        raise ValueError(f"{size} bytes of content cannot hold its ticks")
    return chunk


def _end(found, file):
    """Check the sums over the data, the samples and the summary, whose end is that of the file."""
    start = found.at + _DATA_END.size
    file.seek(found.at)
    if _DATA_END.unpack(file.read(_DATA_END.size))[2] != _crc(file, 0, found.at):
        raise log_error("the data are damaged (CRC)", found.path, None, _RECOVER)
    found.whole = True
    file.seek(max(start, found.size - _FOOTER.size))
    footer = file.read()
    opcode, length, summary, _, crc, magic = _FOOTER.unpack(footer) if len(footer) == _FOOTER.size else (0,) * 6
    if (opcode, length, summary, magic) != (Opcode.FOOTER, 20, start, MAGIC):
        raise log_error("the summary has no end", found.path, start, _RECOVER)
    if crc != _crc(file, start, found.size - 12):
        raise log_error("the summary is damaged (CRC)", found.path, start, _RECOVER)
    found.closed = True


def _crc(file, start, stop):
    file.seek(start)
    crc = 0
    while start < stop and (block := file.read(min(1 << 20, stop - start))):
        crc, start = crc32(block, crc), start + len(block)
    return crc


def _is_whole(found, file, chunk):
    """Tell whether a chunk can be loaded; what cannot is damage."""
    try:
        load(found, file, chunk)
    except LogError as error:
        found.damage.append(Damage(chunk.offset, chunk.end - chunk.offset, error.problem))
        found.whole = False
        return False
    return True


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
    content = np.frombuffer(raw, "u1")
    wrong = found.layout.wrong(content, *found.ticks(chunk))
    if wrong is not None:
        raise log_error(f"the chunk is not one message per sample (byte {wrong} of it)", found.path, chunk.offset)
    tail(found, chunk, content)
    return data, content


def tail(found: Contents, chunk: Chunk, content: np.ndarray) -> list[tuple[int, int, int, bytes]]:
    """Return [(channel id, tick, offset, payload)] of the messages after the samples; raises LogError unless whole."""
    at = sum(found.layout.sizes(*found.ticks(chunk)))
    data, out = content[at:].tobytes().rjust(len(content), b"\0"), []
    while at < len(data):
        op, length, channel, k, ns, _ = HEAD.unpack_from(data, at) if at + HEAD.size <= len(data) else (0,) * 6
        end = at + 9 + length
        if not at + HEAD.size <= end <= len(data) or op != Opcode.MESSAGE:
            raise log_error(f"byte {at} of the chunk begins no message", found.path, chunk.offset)
        if not chunk.start_ns <= ns == k * found.dt_ns <= chunk.end_ns:
            raise log_error("a message has a time outside its chunk", found.path, chunk.offset)
        out.append((channel, k, at, data[at + HEAD.size : end]))
        at = end
    return out
