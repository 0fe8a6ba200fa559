"""Write a log while a run goes on: a vector per tick, a compressed chunk per second, whole after any end."""

import struct
from dataclasses import dataclass

import numpy as np

from . import foxglove
from .chunk import HEAD, Layout
from .compression import compressor
from .format import LogError, channel_metadata, check_texts, schema_data, schema_name
from .records import content_hash, pack_chunk
from .sink import Sink

MESSAGE_BYTES = HEAD.itemsize - 9  # of a message record before its data, without opcode and length
message_head = struct.Struct("<BQHIQQ").pack  # as chunk.HEAD
ROWS = 200  # of a chunk: one second at 200 Hz, lost when the process is killed; the cost per chunk is that of 30 ticks
_POSE = -1  # stands for a topic number
RESERVED = ("log", "preamble", "result", "late_events", "recovered")  # names of metadata


class LogWriter:
    """Write one self-contained MCAP log; use it as a context manager.

    `topics` are the sampled channels (at least one of them at every tick), `n_values` the length of the tick vector,
    `dt_ns` the tick [ns], `metadata` {name: {str: str}} and `attachments` {name: (media type, bytes)} go in first;
    `compression` is a name of cosim/log/compression.py; `pose` adds /tf and /fix for viewers. Leaving the context
    without `close(result=...)`, as Ctrl-C does, gives a readable log that counts as incomplete.
    Raises ValueError for topics that do not fit together, LogError when the file cannot be written.
    """

    def __init__(
        self,
        path,
        topics,
        *,
        n_values,
        dt_ns=5_000_000,
        metadata=None,
        attachments=None,
        rows_per_chunk=ROWS,
        compression="lz4",
        pose=None,
    ):
        self.dt_ns, self._topics, self._pose = int(dt_ns), list(topics), pose
        _check(self._topics, n_values, self.dt_ns, metadata or {}, rows_per_chunk)
        self._shape, self._rows = (n_values,), rows_per_chunk
        self._rates = _rates(self._topics, pose, rows_per_chunk)
        fast = self._rates[1]
        self._take, self._slots = fast.index, list(fast.buffer)
        self._slow = [rate for every, rate in self._rates.items() if every > 1]
        self._k0 = self._n = self._next_slow = 0  # tick of the first buffered row, rows, next tick of a slower rate
        self._pending = []  # (tick, channel id, payload) of irregular messages
        self._compress, self._compression = compressor(compression), compression
        declared = [
            (t.name, schema_name(t.name), schema_data(t.name, t.fields), channel_metadata(t)) for t in self._topics
        ]
        declared += [(name, message, data(), {}) for name, (message, data) in foxglove.TOPICS.items()]
        self._sink = Sink(path)
        try:
            self._sink.preamble(declared, {"log": {"dt_ns": str(self.dt_ns)}, **(metadata or {})}, attachments or {})
        except BaseException:
            self._sink.drop()
            raise
        self._layout = Layout([(self._sink.ids[t.name], len(t.fields), t.every) for t in self._topics], self.dt_ns)
        self._done = self._sink.mark(), 0  # what is safely written: place in the file, next tick

    @property
    def path(self):
        """Return where the log is."""
        return self._sink.path

    def append(self, v):
        """Log the vector v (n_values,) of the next tick; it is copied. Raises LogError when the disk is full."""
        n = self._n
        if n == self._rows:
            self.flush()
            n = 0
        if v.shape != self._shape:
            raise ValueError(f"a vector of shape {v.shape}; the log takes {self._shape}")
        v.take(self._take, out=self._slots[n], mode="clip")  # the mode that needs no copy in between
        if self._k0 + n == self._next_slow:
            self._append_slow(v, self._k0 + n)
        self._n = n + 1

    def _append_slow(self, v, k):
        for rate in self._slow:
            if k % rate.every == 0:
                rate.buffer[k // rate.every - -(-self._k0 // rate.every)] = v[rate.index]
        self._next_slow = min((k - k % rate.every + rate.every for rate in self._slow), default=-1)

    def event(self, k, message, level="info"):
        """Log a text at tick k on /log (foxglove.Log); level is debug, info, warning, error or fatal."""
        self._pending.append((k, self._sink.ids["/log"], foxglove.log(k * self.dt_ns, message, level)))

    def window(self, k, start, end, **texts):
        """Log a foxglove.Event on /events at tick k: something lasts from tick `start` to `end` (None: open)."""
        data = foxglove.event(start * self.dt_ns, None if end is None else end * self.dt_ns, texts)
        self._pending.append((k, self._sink.ids["/events"], data))

    def flush(self):
        """Write the buffered ticks as a chunk. Raises LogError when that fails; the chunks before it stay whole."""
        k0, n = self._k0, self._n
        if not n:
            return
        plan = self._layout.plan(k0, n)
        tail, entries = self._tail(plan, k0, n)
        content = plan.template(k0, tail)
        for every, rate in self._rates.items():
            if rows := len(range(-k0 % every, n, every)):
                plan.fill(every, rate.buffer[:rows])
        data = self._compress(content)
        chunk = pack_chunk(self._layout, content, data, self._compression, k0, n, entries, self._sink.offset)
        self._sink.chunk(*chunk)
        # Ctrl-C may strike between any two lines: `_settle` tells from the first of these three how far it came
        self._done = self._sink.mark(), k0 + n
        self._pending = [m for m in self._pending if m[0] >= k0 + n]
        self._k0, self._n = k0 + n, 0

    def _tail(self, plan, k0, n):
        """Return the irregular messages of this chunk as (bytes, {channel: [(time, offset)]}).

        Their log times are kept inside the chunk, so that chunks never overlap; the messages hold their own times.
        """
        tail = [(max(k, k0), c, data) for k, c, data in self._pending if k < k0 + n]
        if self._pose is not None:
            first, every = -(-k0 // self._pose.every), self._pose.every
            rows = self._rates[every].values(_POSE, len(range(first * every, k0 + n, every)))
            poses = self._pose.messages(rows, first * every, self.dt_ns)
            tail += [(k, self._sink.ids[name], data) for k, name, data in poses]
        entries: dict = {}
        out = bytearray()
        for k, channel, data in sorted(tail, key=lambda m: m[0]):
            ns = k * self.dt_ns
            entries.setdefault(channel, []).append((ns, plan.size + len(out)))
            out += message_head(5, MESSAGE_BYTES + len(data), channel, k, ns, ns) + data
        return bytes(out), entries

    def close(self, result=None):
        """Write what is buffered, the result with a hash of all samples, and the summary; no result: incomplete."""
        if not self._sink.open:
            return
        check_texts("result", result or {})
        try:
            self._settle()
            self.flush()
            if self._pending:  # no tick came after them, so no chunk can hold them
                texts = {str(i): f"tick {k}: {self._told(c, data)}" for i, (k, c, data) in enumerate(self._pending)}
                self._sink.metadata("late_events", texts)
            if result is not None:
                self._sink.metadata("result", {**result, "content": content_hash(self._sink.chunks)})
            self._sink.finish()
        finally:
            self._sink.drop()

    def _told(self, channel, data):
        return foxglove.text(data) if channel == self._sink.ids["/log"] else "a window of /events"

    def _settle(self):
        """Go back to the last whole chunk, should Ctrl-C have struck within a flush; keep texts inside the last one."""
        mark, k = self._done
        self._sink.back_to(mark)
        if self._k0 != k:
            self._pending = [m for m in self._pending if m[0] >= k]
            self._k0, self._n = k, 0
        if self._n:
            self._pending = [(min(at, self._k0 + self._n - 1), c, data) for at, c, data in self._pending]

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, LogError):
            self._sink.drop()
        else:
            self.close()


def _check(topics, n_values, dt_ns, metadata, rows_per_chunk):
    names = [t.name for t in topics]
    if len(set(names)) != len(names) or set(names) & set(foxglove.TOPICS):
        raise ValueError(f"topics must have distinct names other than {sorted(foxglove.TOPICS)}")
    if not any(t.every == 1 for t in topics):
        raise ValueError("at least one topic must be logged at every tick")
    for topic in topics:
        if topic.index.min() < 0 or topic.index.max() >= n_values:
            raise ValueError(f"topic {topic.name}: a position lies outside the tick vector of {n_values} values")
    if set(metadata) & set(RESERVED):
        raise ValueError(f"metadata names {RESERVED} are taken")
    for name, texts in metadata.items():
        check_texts(name, texts)
    if dt_ns <= 0 or rows_per_chunk < 1:
        raise ValueError("dt_ns and rows_per_chunk must be positive")


@dataclass
class _Rate:
    """Buffer the values of all topics of one rate, side by side; `places` {topic number: slice of columns}."""

    every: int
    index: np.ndarray
    places: dict
    buffer: np.ndarray

    def values(self, number, rows):
        """Return the first rows of a topic (rows, fields)."""
        return self.buffer[:rows, self.places[number]]


def _rates(topics, pose, rows_per_chunk):
    """Return {every: _Rate} for the topics; the pose is one more, with number _POSE."""
    wanted = [(number, t.every, t.index) for number, t in enumerate(topics)]
    if pose is not None:
        wanted.append((_POSE, pose.every, np.array(pose.index)))
    out = {}
    for every in sorted({every for _, every, _ in wanted}):
        parts = [(number, index) for number, e, index in wanted if e == every]
        ends = np.cumsum([0] + [len(index) for _, index in parts]).tolist()
        places = {number: slice(a, b) for (number, _), a, b in zip(parts, ends, ends[1:])}
        index = np.concatenate([index for _, index in parts])
        out[every] = _Rate(every, index, places, np.zeros((-(-rows_per_chunk // every), len(index))))
    return out
