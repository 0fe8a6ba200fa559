"""Pack the rows of many ticks into the content of a chunk, and unpack it: the one part of MCAP written by hand.

The library spends 4 us per message in Python; here numpy places all messages of a chunk at once. Inside a chunk the
messages of one topic follow one another (topic after topic, then the tail of irregular messages), so each topic is a
strided view: (message, field) -> the eight bytes of a double. All else is known beforehand, from the first tick and the
number of ticks; the reader compares that part byte for byte.
"""

from functools import lru_cache

import numpy as np

# a message record up to its payload (MCAP specification, Message): opcode 5, length, head of 22 bytes
HEAD = np.dtype(
    [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
# a MessageIndex record up to its entries: opcode 7, length, channel, bytes of entries; an entry is (log time, offset)
INDEX_HEAD = np.dtype([("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("bytes", "<u4")])
_SHORT = 15  # fields 1..15 have one-byte tags, later ones two bytes


def _tags(count):
    """Return the bytes of a message of `count` zero doubles, and the (fields, offset, stride) of equal tag size."""
    short = min(count, _SHORT)
    body = bytearray()
    for number in range(1, count + 1):
        tag = number << 3 | 1  # wire type 1: eight bytes, little endian
        body += bytes([tag]) if number <= _SHORT else bytes([tag & 0x7F | 0x80, tag >> 7])
        body += bytes(8)
    runs = [(slice(0, short), HEAD.itemsize + 1, 9)]
    if count > short:
        runs.append((slice(short, count), HEAD.itemsize + 9 * short + 2, 10))
    return bytes(body), runs


class Layout:
    """Know where every byte of a chunk lies, for sampled topics given as (channel id, number of fields, every)."""

    def __init__(self, topics, dt_ns):
        self.dt_ns = dt_ns
        self.topics = []
        for channel, count, every in topics:
            body, runs = _tags(count)
            head = np.zeros(1, HEAD)
            head["op"], head["length"], head["channel"] = 5, HEAD.itemsize - 9 + len(body), channel
            self.topics.append((channel, every, np.frombuffer(head.tobytes() + body, "u1"), runs))
        self._rates = sorted({every for _, _, every in topics})
        self._plan = lru_cache(maxsize=16)(self._make)

    def counts(self, k0, n):
        """Return ({channel id: rows}, content size in bytes) of the ticks k0 <= k < k0 + n, tail not included."""
        rows = {c: len(range(-k0 % every, n, every)) for c, every, _, _ in self.topics}
        return {c: m for c, m in rows.items() if m}, sum(rows[c] * len(t) for c, _, t, _ in self.topics)

    def plan(self, k0, n):
        """Return the Plan of n ticks from k0; the same object serves every chunk of that length and phase."""
        return self._plan(n, tuple(-k0 % every for every in self._rates))

    def _make(self, n, phases):
        return Plan(self, n, dict(zip(self._rates, phases)))


class Plan:
    """Hold the constant bytes and the views of a chunk of n ticks; its first sample of a rate is at first[rate]."""

    def __init__(self, layout, n, first):
        self.dt_ns, self.blocks, self.index_offsets = layout.dt_ns, {}, {}
        base, index, starts, ticks, slots = [], [], [], [], []
        size = index_size = 0
        for number, (channel, every, template, runs) in enumerate(layout.topics):
            rel = np.arange(first[every], n, every)
            if not len(rel):
                continue
            self.blocks[number] = (slice(first[every], n, every), len(rel), size, len(template), runs)
            self.index_offsets[channel] = index_size
            start = size + len(template) * np.arange(len(rel))
            head = np.zeros(1, INDEX_HEAD)
            head["op"], head["length"], head["channel"], head["bytes"] = 7, 6 + 16 * len(rel), channel, 16 * len(rel)
            entries = np.zeros((len(rel), 2), "<u8")
            entries[:, 1] = start
            base.append(np.tile(template, len(rel)))
            index.append(np.frombuffer(head.tobytes() + entries.tobytes(), "u1"))
            starts.append(start)
            ticks.append(rel)
            slots.append(index_size + INDEX_HEAD.itemsize + 16 * np.arange(len(rel)))
            size += base[-1].size
            index_size += index[-1].size
        self.size = size
        self._base, self._index = np.concatenate(base), np.concatenate(index)
        self._starts, self._ticks, self._slots = np.concatenate(starts), np.concatenate(ticks), np.concatenate(slots)
        self._content, self._fixed = self._base, None

    def template(self, k0, tail=b""):
        """Return the content (uint8) of the ticks from k0 followed by `tail`; values are those of the call before.

        The array is the plan's own and lasts until the next call: fresh memory would cost more than filling it.
        """
        if self._content.size < self.size + len(tail):
            self._content = np.concatenate([self._content[: self.size], np.zeros(2 * len(tail), "u1")])
        content = self._content[: self.size + len(tail)]
        content[self.size :] = np.frombuffer(tail, "u1")
        ticks = self._ticks + k0
        _anywhere(content, "<u4")[self._starts + 11] = ticks  # sequence = tick
        times = ticks * self.dt_ns
        for offset in (15, 23):  # log time = publish time = simulated time [ns]
            _anywhere(content, "<u8")[self._starts + offset] = times
        return content

    def index(self, k0):
        """Return the MessageIndex records (bytes) of the ticks from k0."""
        _anywhere(self._index, "<u8")[self._slots] = (self._ticks + k0) * self.dt_ns
        return self._index.tobytes()

    def values(self, content, number):
        """Yield (slice of fields, (row, field) view of float64) of topic `number` in `content`."""
        _, rows, start, stride, runs = self.blocks[number]
        for fields, offset, step in runs:
            shape = (rows, fields.stop - fields.start)
            yield fields, np.ndarray(shape, "<f8", content, start + offset, (stride, step))

    def differs(self, content, k0):
        """Return the offset of the first byte of `content` that is no value and not as it must be, or None."""
        if self._fixed is None:
            self._fixed = np.full(self.size, 0xFF, "u1")
            for number in self.blocks:
                for _, view in self.values(self._fixed, number):
                    view[:] = 0.0
            self._masked = np.empty(self.size, "u1")
        np.bitwise_and(content[: self.size], self._fixed, out=self._masked)
        expected = self.template(k0)[: self.size]
        return None if np.array_equal(self._masked, expected) else int((self._masked != expected).argmax())


def _anywhere(content, kind):
    """Return a view of `content` whose element i is the unaligned `kind` that starts at byte i."""
    return np.ndarray((content.size - np.dtype(kind).itemsize + 1,), kind, content, 0, (1,))
