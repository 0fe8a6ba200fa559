"""Pack the rows of many ticks into the content of a chunk, and unpack it: the one part of MCAP written by hand.

The library spends 4 us per message in Python; here numpy places all messages of a chunk at once. Inside a chunk the
messages of one topic follow one another (topic after topic, then the tail of irregular messages), so each topic is a
strided view: (message, field) -> the eight bytes of a double. All else is known beforehand, from the first tick and
the number of ticks; the reader compares that part byte for byte.
"""

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from actuators.object_cache import of_wholes

from .frame import Frame
from .message_layout import HEAD, INDEX_HEAD, MIDDLE, SHORT

GATHER = of_wholes("cosim.log.chunk_decoder", "gather", 6, f"{__name__}:GATHER")


def empty_message(count: int) -> tuple[bytes, list[tuple[slice, int, int]]]:
    """Return the bytes of a message of `count` zero doubles, and the (fields, offset, stride) of equal tag size."""
    body, runs, at = bytearray(), [], HEAD.itemsize
    for number in range(1, count + 1):
        tag = number << 3 | 1  # wire type 1: eight bytes, little endian
        while tag > 0x7F:  # a varint: seven bits a byte, the lowest first
            body.append(tag & 0x7F | 0x80)
            tag >>= 7
        body += bytes([tag]) + bytes(8)
    for size, begin, end in ((1, 0, SHORT), (2, SHORT, MIDDLE), (3, MIDDLE, count)):
        if begin < count:
            runs.append((slice(begin, min(end, count)), at + size, 8 + size))
            at += (8 + size) * (min(end, count) - begin)
    return bytes(body), runs


_STAMP_FIELDS = np.dtype([("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_STAMP = np.dtype("V20")  # the same 20 bytes of a message head, to be copied as one


class Block(NamedTuple):
    """Say where the messages of a topic lie: rate, rows, start, bytes per message, runs of _tags, index entries."""

    every: int
    rows: int
    start: int
    stride: int
    runs: list
    entries: int


def _fields(block):
    return sum(run.stop - run.start for run, _, _ in block.runs)


class Layout:
    """Know where every byte of a chunk lies, for sampled topics given as (channel id, number of fields, every)."""

    def __init__(self, topics: Sequence[tuple[int, int, int]], dt_ns: int):
        self.dt_ns = dt_ns
        self.topics = []
        for channel, count, every in topics:
            body, runs = empty_message(count)
            head = np.zeros(1, HEAD)
            head["op"], head["length"], head["channel"] = 5, HEAD.itemsize - 9 + len(body), channel
            self.topics.append((channel, every, np.frombuffer(head.tobytes() + body, "u1"), runs))
        self._rates = sorted({every for _, _, every in topics})
        self._plan = lru_cache(maxsize=16)(lambda n, phases: Plan(self, n, dict(zip(self._rates, phases))))
        self._counts = lru_cache(maxsize=64)(self._count)

    def _phases(self, k0):
        return tuple(-k0 % every for every in self._rates)

    def counts(self, k0: int, n: int) -> tuple[dict[int, int], int]:
        """Return ({channel id: rows}, content size in bytes) of the ticks k0 <= k < k0 + n, tail not included."""
        return self._counts(n, self._phases(k0))

    def _count(self, n, phases):
        first = dict(zip(self._rates, phases))
        rows = {c: len(range(first[every], n, every)) for c, every, _, _ in self.topics}
        return {c: m for c, m in rows.items() if m}, sum(rows[c] * len(t) for c, _, t, _ in self.topics)

    def plan(self, k0: int, n: int) -> "Plan":
        """Return the Plan of n ticks from k0; the same object serves every chunk of that length and phase."""
        return self._plan(n, self._phases(k0))


class Plan:
    """Hold the constant bytes and the views of a chunk of n ticks; its first sample of a rate is at first[rate]."""

    def __init__(self, layout: Layout, n: int, first: Mapping[int, int]):
        self.dt_ns, self.blocks, self.index_offsets = layout.dt_ns, {}, {}
        self._rates: dict = {}
        content, index = [], []
        size = index_size = 0
        for number, (channel, every, template, runs) in enumerate(layout.topics):
            rel = self._rates.setdefault(every, np.arange(first[every], n, every))
            rows = len(rel)
            if not rows:
                continue
            self.blocks[number] = Block(every, rows, size, len(template), runs, index_size + INDEX_HEAD.itemsize)
            self.index_offsets[channel] = index_size
            head = np.zeros(1, INDEX_HEAD)
            head["op"], head["length"], head["channel"], head["bytes"] = 7, 6 + 16 * rows, channel, 16 * rows
            entries = np.zeros((rows, 2), "<u8")
            entries[:, 1] = size + len(template) * np.arange(rows)
            content.append(np.tile(template, rows))
            index.append(np.frombuffer(head.tobytes() + entries.tobytes(), "u1"))
            size += content[-1].size
            index_size += index[-1].size
        self.size = size
        self._fixed: np.ndarray | None = None
        self._about: np.ndarray | None = None
        self._index = np.concatenate(index)
        starts = np.array(list(self.index_offsets.values()))
        self.heads = (starts[:, None] + np.arange(INDEX_HEAD.itemsize)).ravel()  # positions of their bytes in the index
        self._index_times = [
            (b.every, np.ndarray((b.rows,), "<u8", self._index, b.entries, (16,))) for b in self.blocks.values()
        ]
        self.table = {
            every: np.array([(b.start, b.stride, _fields(b)) for b in self.blocks.values() if b.every == every])
            for every in {b.every for b in self.blocks.values()}
        }  # of each rate: offset of the first message, bytes from one to the next, fields of each topic
        self.frame = Frame(self.blocks)
        self._bind(np.concatenate(content))

    def _bind(self, content):
        """Take an array for the content, and make the views of it that every chunk fills."""
        stamps = [
            (b.every, np.ndarray((b.rows,), _STAMP, content, b.start + 11, (b.stride,))) for b in self.blocks.values()
        ]
        self.content, self._stamps = content, stamps  # both or, after Ctrl-C, none

    def template(self, k0: int, tail: bytes = b"") -> np.ndarray:
        """Return the content (uint8) of the ticks from k0 followed by `tail`, with the values of the call before.

        The array is the plan's own and lasts until the next call: fresh memory would cost more than filling it.
        """
        stamps = {}
        for every, rel in self._rates.items():  # sequence = tick, log time = publish time = simulated time [ns]
            stamps[every] = out = np.empty(len(rel), _STAMP_FIELDS)
            out["sequence"] = ticks = rel + k0
            out["log"] = out["publish"] = ticks * self.dt_ns
        for every, view in self._stamps:
            view[:] = stamps[every].view(_STAMP)
        return self.ended(tail)

    def ended(self, tail: bytes) -> np.ndarray:
        """Return the content (uint8) as it stands, followed by `tail`; see `template`."""
        if self.content.size < self.size + len(tail):
            self._bind(np.concatenate([self.content[: self.size], np.zeros(2 * len(tail), "u1")]))
        content = self.content[: self.size + len(tail)]
        content[self.size :] = np.frombuffer(tail, "u1")
        return content

    def take(self, other: "Plan") -> None:
        """Take the first rows of another plan of the same layout and phases."""
        for number, block in self.blocks.items():
            begin, size = other.blocks[number].start, block.rows * block.stride
            self.content[block.start :][:size] = other.content[begin:][:size]

    def index(self, k0: int) -> np.ndarray:
        """Return the MessageIndex records (uint8) of the ticks from k0, which last until the next call."""
        times = {every: (rel + k0) * self.dt_ns for every, rel in self._rates.items()}
        for every, view in self._index_times:
            view[:] = times[every]
        return self._index

    def values(self, content: np.ndarray, number: int) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (slice of fields, (row, field) view of float64) of topic `number` in `content`."""
        if number not in self.blocks:  # it has no row in the chunk
            return
        block = self.blocks[number]
        for fields, offset, step in block.runs:
            shape = (block.rows, fields.stop - fields.start)
            yield fields, np.ndarray(shape, "<f8", content, block.start + offset, (block.stride, step))

    def gather(self, content: np.ndarray, k0: int, wanted: Mapping[int, tuple[int, int, int]], only: bool) -> bool:
        """Put the values of topics where they belong, and return whether all bytes are as they must be.

        `wanted` is {number: (address, low, high)}: the rows low <= i < high of the topic go there, as (rows, fields) of
        float64. With `only`, no other topics are looked at. `differs` tells the first byte that is not as it must be.
        """
        if self._about is None:
            self._row = {number: i for i, number in enumerate(self.blocks)}  # first: other threads look at the next
            self._about = np.array([self._told(block) for block in self.blocks.values()], np.int64)
        about, wrong = self._about.copy(), np.zeros(1, np.int64)
        rows = {self._row[number]: where for number, where in wanted.items() if number in self._row}
        for row, where in rows.items():
            about[row, 8:] = where
        if only:
            about = about[list(rows)]
        GATHER.free(about.ctypes.data, len(about), content.ctypes.data, k0, self.dt_ns, wrong.ctypes.data)
        return not wrong[0]

    def _told(self, block):
        """Return what `gather` reads of a topic, cosim/log/chunk_decoder.py; nobody wants its values yet."""
        head = self.content[block.start : block.start + HEAD.itemsize].tobytes()
        count = _fields(block)
        first = int(self._rates[block.every][0])
        (begin,), (end,) = struct.unpack_from("<q", head), struct.unpack_from("<I", head, 7)
        return [block.start, block.stride, block.rows, count, first, block.every, begin, end, 0, 0, 0]

    def differs(self, content: np.ndarray, k0: int, numbers: Iterable[int] | None = None) -> int | None:
        """Return the offset of the first byte of `content` that is no value and not as it must be, or None.

        With `numbers` only those topics are looked at.
        """
        if self._fixed is None:
            self._fixed = np.full(self.size, 0xFF, "u1")
            for number in self.blocks:
                for _, view in self.values(self._fixed, number):
                    view[:] = 0.0
            self._masked = np.empty(self.size, "u1")
        expected = self.template(k0)[: self.size]
        for part in [slice(0, self.size)] if numbers is None else map(self._slice, numbers):
            masked = np.bitwise_and(content[part], self._fixed[part], out=self._masked[part])
            if not np.array_equal(masked, expected[part]):
                return part.start + int((masked != expected[part]).argmax())
        return None

    def _slice(self, number):
        block = self.blocks.get(number)
        return slice(block.start, block.start + block.rows * block.stride) if block else slice(0, 0)
