"""What a log is made of: topics, their protobuf schemas, and the limits of a strict reader.

Every sampled topic is a protobuf message whose fields are all `double` and always written, so a message has a constant
size: tag, 8 bytes, tag, 8 bytes... Any protobuf decoder reads it; numpy packs and unpacks a whole chunk at once.
"""

import functools
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet

from cosim.errors import LogError
from cosim.files import marked

FORMAT = "1"  # of the rules in this package; a reader refuses any other
LIBRARY = f"cosim-log {FORMAT}"
OURS = marked(b"\x89MCAP0", b"cosim-log ")  # the sign of a log that the project wrote, be it whole or not
MAX_FIELDS = 4000  # a row is shorter than an LZ4 reference goes back, 65535 bytes
KEPT = 256  # schemas that are remembered: every flight of a process has the same hundred
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_TOPIC = re.compile(r"(/[A-Za-z0-9_]+)+\Z")


def log_error(problem: str, path: str | Path, offset: int | None = None, remedy: str = "") -> LogError:
    """Return the LogError whose place is a file and, where it is known, the byte in it."""
    place = f"{path}" if offset is None else f"{path}, byte {offset}"
    return LogError(problem, place=place, remedy=remedy)


@dataclass(frozen=True)
class Topic:
    """Name the values of the tick vector that one log channel holds, sampled at ticks that are multiples of `every`.

    `index` (len(fields),) gives each field's position in the vector; `units` stand beside the fields, "-" for none.
    Raises ValueError for names that protobuf cannot carry, repeated fields, or lengths that do not agree.
    """

    name: str
    fields: tuple
    units: tuple
    index: np.ndarray
    every: int = 1
    group: str = ""
    description: str = ""

    def __post_init__(self):
        made = {"fields": tuple(self.fields), "units": tuple(self.units), "index": np.array(self.index, np.intp)}
        for name, value in made.items():
            object.__setattr__(self, name, value)
        check_topic(self.name, self.fields, self.units, self.every)
        if self.index.shape != (len(self.fields),):
            raise ValueError(f"topic {self.name}: {len(self.fields)} fields, but positions of shape {self.index.shape}")


@dataclass(frozen=True)
class TopicInfo:
    """Describe one sampled topic of a log: its fields, their units, ticks per row, number of rows."""

    name: str
    fields: tuple
    units: tuple
    every: int
    rows: int = 0
    group: str = ""
    description: str = ""


@dataclass(frozen=True)
class Limits:
    """Bound what a strict reader accepts, so that a hostile file costs no more memory or time than an honest one."""

    record_bytes: int = 256 << 20  # any top-level record, so also an attachment
    chunk_bytes: int = 64 << 20  # one chunk decompressed; a chunk of 100 ticks of 800 fields takes about 1 MiB
    total_bytes: int = 16 << 30  # all chunks decompressed; ten minutes of 800 fields take about 1 GiB
    text_bytes: int = 4 << 20  # a schema, channel or metadata record
    channels: int = 4096
    records: int = 20_000_000  # top-level records
    message_bytes: int = 1 << 20  # of another writer's, to be decoded: JSON makes objects of ten times that
    fields: int = 4096  # of one of another writer's channels
    values: int = 20_000_000  # of all of another writer's channels that are decoded
    expansion: int = 10_000  # content over compressed size: LZ4 stays below 256, and of a message 3 bytes or more vary


@dataclass
class Damage:
    """Say which bytes of a log are lost, and why."""

    offset: int
    length: int
    reason: str


@dataclass(slots=True)
class ChunkRef:
    """Point to one chunk: ticks k0 <= k < k0 + n, where its bytes are, and its message indexes.

    Those of the samples are the same in every chunk of a layout and shared, so that a long log takes little memory.
    """

    offset: int  # of the chunk record [byte]
    length: int  # of the chunk record with its 9-byte head [byte]
    data_offset: int
    data_size: int
    compression: str
    size: int  # decompressed [byte]
    crc: int
    start_ns: int
    end_ns: int
    places: dict = field(default_factory=dict)  # channel id of samples -> offset of its index after the chunk [byte]
    counts: dict = field(default_factory=dict)  # channel id of samples -> messages
    others: dict = field(default_factory=dict)  # channel id of other messages -> (offset in the file, messages)
    index_length: int = 0
    checked: bool = False  # that its message indexes count its content

    @property
    def index_offsets(self) -> dict[int, int]:
        """Return {channel id: offset of its MessageIndex record}."""
        begin = self.offset + self.length
        return {c: begin + at for c, at in self.places.items()} | {c: at for c, (at, _) in self.others.items()}

    @property
    def index_counts(self) -> dict[int, int]:
        """Return {channel id: messages}."""
        return self.counts | {c: n for c, (_, n) in self.others.items()}


def check_topic(name: str, fields: Any, units: Any, every: int) -> None:
    """Raise ValueError when a topic's name, fields, units or rate cannot be logged."""
    if not _TOPIC.match(name):
        raise ValueError(f"topic {name!r}: use /words/of/letters_digits_underscores")
    bad = [f for f in fields if not _NAME.match(f)]
    if bad or len(set(fields)) != len(fields):
        raise ValueError(f"topic {name}: field names must be distinct identifiers, not {bad or fields}")
    if not all(isinstance(unit, str) for unit in units):
        raise ValueError(f"topic {name}: units must be texts")
    if len(units) != len(fields) or not 0 < len(fields) <= MAX_FIELDS:
        raise ValueError(f"topic {name}: 1 to {MAX_FIELDS} fields, one unit each; got {len(fields)} and {len(units)}")
    if int(every) != every or every < 1:
        raise ValueError(f"topic {name}: every must be a whole number of ticks >= 1, not {every}")


def check_texts(name: str, texts: dict) -> None:
    """Raise ValueError unless metadata are {str: str}."""
    if not all(isinstance(text, str) for pair in texts.items() for text in pair):
        raise ValueError(f"metadata {name!r}: keys and values must be str")


def schema_name(topic: str) -> str:
    """Return the protobuf message name of a sampled topic: `/a/b` is `cosim.a_b`."""
    return "cosim." + topic.strip("/").replace("/", "_")


@functools.lru_cache(KEPT)
def schema_data(topic: str, fields: tuple[str, ...], syntax: str = "proto2") -> bytes:
    """Return the FileDescriptorSet of a message with one `double` per field, numbered from 1 in order.

    proto2: proto3 forbids names that differ only in case or underscores (`h_s` and `H_s`, `y_1_0` and `y_10`), which
    Rerun and the C++ library then refuse. Logs of before say proto3; their messages have the same bytes.
    """
    files = FileDescriptorSet()
    file = files.file.add(name=f"cosim{topic}.proto", package="cosim", syntax=syntax)
    message = file.message_type.add(name=schema_name(topic).removeprefix("cosim."))
    for number, name in enumerate(fields, 1):
        kind = {"type": FieldDescriptorProto.TYPE_DOUBLE, "label": FieldDescriptorProto.LABEL_OPTIONAL}
        # the default JSON name, camel case, would make q_1 and q1 collide
        message.field.add(name=name, json_name=name, number=number, **kind)
    return files.SerializeToString(deterministic=True)


def channel_metadata(topic: Any) -> dict:
    """Return the text that describes a sampled topic in its channel record."""
    about = {"group": topic.group, "description": topic.description}
    return {"every": str(topic.every), "units": json.dumps(list(topic.units)), **about}


@functools.lru_cache(KEPT)
def _fields(data):
    files = FileDescriptorSet.FromString(data)
    if len(files.file) != 1 or len(files.file[0].message_type) != 1:
        raise ValueError("the schema does not describe exactly one message")
    return tuple(f.name for f in files.file[0].message_type[0].field)


def parse_topic(channel: Any, schema: Any) -> TopicInfo:
    """Return the TopicInfo of a channel record and its schema; raises ValueError when they are not ours."""
    fields = _fields(schema.data)
    units = tuple(json.loads(channel.metadata["units"]))
    every = int(channel.metadata["every"])
    check_topic(channel.topic, fields, units, every)
    known = (schema_data(channel.topic, fields, syntax) for syntax in ("proto2", "proto3"))
    if schema.data not in known or schema.name != schema_name(channel.topic):
        raise ValueError("the schema is not the one of its field names")
    info = TopicInfo(channel.topic, fields, units, every, 0, channel.metadata["group"], channel.metadata["description"])
    if channel_metadata(info) != channel.metadata:
        raise ValueError("the channel's description is not in canonical form")
    return info
