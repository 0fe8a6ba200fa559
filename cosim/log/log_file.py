"""MCAP records of a log being written, counted for its end; for the writer and for recover."""

import hashlib
import os
import struct
from collections import Counter
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
)  # fmt: skip

from cosim.errors import OutputError
from cosim.files import FULL, LOG, claim, left_by, settle

from .format import LIBRARY, MAGIC, log_error

_SUMMARY = Schema, Channel, Statistics, ChunkIndex, AttachmentIndex, MetadataIndex  # in this order


class Chunk(NamedTuple):
    """One chunk of a log: where its bytes are [byte], what they hold.

    Of one that is written also where its message indexes are, {channel id: (place, messages)}, where they end, and the
    CRC-32 of the file up to there.
    """

    offset: int  # of the record
    end: int  # of the record
    data_offset: int
    data_size: int
    compression: str
    size: int  # decompressed
    crc: int
    start_ns: int
    end_ns: int
    places: Mapping[int, tuple[int, int]] = {}
    index_end: int = 0
    file_crc: int = 0


def encoded(record: Any) -> Any:
    """Return the bytes of a record of the library."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class LogFile:
    """One log being written. Methods raise LogError when writing fails.

    It is written at `path`.part and takes its place in `finish`. Where it is to be `kept`, a kill or a full disk leaves
    the part for `recover`, as far as that holds a tick; otherwise nothing. A chunk counts from the moment at which it
    is in `chunks`: an interrupt anywhere else leaves bytes that the next one overwrites.
    """

    def __init__(self, path: str | os.PathLike, *, kept: bool = True):
        self.path, self.part, self._kept = os.fspath(path), left_by(path), kept
        self.chunks: list[Chunk] = []
        self._begun = 0, 0  # offset and CRC-32 of the file after the preamble
        self._summary: dict[Any, list[bytes]] = {kind: [] for kind in _SUMMARY}
        claim(path, LOG)
        check_no_part(path)
        try:
            self._file = open(self.part, "xb", buffering=0)
        except OSError as error:
            said = f"cannot create the log: {error.strerror}"
            raise log_error(said, self.path, remedy="Choose another place (-o).") from error

    def preamble(self, records: Iterable[Any]) -> None:
        """Write the records that precede the first chunk, Schema, Channel, Metadata and Attachment of the library, and
        a hash of them, with which a log that lost its end can prove that its parameters are whole."""
        out = bytearray(MAGIC + encoded(Header(profile="", library=LIBRARY)))
        for record in records:
            out += self._noted(record, len(out))
        out += self._noted(Metadata("preamble", {"sha256": hashlib.sha256(out).hexdigest()}), len(out))
        self._begun = len(out), crc32(out)
        self._write(0, out)

    def _noted(self, record, offset):
        """Return the bytes of a record that begins at `offset`, note for the summary what it is or where."""
        blob, note = encoded(record), record
        if isinstance(record, Metadata):
            note = MetadataIndex(offset, len(blob), record.name)
        elif isinstance(record, Attachment):
            note = AttachmentIndex(offset, len(blob), 0, 0, len(record.data), record.name, record.media_type)
        self._summary[type(note)].append(encoded(note))
        return blob

    def _end(self):
        """Return (offset, CRC-32) of the file after the last whole chunk."""
        return (self.chunks[-1].index_end, self.chunks[-1].file_crc) if self.chunks else self._begun

    def chunk(self, data: Any, compression: str, times: tuple[int, int], size: int, crc: int, index: Any) -> None:
        """Write a chunk of compressed `data`, whose content has `size` bytes and CRC-32 `crc`; `times` are those of its
        first and last tick [ns], `index` is [(channel id, (messages, 2) of time and offset)]."""
        name, (offset, file_crc) = compression.encode(), self._end()
        head = struct.pack("<BQ", Opcode.CHUNK, 40 + len(name) + len(data))  # the library's own copies the data
        head += struct.pack("<QQQII", *times, size, crc, len(name)) + name + struct.pack("<Q", len(data))
        end, indexes, places = offset + len(head) + len(data), bytearray(), {}
        for channel, entries in index:
            places[channel] = end + len(indexes), len(entries)
            indexes += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + entries.nbytes, channel, entries.nbytes)
            indexes += entries.tobytes()
        self._write(offset, head, data, indexes)
        file_crc = crc32(indexes, crc32(data, crc32(head, file_crc)))
        self.chunks.append(Chunk(offset, end, offset + len(head), len(data), compression, size, crc, *times, places,
                                 end + len(indexes), file_crc))  # fmt: skip

    def finish(self, metadata: Mapping[str, Mapping[str, str]], *, aside: bool = False) -> None:
        """Write `metadata` and the end of the log and put it in its place; `aside` leaves it whole at its part, which
        `path` then names."""
        (offset, crc), out = self._end(), bytearray()
        for name, texts in metadata.items():
            out += self._noted(Metadata(name, dict(texts)), offset + len(out))
        out += encoded(DataEnd(crc32(out, crc)))
        self._write(offset, out, self._summary_at(offset + len(out)))
        try:
            self._file.truncate()
            if aside:
                self.path = os.fspath(self.part)
            else:
                settle(self.part, self.path)
        except OSError as error:
            raise self._failed(error) from error
        self._file.close()

    def _summary_at(self, start):
        """Return the bytes of the summary, which begins at `start`, of the footer and the magic."""
        counts: Counter[int] = Counter()
        for c in self.chunks:
            places = {channel: at for channel, (at, _) in c.places.items()}
            index = ChunkIndex(c.end - c.offset, c.offset, c.compression, c.data_size, c.end_ns, c.index_end - c.end,
                               places, c.start_ns, c.size)  # fmt: skip
            self._summary[ChunkIndex].append(encoded(index))
            counts.update({channel: messages for channel, (_, messages) in c.places.items()})
        count = {kind: len(blobs) for kind, blobs in self._summary.items()}
        self._summary[Statistics] = [encoded(Statistics(
            attachment_count=count[AttachmentIndex], channel_count=count[Channel],
            channel_message_counts=counts, chunk_count=len(self.chunks), schema_count=count[Schema],
            message_count=sum(counts.values()), metadata_count=count[MetadataIndex],
            message_start_time=self.chunks[0].start_ns if self.chunks else 0,
            message_end_time=self.chunks[-1].end_ns if self.chunks else 0,
        ))]  # fmt: skip
        out = b"".join(blob for blobs in self._summary.values() for blob in blobs)
        crc = crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0), crc32(out))
        return out + encoded(Footer(start, 0, crc)) + MAGIC

    def _write(self, offset, *blobs):
        try:
            self._file.seek(offset)
            for blob in blobs:
                view = memoryview(blob)
                while view:  # a raw file may take less than it is given
                    view = view[self._file.write(view) :]
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error):
        remedy = f"{'Free some space or choose' if error.errno in FULL else 'Choose'} another place (-o)."
        if self._kept and self.chunks:
            end = self.chunks[-1].end_ns / 1e9
            remedy += f" What was written up to {end} s is whole: `cosim recover {self.part}` makes it readable."
        self.drop()
        return log_error(f"cannot write the log: {error.strerror}", self.path, None, remedy)

    @property
    def open(self) -> bool:
        """Tell whether the file is still being written."""
        return not self._file.closed

    def drop(self) -> None:
        """Close the file as it is; unless it is to be kept and holds a chunk, it is removed."""
        if self.open:
            self._file.close()
            if not (self._kept and self.chunks):
                self.part.unlink(missing_ok=True)


def check_no_part(path: str | os.PathLike) -> None:
    """Raise OutputError where another run writes the log at `path`, or one that did not end by itself has left it."""
    part = left_by(path)
    if part.exists():
        said = f"{part} is there: another run writes it, or one that did not end by itself has left it"
        remedy = f"`cosim recover {part}` makes it readable, or remove it"
        raise OutputError(said, place=os.fspath(path), remedy=remedy)
