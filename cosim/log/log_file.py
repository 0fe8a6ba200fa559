"""MCAP records of a log being written, counted for its end; for the writer and for recover."""

import hashlib
import os
import struct
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from isal.isal_zlib import crc32
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)  # fmt: skip

from cosim.errors import CosimError, OutputError
from cosim.files import FULL, Part, claim, left_by

from .format import LIBRARY, MAGIC, OURS, log_error

_RECORD = struct.Struct("<BQ")  # opcode and length, before the content of a record
_ELSEWHERE = "Choose another place (-o)."


class Chunk(NamedTuple):
    """One chunk of a log: where its bytes are [byte], what they hold."""

    offset: int  # of the record
    length: int  # of the record with its head
    data_offset: int
    data_size: int
    compression: str
    size: int  # decompressed
    crc: int
    start_ns: int
    end_ns: int


def encoded(record: Any) -> Any:
    """Return the bytes of a record of the library."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class LogFile:
    """One log being written; `ids` maps channels to their ids. Methods raise LogError when writing fails.

    It is written beside `path` and takes its place in `finish`. Where it is to be `kept`, a kill or a full disk leaves
    `path`.part for `recover`, as far as that holds a tick; otherwise nothing.
    """

    def __init__(self, path: str | os.PathLike, *, kept: bool = True):
        self.path, self._kept = os.fspath(path), kept
        self.offset = self.crc = 0
        self.ids: dict[str, int] = {}
        self.chunks: list[Chunk] = []
        self._summary: dict[Opcode, list[bytes]] = {opcode: [] for opcode in _ORDER}
        self._counts: dict[int, int] = {}
        self._digest: Any = hashlib.sha256()
        try:
            if kept:
                free(path)
            self._part = Part(path, OURS, stays=kept)
        except CosimError as error:
            raise log_error(error.problem, self.path, remedy=error.remedy) from None
        except OSError as error:
            raise log_error(f"cannot create the log: {error.strerror}", self.path, remedy=_ELSEWHERE) from error
        self._file = self._part.file

    def preamble(self, declared: Iterable[Any], metadata: Mapping[str, Any], attachments: Mapping[str, Any]) -> None:
        """Write all that precedes the first chunk, and a hash of it, with which a log that lost its end can prove that
        its parameters are whole.

        `declared` are (channel, message name, descriptors, channel metadata), `metadata` {name: {str: str}},
        `attachments` {name: (media type, bytes)}.
        """
        self._put(MAGIC + encoded(Header(profile="", library=LIBRARY)))
        for number, (topic, message, data, texts) in enumerate(declared, 1):
            own = {"topic": topic, "message_encoding": "protobuf", "schema_id": number, "metadata": texts}
            schema = Schema(id=number, name=message, encoding="protobuf", data=data)
            for opcode, record in ((Opcode.SCHEMA, schema), (Opcode.CHANNEL, Channel(id=number, **own))):
                self._summary[opcode].append(encoded(record))
                self._put(self._summary[opcode][-1])
            self.ids[topic] = number
        for name, texts in metadata.items():
            self.metadata(name, texts)
        for name, (media_type, data) in attachments.items():
            at, blob = self.offset, encoded(Attachment(0, 0, name, media_type, bytes(data)))
            index = AttachmentIndex(at, len(blob), 0, 0, len(data), name, media_type)
            self._summary[Opcode.ATTACHMENT_INDEX].append(encoded(index))
            self._put(blob)
        digest, self._digest = self._digest.hexdigest(), None
        self.metadata("preamble", {"sha256": digest})

    def metadata(self, name: str, texts: dict) -> None:
        """Write a metadata record."""
        blob = encoded(Metadata(name=name, metadata=dict(texts)))
        self._summary[Opcode.METADATA_INDEX].append(encoded(MetadataIndex(self.offset, len(blob), name)))
        self._put(blob)

    def chunk(self, data: Any, compression: str, times: tuple[int, int], size: int, crc: int, index: Any) -> None:
        """Write a chunk of compressed `data`, whose content has `size` bytes and CRC-32 `crc`; `times` are those of its
        first and last tick [ns], `index` is [(channel id, (messages, 2) of time and offset)]."""
        name, offset = compression.encode(), self.offset
        head = _RECORD.pack(Opcode.CHUNK, 40 + len(name) + len(data))  # the library's own copies the data three times
        head += struct.pack("<QQQII", *times, size, crc, len(name)) + name + struct.pack("<Q", len(data))
        begin, indexes, places, counts = offset + len(head) + len(data), bytearray(), {}, {}
        for channel, entries in index:
            places[channel], counts[channel] = begin + len(indexes), len(entries)
            indexes += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + entries.nbytes, channel, entries.nbytes)
            indexes += entries.tobytes()
        length = begin - offset
        self._put(head, data, indexes)
        record = ChunkIndex(length, offset, compression, len(data), times[1], len(indexes), places, times[0], size)
        self._summary[Opcode.CHUNK_INDEX].append(encoded(record))
        self._counts = {**self._counts, **{c: self._counts.get(c, 0) + n for c, n in counts.items()}}
        self.chunks.append(Chunk(offset, length, offset + len(head), len(data), compression, size, crc, *times))

    def mark(self) -> tuple:
        """Return the place reached, for back_to."""
        return self.offset, self.crc, len(self.chunks), self._counts, {k: len(v) for k, v in self._summary.items()}

    def back_to(self, mark: Any) -> None:
        """Forget all that was written after a mark, be it half a chunk."""
        self.offset, self.crc, chunks, self._counts, summary = mark
        del self.chunks[chunks:]
        for opcode, count in summary.items():
            del self._summary[opcode][count:]
        try:
            self._file.seek(self.offset)
            self._file.truncate()
        except OSError as error:
            raise self._failed(error) from error

    def finish(self, *, aside: bool = False) -> None:
        """Write the end of the log and close the file; `aside` leaves it at `path`.part, which `path` then names."""
        end = encoded(DataEnd(self.crc))
        at = start = self.offset + len(end)
        count = {opcode: len(blobs) for opcode, blobs in self._summary.items()}
        self._summary[Opcode.STATISTICS] = [encoded(Statistics(
            attachment_count=count[Opcode.ATTACHMENT_INDEX], channel_count=count[Opcode.CHANNEL],
            channel_message_counts=self._counts, chunk_count=len(self.chunks), schema_count=count[Opcode.SCHEMA],
            message_count=sum(self._counts.values()), metadata_count=count[Opcode.METADATA_INDEX],
            message_start_time=self.chunks[0].start_ns if self.chunks else 0,
            message_end_time=self.chunks[-1].end_ns if self.chunks else 0,
        ))]  # fmt: skip
        summary, offsets = bytearray(), bytearray()
        for opcode, blobs in self._summary.items():
            before = at
            for blob in blobs:
                summary += blob
                at += len(blob)
            if at > before:
                offsets += encoded(SummaryOffset(opcode, before, at - before))
        summary += offsets
        crc = crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, at), crc32(summary))
        self._write(end + bytes(summary) + encoded(Footer(start, at, crc)) + MAGIC)
        try:
            self._part.done(aside=aside)
            self.path = os.fspath(self._part.place) if aside else self.path
        except OSError as error:
            raise self._failed(error) from error

    def _put(self, *blobs):
        """Write bytes of the data section and count them."""
        crc = self.crc
        for blob in blobs:
            self._write(blob)
            crc = crc32(blob, crc)
            if self._digest is not None:
                self._digest.update(blob)
        self.offset, self.crc = self.offset + sum(map(len, blobs)), crc

    def _write(self, blob):
        view = memoryview(blob)
        try:
            while view:  # a raw file may take less than it is given
                view = view[self._file.write(view) :]
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error):
        remedy = f"{'Free some space or choose' if error.errno in FULL else 'Choose'} another place (-o)."
        stays = self._kept and bool(self.chunks)
        if stays:
            end = self.chunks[-1].end_ns / 1e9
            remedy += f" What was written up to {end} s is whole: `cosim recover {self._part.place}` makes it readable."
        self._part.drop(stays=stays)
        return log_error(f"cannot write the log: {error.strerror}", self.path, self.offset, remedy)

    @property
    def open(self) -> bool:
        """Tell whether the file is still being written."""
        return not self._file.closed

    def drop(self) -> None:
        """Close the file as it is; unless it is to be kept and holds a chunk, it is removed."""
        self._part.drop(stays=self._kept and bool(self.chunks))


_ORDER = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX,
          Opcode.METADATA_INDEX)  # fmt: skip


def free(path: str | os.PathLike) -> None:
    """Raise OutputError where a killed flight has left ticks that a flight to `path` would write over."""
    left = left_by(path)
    claim(left, OURS)
    if left.is_file() and holds_chunk(left):
        raise OutputError(f"a killed flight left {left}", place=os.fspath(path),
                          remedy=f"`cosim recover {left}` makes it readable; or remove it")  # fmt: skip


def holds_chunk(path: Any) -> bool:
    """Tell whether a log that was cut anywhere holds a whole chunk."""
    with open(path, "rb") as file:
        at, size = len(MAGIC), path.stat().st_size
        while at + _RECORD.size <= size:
            file.seek(at)
            opcode, length = _RECORD.unpack(file.read(_RECORD.size))
            at += _RECORD.size + length
            if opcode == Opcode.CHUNK:
                return at <= size
    return False
