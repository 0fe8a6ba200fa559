"""What a log is made of: parts, the channels that hold them, and the limits of a strict reader."""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import LogError

FORMAT = "2"  # of the rules in this package; a reader refuses any other
LIBRARY = f"cosim-log {FORMAT}"
READ_BY = {"1": "cosim 0.1.0"}  # older format -> the version that reads it
MAGIC = b"\x89MCAP0\r\n"
MOST_CHUNK = 64 << 20  # bytes of one chunk decompressed; a second of a flight takes about 1 MiB
MOST_FIELDS = 18_000  # of a channel's level: protobuf keeps the numbers from 19000 on for itself
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\[\d+\])?\Z")
_TOPIC = re.compile(r"(/[A-Za-z0-9_]+)+\Z")


def log_error(problem: str, path: str | Path, offset: int | None = None, remedy: str = "") -> LogError:
    """Return the LogError whose place is a file and, where it is known, the byte in it."""
    place = f"{path}" if offset is None else f"{path}, byte {offset}"
    return LogError(problem, place=place, remedy=remedy)


@dataclass(frozen=True)
class Topic:
    """A part of a log: values of the tick vector, sampled at ticks that are multiples of `every`.

    `name` is that of its `channel`, a topic of the MCAP file, or begins with it: what follows are the nested messages
    in which the part stands ("/sensors/left_inner" on the channel "/sensors"; by default the name itself). `fields` are
    names, elements `P[0]`, `P[1]`, ... of an array are packed; `index` (len(fields),) gives their positions in the
    vector, by default in order, `units` stand beside the fields, "-" for none. Raises ValueError for names that
    protobuf cannot carry, repeated fields, or lengths that do not agree.
    """

    name: str
    fields: tuple
    units: tuple
    index: Any = field(default=None, compare=False)
    every: int = 1
    group: str = ""
    channel: str = ""
    rows: int = 0  # of one that is read

    def __post_init__(self):
        fields, units, channel = tuple(self.fields), tuple(self.units), self.channel or self.name
        index = np.array(range(len(fields)) if self.index is None else self.index, np.int64)
        for name, value in (("fields", fields), ("units", units), ("channel", channel), ("index", index)):
            object.__setattr__(self, name, value)
        bad = [f for f in fields if not _NAME.match(f)]
        for wrong, said in (
            (not _TOPIC.match(self.name) or not f"{self.name}/".startswith(f"{channel}/"),
             "use /words/of/letters_digits_underscores, its channel first"),
            (bad or len(set(fields)) != len(fields), f"field names must be distinct identifiers, not {bad or fields}"),
            (not 0 < len(fields) <= MOST_FIELDS or not len(units) == len(fields) == index.size,
             f"1 to {MOST_FIELDS} fields, a unit and a place each; got {len(fields)}, {len(units)} and {index.size}"),
            (int(self.every) != self.every or self.every < 1,
             f"every must be a whole number of ticks >= 1, not {self.every}"),
        ):  # fmt: skip
            if wrong:
                raise ValueError(f"topic {self.name!r}: {said}")


def channel_metadata(parts: Any) -> dict:
    """Return the text that describes the parts of a channel in its record: rate, group, and each part's fields.

    The length of a packed field stands in no descriptor, so the names of all fields stand here, arrays as `name[n]`.
    """
    fields = {}
    for part in parts:
        runs: dict = {}  # {name, or stem of an array: [unit, length]}
        for name, unit in zip(part.fields, part.units):
            stem, bracket, _ = name.partition("[")
            run = runs.setdefault(stem + bracket, [unit, 0])
            run[1] += 1
        fields[part.name] = {f"{n}{size}]" if n.endswith("[") else n: unit for n, (unit, size) in runs.items()}
    return {"every": str(parts[0].every), "group": parts[0].group, "fields": json.dumps(fields)}


def parts_of(channel: str, metadata: dict) -> list[Topic]:
    """Return the parts that a channel's metadata describe; raises ValueError or its like when they are not ours."""
    out = []
    for name, described in json.loads(metadata["fields"]).items():
        columns: list[tuple[str, str]] = []
        for word, unit in described.items():
            stem, bracket, size = word.rstrip("]").partition("[")
            if bracket and int(size) > MOST_FIELDS:
                raise ValueError(f"an array of {size} elements")
            columns += [(f"{stem}[{i}]", unit) for i in range(int(size))] if bracket else [(stem, unit)]
        fields, units = zip(*columns)
        out.append(Topic(name, fields, units, None, int(metadata["every"]), metadata["group"], channel))
    return out
