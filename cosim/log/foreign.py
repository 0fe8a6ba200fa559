"""Read MCAP files that others wrote: protobuf or JSON messages, any writer, any order, as one table per channel."""

import contextlib
import io
import json
import math
import os
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.data_stream import ReadDataStream
from mcap.exceptions import UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from cosim.errors import LogError
from cosim.files import regular

from .compression import COMPRESSIONS, decompress
from .format import Limits, log_error
from .walker import BAD

_F = descriptor_pb2.FieldDescriptorProto
_NOT_NUMBERS = {_F.TYPE_STRING, _F.TYPE_BYTES, _F.TYPE_GROUP, _F.TYPE_MESSAGE, _F.TYPE_ENUM}
_NUMBERS = set(range(_F.TYPE_DOUBLE, _F.TYPE_SINT64 + 1)) - _NOT_NUMBERS
_HEAD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
_BAD = (*BAD, RuntimeError)


class _Capped:
    """Read a file, never asking for more than it holds, whatever length a record claims."""

    def __init__(self, file):
        self._file, self._left = file, os.fstat(file.fileno()).st_size

    def read(self, size):
        """Return up to `size` bytes."""
        data = self._file.read(min(size, self._left))
        self._left -= len(data)
        return data


def read_mcap(
    path: str | os.PathLike, *, wanted: Callable[[str], bool] | None = None, limits: Limits | None = None
) -> dict[str, tuple[NDArray, dict[str, NDArray]]]:
    """Return {topic: (times [ns], {field: values})} of an MCAP file, in order of log time, NaN where a field is not.

    Nested fields are joined by dots, elements of arrays counted as in `x[0]`; texts are left out. Only topics that
    `wanted(topic)` accepts are decoded. Checksums are checked where the file has them. Raises LogError for a file that
    is damaged, too large, or without a message to decode.
    """
    limits, path = limits or Limits(), os.fspath(path)
    regular(path, LogError)
    schemas: dict = {}
    channels: dict = {}
    found: dict[str, _Columns] = {}
    skipped = set()
    left = limits.values
    try:
        with open(path, "rb") as file:
            for record in _records(file, limits):
                if isinstance(record, Schema):
                    schemas.setdefault(record.id, record)
                elif isinstance(record, Channel) and record.id not in channels:
                    mine = wanted is None or wanted(record.topic)
                    decode = _decoder(record, schemas.get(record.schema_id)) if mine else None
                    if decode is None and mine:
                        skipped.add(f"{record.topic} ({record.message_encoding})")
                    channels[record.id] = record.topic, decode
                elif isinstance(record, tuple):
                    channel, time, data = record
                    topic, decode = channels[channel]
                    if decode is None:
                        continue
                    if len(data) > limits.message_bytes:
                        raise ValueError(f"a message of {len(data)} bytes is beyond the reader's limit")
                    left -= found.setdefault(topic, _Columns()).add(time, _flat(decode(data)), limits.fields)
                    if left < 0:
                        raise ValueError(f"more than {limits.values} values; map fewer channels or cut the file")
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror}", path) from error
    except UnsupportedCompressionError as error:
        raise log_error(str(error), path, remedy="`pip install lz4` adds it.") from error
    except _BAD as error:
        raise log_error(f"not a readable MCAP file: {str(error) or type(error).__name__}", path) from error
    if not found:
        known = ", ".join(sorted(topic for topic, _ in channels.values())[:20])
        said = f"no protobuf or JSON message of a wanted channel; skipped: {', '.join(sorted(skipped)) or 'nothing'}"
        raise log_error(f"{said}; its topics: {known or 'none'}", path)
    return {topic: columns.arrays() for topic, columns in found.items()}


class _Columns:
    """The messages of one channel as they come: times, and a column per field, 8 bytes per value."""

    def __init__(self) -> None:
        self.times = array("q")
        self.columns: dict[str, array] = {}

    def add(self, time: int, fields: Iterator[tuple[str, float]], most: int) -> int:
        """Take a message; return how many values it added. ValueError for more than `most` fields."""
        row, count = len(self.times), 0
        self.times.append(time)
        for name, value in fields:
            column = self.columns.get(name)
            if column is None:
                if len(self.columns) >= most:
                    raise ValueError(f"a channel with more than {most} fields")
                column = self.columns[name] = array("d")
            if len(column) < row:
                column.extend([math.nan] * (row - len(column)))
                count += row - len(column)
            if len(column) == row:
                column.append(value)
            count += 1
        return count + 1

    def arrays(self) -> tuple[NDArray, dict[str, NDArray]]:
        """Return (times, {field: values}), in order of time."""
        times = np.array(self.times, np.int64)
        order = np.argsort(times, kind="stable")
        out = {}
        for name, column in self.columns.items():
            full = np.full(len(times), math.nan)
            full[: len(column)] = column
            out[name] = full[order]
        return times[order], out


def _records(file, limits) -> Iterator[Any]:
    """Yield the records of the data section, those within chunks too; what a chunk claims is checked first."""
    total = 0
    capped: Any = _Capped(file)
    reader = StreamReader(capped, emit_chunks=True, validate_crcs=True, record_size_limit=limits.record_bytes)
    for record in reader.records:
        if isinstance(record, Message):
            yield record.channel_id, record.log_time, record.data
            continue
        if not isinstance(record, Chunk):
            yield record
            continue
        total += record.uncompressed_size
        if record.uncompressed_size > limits.record_bytes or total > limits.total_bytes:
            raise ValueError(f"chunks of {total} bytes are beyond the reader's limits")
        if record.compression not in COMPRESSIONS:
            raise ValueError(f"unknown compression {record.compression!r}")
        yield from _contents(record)


def _contents(chunk) -> Iterator[Any]:
    """Yield what stands in a chunk: schemas, channels, and messages as (channel, log time, data), undecoded."""
    data = memoryview(decompress(chunk.data, chunk.uncompressed_size, chunk.compression, others=True))
    if chunk.uncompressed_crc and chunk.uncompressed_crc != zlib.crc32(data):
        raise ValueError("a chunk is damaged (CRC)")
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        body = data[at + 9 : at + 9 + length]
        if len(body) != length:
            raise ValueError("a record ends beyond its chunk")
        if opcode == Opcode.MESSAGE:
            channel, _, time, _ = _MESSAGE.unpack_from(body)
            yield channel, time, bytes(body[_MESSAGE.size :])
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            kind = Schema if opcode == Opcode.SCHEMA else Channel
            yield kind.read(ReadDataStream(io.BytesIO(body)))
        at += 9 + length


def _decoder(channel, schema):
    """Return bytes -> dict for a channel, or None when its encoding is not known here."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding != "protobuf" or schema is None:
        return None
    pool = descriptor_pool.DescriptorPool()
    files = {file.name: file for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file}

    def add(file):
        for name in file.dependency:
            if name in files:
                add(files.pop(name))
        pool.Add(file)

    while files:
        add(files.popitem()[1])
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    fields = descriptor_pb2.DescriptorProto()
    kind.DESCRIPTOR.CopyToProto(fields)
    if all(f.type in _NUMBERS and f.label != f.LABEL_REPEATED for f in fields.field):
        names = [f.name for f in fields.field]

        def decode(data):
            made = kind.FromString(data)
            return {name: getattr(made, name) for name in names}

        return decode
    return lambda data: json_format.MessageToDict(
        kind.FromString(data), preserving_proto_field_name=True, always_print_fields_with_no_presence=True
    )


def _flat(value, name=""):
    """Yield (field, number) of a decoded message; 64-bit integers and infinities come as texts from JSON mapping."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _flat(part, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple):
        for i, part in enumerate(value):
            yield from _flat(part, f"{name}[{i}]")
    elif isinstance(value, int | float):
        yield name, float(value)
    elif isinstance(value, str):
        with contextlib.suppress(ValueError):
            yield name, float(value)
