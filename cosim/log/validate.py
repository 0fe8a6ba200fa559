"""Validation of a log's records, within limits; whatever this package would not have written is refused with its place.

Strict: checksums first, then every record must encode back to its own bytes, and the end of the file must be the
one that follows from its data; so nothing is taken unchecked. Tolerant: keep what is whole and list what is lost.
"""

import hashlib
import os
import struct
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError
from isal.isal_zlib import crc32
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from cosim.files import regular

from .contents import HEAD_BYTES, LARGE, Contents, decode
from .format import Damage, LogError, log_error
from .records import MAGIC, closing, content_hash

_FOOTER = 9 + 20 + len(MAGIC)  # the last bytes of a log: footer record and magic
_DATA_END = 9 + 4
_RECOVER = "`cosim recover` makes a readable log of what is whole."
# what a record's parser may raise on bytes that are not what they should be
BAD = (
    McapError, DecodeError, struct.error, ValueError, KeyError, TypeError, OverflowError, MemoryError, RecursionError,
)  # fmt: skip
_VITAL = (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL)  # without each of them no chunk can be read


def scan(path: str | Path, limits: Any, tolerant: bool = False) -> Contents:
    """Return the Contents of a log; raises LogError when it cannot be read, is foreign, damaged or beyond a limit.

    With `tolerant`, damage is listed in the Contents instead, as long as there is a log to speak of.
    """
    path = os.fspath(path)
    regular(path, LogError)
    try:
        with open(path, "rb") as file:
            about = os.fstat(file.fileno())
            out = Contents(path, about.st_size, limits, tolerant, identity=identity(about))
            if file.read(len(MAGIC)) != MAGIC:
                raise log_error("not an MCAP file", path, 0, "" if out.size else "It is empty.")
            return _tolerant(out, file) if tolerant else _strict(out, file)
    except OSError as error:
        raise log_error(f"cannot read the log: {error.strerror}", path) from error


def identity(about: os.stat_result) -> tuple[int, ...]:
    """Return what tells a file, and whether it was written to."""
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns


def _strict(out, file):
    stop, crc = _ends(out, file)
    if _crc(file, 0, stop) != crc:
        raise log_error("the data are damaged (CRC)", out.path, None, _RECOVER)
    _walk(out, file, len(MAGIC), stop)
    out.finish()
    result = next((r.metadata for _, _, r in out.metadata if r.name == "result"), None)
    if result is not None and result.get("content") != content_hash(out.chunks):
        raise log_error("the samples are not those of the result", out.path, out.metadata[-1][0])
    file.seek(stop)
    expected = closing(stop, crc, out.schemas, out.channels, out.chunks, out.attachments, out.metadata)
    if not all(file.read(len(blob)) == blob for blob in expected) or file.read(1):
        raise log_error("the summary does not agree with the data", out.path, stop)
    out.whole = out.closed = True
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
    while start < stop:
        block = file.read(min(1 << 20, stop - start))
        if not block:
            break
        crc, start = crc32(block, crc), start + len(block)
    return crc


def _walk(out, file, at, stop):
    """Give the records from `at` to `stop` to the Contents; raises LogError at the first that is wrong."""
    file.seek(at)
    digest = hashlib.sha256(MAGIC) if at == len(MAGIC) else None  # of all before the first chunk
    while at < stop:
        out.place = at
        out.records += 1
        head = file.read(9)
        if len(head) < 9:
            raise log_error("the file ends inside a record", out.path, at)
        opcode, length = struct.unpack("<BQ", head)
        if length > out.limits.record_bytes or out.records > out.limits.records:
            raise log_error(f"record {out.records}, of {length} bytes, is beyond the reader's limits", out.path, at)
        if length > stop - at - 9:
            raise log_error(f"a record of {length} bytes does not fit before byte {stop}", out.path, at)
        needed = min(length, HEAD_BYTES) if opcode in LARGE else length
        body = file.read(needed)
        if len(body) < needed:
            raise log_error("the file ends inside a record", out.path, at)
        if opcode == Opcode.DATA_END and out.tolerant:
            out.whole = length == 4 and struct.unpack("<I", body)[0] == _crc(file, 0, at)
            return
        try:
            out.take(at, opcode, length, body, digest)
        except BAD as error:
            problem = f"damaged or foreign record {opcode}: {str(error) or type(error).__name__}"
            if not out.tolerant or opcode in _VITAL:
                raise log_error(problem, out.path, at) from error
            out.damage.append(Damage(at, 9 + length, problem))
        at += 9 + length
        if opcode in LARGE:
            digest = None
            if opcode == Opcode.CHUNK and not out.tolerant:
                at += out.indexes(file, stop)
            file.seek(at)
        elif digest is not None:
            digest.update(head + body)
    out.place = at


def _tolerant(out, file):
    """Take what is whole; where a record's own length is damaged, go on at the next chunk that the summary names."""
    try:
        stop, crc = _ends(out, file)
        out.whole = _crc(file, 0, stop) == crc
        starts = _chunk_starts(out, file, stop)
    except LogError as error:
        out.damage.append(Damage(out.size, 0, error.problem))
        stop, starts = out.size, []
    at = len(MAGIC)
    while at < stop:
        try:
            _walk(out, file, at, stop)
            break
        except LogError as error:
            at = next((start for start in starts if start > out.place), stop)
            out.damage.append(Damage(out.place, at - out.place, error.problem))
    if out.layout is None:
        reason = out.damage[0].reason if out.damage else "it has no channels"
        raise log_error(f"nothing can be recovered: {reason}", out.path, out.damage[0].offset if out.damage else None)
    return out


def _chunk_starts(out, file, stop):
    """Return where the summary, whose checksum agrees, says that chunks begin."""
    file.seek(stop + _DATA_END)
    starts: list = []
    while True:
        head = file.read(9)
        if len(head) < 9:
            return starts
        opcode, length = struct.unpack("<BQ", head)
        if length > out.limits.record_bytes or opcode == Opcode.FOOTER:
            return starts
        body = file.read(length)
        if opcode == Opcode.CHUNK_INDEX:
            try:
                starts.append(decode(ChunkIndex, opcode, body).chunk_start_offset)
            except BAD as error:
                raise log_error(f"damaged chunk index: {error}", out.path, stop) from error
