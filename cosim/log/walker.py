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
from .compression import COMPRESSIONS, decompress
from .format import LIBRARY, MAGIC, MOST_CHUNK, READ_BY, LogError, log_error, parts_of
from .layout import Layout
from .log_file import Chunk

_RECORD, _FOOTER = struct.Struct("<BQ"), struct.Struct("<BQQQI8s")
_CUT = "the log has no end: its run was killed or the disk was full"
_RECOVER = "`cosim recover` makes a readable log of what is whole."
# what a record's parser may raise on bytes that are not what they should be
BAD = (
    McapError, DecodeError, struct.error, ValueError, KeyError, TypeError, AttributeError, OverflowError, MemoryError,
    RecursionError,
)  # fmt: skip
_KINDS: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata,
                          Opcode.ATTACHMENT: Attachment}  # fmt: skip


@dataclass
class Contents:
    """What the records of one log say.

    `records` are those of the preamble, `topics` {name: Topic without rows}, `ids` {channel: id}, `layout` that of the
    chunks, `damage` [{offset, bytes, reason}], `whole` whether the checksum of all data agrees, `closed` whether the
    log has its end too, `at` the byte at which the record being read begins, `crc` the checksum of those before.
    """

    path: str
    size: int
    at: int = len(MAGIC)
    crc: int = crc32(MAGIC)
    records: list = field(default_factory=list)
    metadata: dict = field(default_factory=dict)
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
                found.damage.append({"offset": found.at, "bytes": found.size - found.at, "reason": error.problem})
            for chunk in [*found.chunks] if tolerant else ():
                try:
                    load(found, file, chunk)
                except LogError as error:
                    found.chunks.remove(chunk)
                    found.whole = False
                    size = chunk.end - chunk.offset
                    found.damage.append({"offset": chunk.offset, "bytes": size, "reason": error.problem})
            return found
    except OSError as error:
        raise log_error(f"cannot read the log: {error.strerror}", path) from error


def _walk(found, file):
    """Take all records of a log."""
    if file.read(len(MAGIC)) != MAGIC:
        raise log_error("not an MCAP file", found.path, 0, "" if found.size else "It is empty.")
    stream = _records(found, file)
    try:
        _preamble(found, stream)
        for opcode, body in stream:
            if opcode == Opcode.CHUNK:
                found.chunks.append(_chunk(found, body))
            elif opcode == Opcode.METADATA:
                record = _parsed(Metadata, body)
                found.metadata[record.name] = record.metadata
            elif opcode == Opcode.DATA_END:
                return _end(found, body, file.read())
            elif opcode != Opcode.MESSAGE_INDEX:
                raise ValueError("it has no place here")
        raise log_error(_CUT, found.path, found.at, _RECOVER * bool(found.chunks))
    except BAD as error:
        said = f"damaged or foreign record: {str(error) or type(error).__name__}"
        raise log_error(said, found.path, found.at) from error


def _records(found: Contents, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield (opcode, content) of the records behind the magic. Raises LogError for one that does not fit."""
    while head := file.read(_RECORD.size):
        opcode, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, found.size)
        # whatever length one claims behind the preamble, none is read that is longer than a chunk may be
        if length > min(found.size - found.at - _RECORD.size, 2 * MOST_CHUNK if found.layout else found.size):
            raise log_error(_CUT, found.path, found.at, _RECOVER * bool(found.chunks))
        body = file.read(length)
        yield opcode, body
        found.crc = crc32(body, crc32(head, found.crc))
        found.at += _RECORD.size + length


def _parsed(kind, body):
    return kind.read(ReadDataStream(io.BytesIO(body)))


def _preamble(found, stream):
    """Take the records before the first chunk; their hash is compared before any but the first is parsed."""
    digest = hashlib.sha256(MAGIC)
    kept: list[tuple[int, bytes]] = []
    for opcode, body in stream:
        if not kept:
            _check_header(found, _parsed(Header, body).library)
        if opcode == Opcode.CHUNK or (opcode == Opcode.METADATA and body[4:12] == b"preamble"):
            break
        digest.update(_RECORD.pack(opcode, len(body)) + body)
        kept.append((opcode, body))
    else:
        raise log_error("the log ends before its first tick", found.path, found.at)
    if digest.hexdigest().encode() not in body:
        raise ValueError("the parameters before the first tick are not what was written")
    found.records = [_parsed(_KINDS[opcode], own) for opcode, own in kept[1:]]
    found.metadata = {r.name: r.metadata for r in found.records if isinstance(r, Metadata)}
    found.metadata["preamble"] = {"sha256": digest.hexdigest()}
    for channel in (r for r in found.records if isinstance(r, Channel)):
        found.ids[channel.topic] = channel.id
        parts = [] if channel.topic in foxglove.TOPICS else parts_of(channel.topic, channel.metadata)
        found.topics |= {p.name: p for p in parts}
    found.dt_ns = int(found.metadata["log"]["dt_ns"])
    if found.dt_ns <= 0 or not found.topics:
        raise ValueError("it has no tick, or no topic")
    found.layout = Layout(list(found.topics.values()), found.ids, found.dt_ns)


def _check_header(found, library):
    name, _, number = library.rpartition(" ")
    if name == LIBRARY.rpartition(" ")[0] and number in READ_BY:
        raise log_error(f"written in format {number}, which {READ_BY[number]} reads", found.path)
    if library != LIBRARY:
        raise ValueError(f"written by {library!r}, not {LIBRARY!r}; `cosim replay --map` reads it")


def _chunk(found, body):
    """Return the Chunk of a record; its content is decompressed and compared when it is asked for."""
    start, end, size, crc, length = struct.unpack_from("<QQQII", body)
    (stated,), compression = struct.unpack_from("<Q", body, 32 + length), body[32 : 32 + min(length, 16)].decode()
    head, before = found.at + _RECORD.size + 40 + length, found.chunks[-1].end_ns if found.chunks else -1
    chunk = Chunk(found.at, head + stated, head, stated, compression, size, crc, start, end)
    for wrong, said in (
        (compression not in COMPRESSIONS or len(compression) != length, f"unknown compression {compression!r}"),
        (40 + length + stated != len(body), "its length is wrong"),
        (size > MOST_CHUNK, f"{size} bytes of content are beyond the reader's limit"),
        (not before < start <= end < 2**63, f"times {start} to {end} ns do not follow those before"),
        (size < sum(found.layout.sizes(*found.ticks(chunk))), f"{size} bytes of content cannot hold its ticks"),
    ):
        if wrong:
            raise ValueError(said)
    return chunk


def _end(found, body, summary):
    """Check the sums over the data and over the summary, behind which the file ends."""
    start = found.at + _RECORD.size + len(body)
    if body != struct.pack("<I", found.crc):
        raise log_error("the data are damaged (CRC)", found.path, None, _RECOVER)
    found.whole = True
    if summary[-_FOOTER.size :] != _FOOTER.pack(Opcode.FOOTER, 20, start, 0, crc32(summary[:-12]), MAGIC):
        raise log_error("the summary has no end, or is damaged (CRC)", found.path, start, _RECOVER)
    found.closed = True


def load(found: Contents, file: BinaryIO, chunk: Chunk) -> tuple[bytes, np.ndarray]:
    """Return (compressed data, content) of a chunk; raises LogError when a single byte is not as it must be."""
    file.seek(chunk.data_offset)
    data = file.read(chunk.data_size)
    try:
        raw = np.frombuffer(decompress(data, chunk.size, chunk.compression), "u1")
        if crc32(raw) != chunk.crc:
            raise ValueError("the chunk is damaged (CRC)")
        found.layout.check(raw, *found.ticks(chunk))
    except ValueError as error:
        raise log_error(str(error), found.path, chunk.offset) from error
    return data, raw


def content(found: Contents, number: int) -> np.ndarray:
    """Return the content (bytes,) of a chunk; raises LogError as `load`, or where the file cannot be read."""
    try:
        with open(found.path, "rb") as file:
            return load(found, file, found.chunks[number])[1]
    except OSError as error:
        raise log_error(f"cannot read the log: {error.strerror}", found.path) from error
