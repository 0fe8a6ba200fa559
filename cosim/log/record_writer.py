"""Record writer of a log file: counts what its end must state; for the writer and for recover."""

import hashlib
import os
import struct
from collections.abc import Mapping, Sequence
from typing import Any

from isal.isal_zlib import crc32
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from cosim.errors import CosimError, OutputError
from cosim.files import FULL, Part, claim, left_by, overwrites

from .format import LIBRARY, OURS, ChunkRef, log_error
from .records import MAGIC, closing

_RECORD = struct.Struct("<BQ")  # opcode and length, before the content of a record
_ELSEWHERE = "Choose another place (-o)."


class Sink:
    """Hold one log being written; `ids` maps topics to channel ids. Methods raise LogError when writing fails.

    It is written beside `path` and takes its place in `finish`. Where it is to be `kept`, a kill or a full disk leaves
    `path`.part for `recover`, as far as that holds a tick; otherwise nothing.
    """

    def __init__(self, path: str | os.PathLike, *, kept: bool = True):
        self.path, self._kept = os.fspath(path), kept
        self.offset = self.crc = 0
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self.ids: dict[str, int] = {}
        self.chunks: list[ChunkRef] = []
        self._metadata: list[tuple[int, int, Metadata]] = []  # offset, length, record
        self._attachments: list[tuple[int, int, Attachment]] = []
        self._digest = hashlib.sha256()
        try:
            if kept:
                free(path)
            self._part = Part(path, OURS, stays=kept)
        except CosimError as error:
            raise log_error(error.problem, self.path, remedy=error.remedy) from None
        except OSError as error:
            raise log_error(f"cannot create the log: {error.strerror}", self.path, remedy=_ELSEWHERE) from error
        self._file = self._part.file

    def preamble(self, declared: Any, metadata: Mapping[str, Any], attachments: Mapping[str, Any]) -> None:
        """Write all that precedes the first chunk, and a hash of it.

        `declared` are (topic, message name, descriptors, channel metadata), `metadata` {name: {str: str}},
        `attachments` {name: (media type, bytes)}. With the hash a log that
        lost its end can prove that its parameters are whole.
        """
        records: list = [Header(profile="", library=LIBRARY)]
        for number, (topic, message, data, texts) in enumerate(declared, 1):
            records.append(Schema(id=number, name=message, encoding="protobuf", data=data))
            records.append(
                Channel(id=number, topic=topic, message_encoding="protobuf", schema_id=number, metadata=texts)
            )
            self.ids[topic] = number
        self.schemas, self.channels = records[1::2], records[2::2]
        self._preamble(MAGIC + b"".join(map(encode, records)))
        for name, texts in metadata.items():
            self.metadata(name, texts)
        for name, (media_type, data) in attachments.items():
            record = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=bytes(data))
            at, blob = self.offset, encode(record)
            self._preamble(blob)
            self._attachments.append((at, len(blob), record))
        self.metadata("preamble", {"sha256": self._digest.hexdigest()})

    def _preamble(self, blob):
        self._digest.update(blob)
        self.put(blob)

    def metadata(self, name: str, texts: dict) -> None:
        """Write a metadata record."""
        at, record = self.offset, Metadata(name=name, metadata=dict(texts))
        blob = encode(record)
        self._preamble(blob)
        self._metadata.append((at, len(blob), record))

    def chunk(self, blobs: Sequence[bytes], ref: ChunkRef) -> None:
        """Write a chunk and its message indexes as they come from records.pack_chunk."""
        self.put(*blobs)
        self.chunks.append(ref)

    def mark(self) -> tuple[int, int, int, int]:
        """Return the place reached, for back_to."""
        return self.offset, self.crc, len(self.chunks), len(self._metadata)

    def back_to(self, mark: Any) -> None:
        """Forget all that was written after a mark, be it half a chunk."""
        self.offset, self.crc, chunks, metadata = mark
        del self.chunks[chunks:], self._metadata[metadata:]
        try:
            self._file.seek(self.offset)
            self._file.truncate()
        except OSError as error:
            raise self._failed(error) from error

    def finish(self, *, aside: bool = False) -> Any:
        """Write the end of the log and close the file; `aside` leaves it at `path`.part, which `path` then names."""
        found = self.chunks, self._attachments, self._metadata
        for blob in closing(self.offset, self.crc, self.schemas, self.channels, *found):
            self._write(blob)
        try:
            self._part.done(aside=aside)
            self.path = os.fspath(self._part.place) if aside else self.path
        except OSError as error:
            raise self._failed(error) from error

    def put(self, *blobs: Any) -> None:
        """Write bytes of the data section and count them."""
        crc = self.crc
        for blob in blobs:
            self._write(blob)
            crc = crc32(blob, crc)
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


def free(path: str | os.PathLike) -> None:
    """Raise OutputError where a killed flight has left ticks that a flight to `path` would write over."""
    left = left_by(path)
    claim(left, OURS)
    if left.is_file() and not overwrites() and _holds_chunk(left):
        raise OutputError(f"a killed flight left {left}", place=os.fspath(path),
                          remedy=f"`cosim recover {left}` makes it readable; --overwrite lets it go")  # fmt: skip


def _holds_chunk(path):
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


def encode(record: Any) -> Any:
    """Return the bytes of a record of the library."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
