"""Layout of a log's channels: nested protobuf messages of doubles, to the byte.

All fields of a message are `double`, packed arrays of them or nested messages, and always written, so that a message
has constant size: any protobuf decoder reads it, and NumPy takes a whole chunk at once. A channel's messages of one
tick follow one another (a row); rows of one rate make a block, the slowest rate first.
"""

import hashlib
import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet

HEAD = struct.Struct("<BQHIQQ")  # a message record before its data: opcode 5, length, channel, sequence, two times
_AFTER = 11  # its first bytes, up to the channel, are constant
_STAMP = np.dtype([("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_DOUBLE, _NESTED = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_MESSAGE


def by_channel(topics: Sequence[Any]) -> dict[str, list]:
    """Return {channel: its parts}; raises ValueError for parts of one channel with different rates."""
    out: dict[str, list] = {}
    for topic in topics:
        out.setdefault(topic.channel, []).append(topic)
    for channel, parts in out.items():
        if len({(t.every, t.group) for t in parts}) > 1:
            raise ValueError(f"channel {channel}: its parts have different rates or groups")
    return out


def tree_of(channel: str, parts: Sequence[Any]) -> dict[str, Any]:
    """Return the message of a channel as {name: child}.

    A child is (part, field) of a double, a list of them for a packed array, or a dict: a nested message. Raises
    ValueError where a field and a nested message share a name, and for arrays whose elements are not in order.
    """
    root: dict[str, Any] = {}
    for number, part in enumerate(parts):
        node = root
        for word in part.name[len(channel) :].split("/")[1:]:
            node = node.setdefault(word, {})
            if not isinstance(node, dict):
                raise ValueError(f"channel {channel}: {word} is a field and a nested message")
        for field, name in enumerate(part.fields):
            stem, bracket, i = name.rstrip("]").partition("[")
            if not bracket and stem in node:
                raise ValueError(f"channel {channel}: {part.name} and another part share {stem}")
            if not bracket:
                node[stem] = number, field
                continue
            run = node.setdefault(stem, [])
            if not isinstance(run, list) or int(i) != len(run):
                raise ValueError(f"channel {channel}: {name} of {part.name} is out of order")
            run.append((number, field))
    return root


def schema_name(channel: str) -> str:
    """Return the protobuf message name of a channel: `/a/b` is `cosim.a_b`."""
    return "cosim." + channel.strip("/").replace("/", "_")


@lru_cache(256)  # every flight of a process has the same ones
def schema_data(channel: str, parts: tuple) -> bytes:
    """Return the FileDescriptorSet of a channel's message.

    proto2: proto3 forbids names that differ only in case or underscores (`h_s` and `H_s`, `y_1_0` and `y_10`), which
    Rerun and the C++ library then refuse.
    """
    files = FileDescriptorSet()
    file = files.file.add(name=f"cosim{channel}.proto", package="cosim", syntax="proto2")
    name = schema_name(channel)
    _describe(file.message_type.add(name=name.removeprefix("cosim.")), tree_of(channel, parts), f".{name}")
    return files.SerializeToString(deterministic=True)


def _describe(message: DescriptorProto, node: dict, place: str) -> None:
    for number, (name, child) in enumerate(node.items(), 1):
        # the default JSON name, camel case, would make q_1 and q1 collide
        field = message.field.add(name=name, json_name=name, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL)
        field.type = _NESTED if isinstance(child, dict) else _DOUBLE
        if isinstance(child, list):
            field.label, field.options.packed = FieldDescriptorProto.LABEL_REPEATED, True
        if isinstance(child, dict):
            field.type_name = f"{place}.Part_{name}"  # fields and nested types share one space of names
            _describe(message.nested_type.add(name=f"Part_{name}"), child, field.type_name)


def varint(value: int) -> bytes:
    """Return a whole number as protobuf writes it: seven bits a byte, the lowest first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def encode(node: dict) -> tuple[bytes, list[tuple[tuple[int, int], int]]]:
    """Return the bytes of a message of zeros, and [((part, field), place of its double)]."""
    out, places = bytearray(), []
    for number, child in enumerate(node.values(), 1):
        if isinstance(child, tuple):
            out += varint(number << 3 | 1)  # wire type 1: eight bytes, little endian
            body, inside = bytes(8), [(child, 0)]
        else:
            if isinstance(child, dict):
                body, inside = encode(child)
            else:
                body, inside = bytes(8 * len(child)), [(leaf, 8 * i) for i, leaf in enumerate(child)]
            out += varint(number << 3 | 2) + varint(len(body))  # wire type 2: with its length
        places += [(leaf, len(out) + at) for leaf, at in inside]
        out += body
    return bytes(out), places


class Block:
    """Rows of one rate: `template` (bytes,) of a row without stamps and values, `channels` [(id, offset in it)],
    `places` {part's name: (fields,) offsets of its doubles in a row}."""

    def __init__(self, every: int, channels: Iterable[tuple[int, str, list]]):
        self.every = every
        self.channels: list[tuple[int, int]] = []
        self.places: dict[str, np.ndarray] = {}
        row = bytearray()
        for number, channel, parts in channels:
            body, places = encode(tree_of(channel, parts))
            self.channels.append((number, len(row)))
            row += HEAD.pack(5, HEAD.size - 9 + len(body), number, 0, 0, 0)
            at: list = [[0] * len(part.fields) for part in parts]
            for (part, field), place in places:
                at[part][field] = len(row) + place
            self.places |= {part.name: np.array(own, np.int64) for part, own in zip(parts, at)}
            row += body
        self.template = np.frombuffer(bytes(row), "u1")
        self.size = len(row)
        self.constant = np.full(self.size, 0xFF, "u1")
        for own in self.places.values():
            self.constant[(own[:, None] + np.arange(8)).ravel()] = 0

    def ticks(self, k0: int, n: int) -> range:
        """Return the ticks of its rows among k0 <= k < k0 + n."""
        return range(k0 + -k0 % self.every, k0 + n, self.every)

    def stamp(self, rows: np.ndarray, ticks: range, dt_ns: int) -> np.ndarray:
        """Write tick (sequence) and time (log and publish time) into the messages of `rows` (n, size), return them."""
        stamps = np.empty(len(ticks), _STAMP)
        stamps["sequence"] = k = np.arange(ticks.start, ticks.stop, ticks.step)
        stamps["log"] = stamps["publish"] = k * dt_ns
        for _, at in self.channels if len(ticks) else ():
            np.ndarray((len(ticks),), "V20", rows, at + _AFTER, (self.size,))[:] = stamps.view("V20")
        return rows


class Layout:
    """Where every byte of a chunk lies, for parts and {channel: id}; the content of ticks k0 <= k < k0 + n is one Block
    after the other, then a tail of irregular messages."""

    def __init__(self, topics: Sequence[Any], ids: dict[str, int], dt_ns: int):
        self.dt_ns = dt_ns
        rates: dict[int, list] = {}
        for channel, parts in by_channel(topics).items():
            rates.setdefault(parts[0].every, []).append((ids[channel], channel, parts))
        self.blocks = [Block(every, rates[every]) for every in sorted(rates, reverse=True)]

    def sizes(self, k0: int, n: int) -> list[int]:
        """Return the bytes of each block."""
        return [len(block.ticks(k0, n)) * block.size for block in self.blocks]

    def index(self, content: Any, k0: int, n: int) -> list[tuple[int, np.ndarray]]:
        """Return [(channel id, (messages, 2) of time [ns] and offset in `content`)] of every channel with messages."""
        start, out = 0, []
        for block in self.blocks:
            ticks = block.ticks(k0, n)
            times = np.arange(ticks.start, ticks.stop, ticks.step) * self.dt_ns
            for channel, at in block.channels if len(ticks) else ():
                places = start + at + block.size * np.arange(len(ticks))
                out.append((channel, np.stack([times, places], axis=1).astype("<u8")))
            start += block.size * len(ticks)
        irregular: dict[int, list] = {}
        for channel, k, place, _ in self.tail(content, k0, n):
            irregular.setdefault(channel, []).append((k * self.dt_ns, place))
        return [*out, *((channel, np.array(own, "<u8")) for channel, own in irregular.items())]

    def tail(self, content: Any, k0: int, n: int) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield (channel id, tick, offset, payload) of the irregular messages; raises ValueError for what is none."""
        at = sum(self.sizes(k0, n))
        while at < len(content):
            head = bytes(content[at : at + HEAD.size]).ljust(HEAD.size, b"\0")
            opcode, length, channel, k, ns, _ = HEAD.unpack(head)
            end = at + 9 + length
            if opcode != 5 or not at + HEAD.size <= end <= len(content):
                raise ValueError(f"byte {at} of the chunk begins no message")
            if not k0 <= k < k0 + n or ns != k * self.dt_ns:
                raise ValueError("a message has a time outside its chunk")
            yield channel, k, at, bytes(content[at + HEAD.size : end])
            at = end

    def rows(self, content: np.ndarray, k0: int, n: int) -> list[np.ndarray]:
        """Return each block of `content` (bytes,) as (rows, bytes of a row)."""
        ends = np.cumsum([0, *self.sizes(k0, n)])
        return [content[a:b].reshape(-1, block.size) for a, b, block in zip(ends, ends[1:], self.blocks)]

    def check(self, content: np.ndarray, k0: int, n: int) -> None:
        """Raise ValueError unless every byte of `content` (bytes,) that is no value is as it must be."""
        start = 0
        for block, rows in zip(self.blocks, self.rows(content, k0, n)):
            want = block.stamp(np.tile(block.template, (len(rows), 1)), block.ticks(k0, n), self.dt_ns)
            same = (rows & block.constant) == want
            if not same.all():
                place = start + int(same.ravel().argmin())
                raise ValueError(f"the chunk is not one message per sample (byte {place} of it)")
            start += rows.size
        _ = list(self.tail(content, k0, n))

    def places(self, columns: Sequence[tuple[str, int]]) -> tuple[int, list[int]]:
        """Return (number of the block, offset in its rows of each) of columns (part, field) of one rate."""
        number = next(i for i, block in enumerate(self.blocks) if columns[0][0] in block.places)
        return number, [self.blocks[number].places[part][field] for part, field in columns]


def doubles(rows: np.ndarray) -> np.ndarray:
    """Return `rows` (n, bytes) seen as (n, bytes - 7): at [i, j] is the double whose first byte is rows[i, j]."""
    return np.ndarray((len(rows), rows.shape[1] - 7), "<f8", rows, 0, (rows.shape[1], 1))


def content_hash(chunks: Iterable[Any]) -> str:
    """Return the SHA-256 of the chunks' tick times, sizes and CRCs: it changes with any sample."""
    told = (struct.pack("<QQQI", chunk.start_ns, chunk.end_ns, chunk.size, chunk.crc) for chunk in chunks)
    return hashlib.sha256(b"".join(told)).hexdigest()
