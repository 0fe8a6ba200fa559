"""Read MCAP files that others wrote: protobuf or JSON messages, any writer, any order, as one table per channel."""

import io
import json
import os
from collections.abc import Iterator
from typing import Any

import lz4.frame
import zstandard
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.exceptions import UnsupportedCompressionError
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from cosim.errors import LogError
from cosim.files import regular

from .format import Limits, log_error
from .scan import BAD

_F = descriptor_pb2.FieldDescriptorProto
_NUMBERS = set(range(_F.TYPE_DOUBLE, _F.TYPE_SINT64 + 1)) - {
    _F.TYPE_STRING,
    _F.TYPE_BYTES,
    _F.TYPE_GROUP,
    _F.TYPE_MESSAGE,
    _F.TYPE_ENUM,
}
_BAD = (*BAD, RuntimeError, zstandard.ZstdError)


class _Capped:
    """Read a file, never asking for more than it holds, whatever length a record claims."""

    def __init__(self, file):
        self._file, self._left = file, os.fstat(file.fileno()).st_size

    def read(self, size):
        """Return up to `size` bytes."""
        data = self._file.read(min(size, self._left))
        self._left -= len(data)
        return data


def read_mcap(path, *, limits=None):
    """Return {topic: (times_ns list, rows list of {field: float})} of an MCAP file, in order of log time.

    Nested fields are joined by dots, elements of arrays counted as in `x[0]`; texts are left out. Checksums are checked
    where the file has them. Raises LogError for a file that is damaged, too large, or without a message to decode.
    """
    limits, path = limits or Limits(), os.fspath(path)
    regular(path, LogError)
    schemas: dict = {}
    channels: dict = {}
    found: dict = {}
    skipped = set()
    try:
        with open(path, "rb") as file:
            for record in _records(file, limits):
                if isinstance(record, Schema):
                    schemas.setdefault(record.id, record)
                elif isinstance(record, Channel) and record.id not in channels:
                    channels[record.id] = record, _decoder(record, schemas.get(record.schema_id))
                elif isinstance(record, Message):
                    channel, decode = channels[record.channel_id]
                    if decode is None:
                        skipped.add(f"{channel.topic} ({channel.message_encoding})")
                        continue
                    times, rows = found.setdefault(channel.topic, ([], []))
                    times.append(record.log_time)
                    rows.append(dict(_flat(decode(record.data))))
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror}", path) from error
    except UnsupportedCompressionError as error:
        raise log_error(str(error), path, remedy="`pip install lz4` adds it.") from error
    except _BAD as error:
        raise log_error(f"not a readable MCAP file: {str(error) or type(error).__name__}", path) from error
    if not found:
        raise log_error(f"no protobuf or JSON message in it; skipped: {', '.join(sorted(skipped)) or 'nothing'}", path)
    return {topic: _sorted(*pair) for topic, pair in found.items()}


def _sorted(times, rows):
    order = sorted(range(len(times)), key=times.__getitem__)
    return [times[i] for i in order], [rows[i] for i in order]


def _records(file, limits) -> Iterator[Any]:
    """Yield the records of the data section, those within chunks too; what a chunk claims is checked first."""
    total = 0
    capped: Any = _Capped(file)
    reader = StreamReader(capped, emit_chunks=True, validate_crcs=True, record_size_limit=limits.record_bytes)
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        total += record.uncompressed_size
        if record.uncompressed_size > limits.record_bytes or total > limits.total_bytes:
            raise ValueError(f"chunks of {total} bytes are beyond the reader's limits")
        if record.compression not in ("", "zstd", "lz4"):
            raise ValueError(f"unknown compression {record.compression!r}")
        if record.compression == "zstd":
            size = zstandard.get_frame_parameters(record.data).content_size
            if size not in (record.uncompressed_size, zstandard.CONTENTSIZE_UNKNOWN):
                raise ValueError("a compressed frame is not as long as its chunk says")
            record.data = _unzip(record.data, record.uncompressed_size)
            record.compression = ""
        elif record.compression == "lz4":
            record.data = _unlz4(record.data, record.uncompressed_size)
            record.compression = ""
        yield from breakup_chunk(record, validate_crc=True)


def _unzip(data, size):
    """Return the content of a zstd frame, which must be `size` bytes; no more are ever made."""
    with zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)) as reader:
        content = reader.read(size) if size else b""
        if len(content) != size or reader.read(1):
            raise ValueError("a compressed frame is not as long as its chunk says")
    return content


def _unlz4(data, size):
    """Return the content of an lz4 frame, as `_unzip` does."""
    frame = lz4.frame.LZ4FrameDecompressor()
    content = frame.decompress(data, max_length=size + 1)
    if len(content) != size or not frame.eof:
        raise ValueError("a compressed frame is not as long as its chunk says")
    return content


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
        try:
            yield name, float(value)
        except ValueError:
            return
