"""Write a log while a run goes on: a vector per tick, a compressed chunk per second, whole after any end."""

import contextlib
import os
import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np

from actuators.object_cache import PLAIN, of_wholes
from cosim.files import overwrites

from . import foxglove
from .chunk import Layout
from .compression import compressor, keep_memory
from .format import Limits, LogError, channel_metadata, check_texts, schema_data, schema_name
from .message_layout import HEAD, MIDDLE, SHORT, STORE_HEAD, STORE_TARGET
from .record_writer import Sink
from .records import content_hash, pack_chunk

MESSAGE_BYTES = HEAD.itemsize - 9  # of a message record before its data, without opcode and length
message_head = struct.Struct("<BQHIQQ").pack  # as chunk.HEAD
ROWS = 200  # of a chunk: one second at 200 Hz, lost when the process is killed; the cost per chunk is that of 30 ticks
_NONE = np.empty((0, 3), np.int64)
RESERVED = ("log", "preamble", "result", "late_events", "recovered")  # names of metadata


# of a log's content, at least, is taken on the disk: noise does not compress
LEAST_SHARE = 0.5


def fits(path: str | os.PathLike, topics: Any, ticks: int, dt_s: float) -> None:
    """Raise LogError where a log of so many ticks could not be read again, or has no place on its disk."""
    per_tick = sum((HEAD.itemsize + 8 * n + sum(max(0, n - below) for below in (0, SHORT, MIDDLE))) / t.every
                   for t in topics for n in [len(t.fields)])  # fmt: skip
    limit, share = Limits().total_bytes, per_tick * ticks
    if share > limit:
        said = f"a log of {ticks * dt_s:g} s would hold {share / 1e9:.1f} GB, more than is read again"
        allowed = f"up to {limit / per_tick * dt_s:.0f} s of this flight at {1 / dt_s:g} Hz"
        raise LogError(said, place=os.fspath(path), allowed=allowed, remedy="Fly shorter, slower (rate_hz), or parts")
    folder = next((p for p in Path(os.path.realpath(path)).parents if p.is_dir()), Path("/"))
    with contextlib.suppress(OSError):
        place = shutil.disk_usage(folder).free
        if LEAST_SHARE * share > place:
            said = f"a log of {ticks * dt_s:g} s takes {LEAST_SHARE * share / 1e6:.0f} MB or more"
            raise LogError(f"{said}, its disk has {place / 1e6:.0f} MB left", place=os.fspath(path),
                           remedy="Free some space or choose another place (-o)")  # fmt: skip


_STORE = of_wholes("cosim.log.row_writer", "store", 2, f"{__name__}:_STORE")


class LogWriter:
    """Write one self-contained MCAP log; use it as a context manager.

    `topics` are the sampled channels (at least one of them at every tick), `n_values` the length of the tick vector,
    `dt_ns` the tick [ns], `metadata` {name: {str: str}} and `attachments` {name: (media type, bytes)} go in first;
    `compression` is a name of cosim/log/compression.py; `pose` adds /tf and /fix for viewers. It takes its place
    when it is closed; what stood there stays until then. A kill or a full disk leaves `path`.part, unless `kept` is
    false, for what can be made again. Leaving the context without `close(result=...)`, as Ctrl-C does, gives a readable
    log that counts as incomplete; where it is not `kept`, an error leaves none.
    Raises ValueError for topics that do not fit together, LogError when the file cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike, topics: Any, *, n_values: Any, dt_ns: Any = 5_000_000,
        metadata: dict | None = None, attachments: dict | None = None, rows_per_chunk: Any = ROWS,
        compression: str = "lz4", pose: Any = None, kept: bool = True,
    ):  # fmt: skip
        self.dt_ns, self._topics, self._pose = int(dt_ns), list(topics), pose
        _check(self._topics, n_values, self.dt_ns, metadata or {}, rows_per_chunk)
        self._shape, self._rows = (n_values,), rows_per_chunk
        self._pending: list[tuple[int, int, bytes]] = []  # (tick, channel id, payload) of irregular messages
        keep_memory()
        self._compress, self._compression = compressor(compression), compression.partition("-")[0]
        declared = [
            (t.name, schema_name(t.name), schema_data(t.name, t.fields), channel_metadata(t)) for t in self._topics
        ]
        declared += [(name, message, data(), {}) for name, (message, data) in foxglove.TOPICS.items()]
        self._sink, self._kept = Sink(path, kept=kept), kept
        try:
            self._sink.preamble(declared, {"log": {"dt_ns": str(self.dt_ns)}, **(metadata or {})}, attachments or {})
        except BaseException:
            self._sink.drop()
            raise
        self._layout = Layout([(self._sink.ids[t.name], len(t.fields), t.every) for t in self._topics], self.dt_ns)
        self._targets = _targets(self._topics)
        self._posed = np.zeros((rows_per_chunk, len(pose.index) if pose else 0))  # the chunk's rows of the pose
        if pose is not None:
            self._targets.append((pose.every, np.array(pose.index, np.int64)))
        self._head = np.zeros(STORE_HEAD + STORE_TARGET * len(self._targets), np.int64)
        self._aimed: tuple = (0, [])  # see `_aim`
        self._count = self._head.data  # quicker to ask than the array
        self._aim(0)
        self._done = self._sink.mark(), 0  # what is safely written: place in the file, next tick

    @property
    def path(self) -> Any:
        """Return where the log is."""
        return self._sink.path

    @property
    def _n(self):
        return int(self._head[0])  # rows of the chunk so far

    @property
    def _k0(self):
        return int(self._head[1])  # tick of its first row

    def _aim(self, k0):
        """Let the next row be tick `k0`, the first of a chunk.

        The head says where its values go: row, k0, rows, targets, dt [ns]; and of each target every, its first row,
        values, the address of their positions in the vector, that of where they go, and how many topics they make with
        the address of the Plan's table of those; no topics: rows of values. A row is stored where it will stand in the
        chunk, whose other bytes are there already.
        """
        plan, firsts = self._layout.plan(k0, self._rows), [-k0 % every for every, _ in self._targets]
        if self._aimed[:2] != (plan.content.ctypes.data, firsts):
            self._aimed = plan.content.ctypes.data, firsts, self._head_of(plan, firsts), plan.content
        head = self._aimed[2].copy()
        head[1] = k0
        self._plan = plan
        self._head[:] = head  # at once: Ctrl-C may strike between any two lines

    def _head_of(self, plan, firsts):
        """Return the head for a chunk of a plan, from tick 0."""
        head = [0, 0, self._rows, len(self._targets), self.dt_ns]
        for i, ((every, take), first) in enumerate(zip(self._targets, firsts)):
            posed = self._pose is not None and i == len(self._targets) - 1
            table = _NONE if posed else plan.table.get(every, _NONE)
            base = self._posed if posed else plan.content
            count = len(take) if len(table) or posed else 0  # a topic may have no row in this chunk
            head += [every, first, count, _address(take), _address(base), len(table), _address(table)]
        return np.array(head, np.int64)

    def append(self, v: np.ndarray) -> Any:
        """Log the vector v (n_values,) of the next tick; it is copied. Raises LogError when the disk is full."""
        self._room()
        if v.shape != self._shape:
            raise ValueError(f"a vector of shape {v.shape}; the log takes {self._shape}")
        v = np.ascontiguousarray(v, float)
        _STORE.call(_address(self._head), _address(v))

    def _room(self):
        if self._count[0] == self._rows:
            self.flush()

    def tell(self, tape: Any) -> None:
        """Tell a tape to log the bus."""
        tape.first(lambda k: self._room())
        tape.log(self._head)

    def window(self, k: Any, start: Any, end: Any, **texts: Any) -> None:
        """Log a foxglove.Event on /events at tick k: something lasts from tick `start` to `end` (None: open)."""
        data = foxglove.event(start * self.dt_ns, None if end is None else end * self.dt_ns, texts)
        self._pending.append((k, self._sink.ids["/events"], data))

    def flush(self) -> None:
        """Write the buffered ticks as a chunk. Raises LogError when that fails; the chunks before it stay whole."""
        k0, n = self._k0, self._n
        if not n:
            return
        plan = self._layout.plan(k0, n)
        if plan is not self._plan:
            plan.take(self._plan)
        tail, entries = self._tail(plan, k0, n)
        content = plan.ended(tail)
        own = self._compression == "lz4" and not PLAIN
        data = plan.frame.pack(content, tail) if own else [self._compress(content)]
        chunk = pack_chunk(self._layout, content, data, self._compression, k0, n, entries, self._sink.offset)
        self._sink.chunk(*chunk)
        # Ctrl-C may strike between any two lines: `_settle` tells from the first of these three how far it came
        self._done = self._sink.mark(), k0 + n
        self._pending = [m for m in self._pending if m[0] >= k0 + n]
        self._aim(k0 + n)

    def _tail(self, plan, k0, n):
        """Return the irregular messages of this chunk as (bytes, {channel: [(time, offset)]}).

        Their log times are kept inside the chunk, so that chunks never overlap; the messages hold their own times.
        """
        tail = [(max(k, k0), c, data) for k, c, data in self._pending if k < k0 + n]
        if self._pose is not None:
            first, every = -(-k0 // self._pose.every), self._pose.every
            rows = self._posed[: len(range(first * every, k0 + n, every))]
            poses = self._pose.messages(rows, first * every, self.dt_ns)
            tail += [(k, self._sink.ids[name], data) for k, name, data in poses]
        entries: dict = {}
        out = bytearray()
        for k, channel, data in sorted(tail, key=lambda m: m[0]):
            ns = k * self.dt_ns
            entries.setdefault(channel, []).append((ns, plan.size + len(out)))
            out += message_head(5, MESSAGE_BYTES + len(data), channel, k, ns, ns) + data
        return bytes(out), entries

    def close(self, result: dict | None = None) -> Any:
        """Write what is buffered, the result with a hash of all samples, and the summary; no result: incomplete.

        The log of a flight that did not end by itself replaces no other one, unless the user overwrites: it stays at
        `path`.part, and `path` says so.
        """
        if not self._sink.open:
            return
        check_texts("result", result or {})
        try:
            self._settle()
            self.flush()
            if self._pending:  # no tick came after them, so no chunk can hold them
                texts = {str(i): f"tick {k}: a window of /events" for i, (k, *_) in enumerate(self._pending)}
                self._sink.metadata("late_events", texts)
            if result is not None:
                self._sink.metadata("result", {**result, "content": content_hash(self._sink.chunks)})
            cut = result is None or result.get("status") == "interrupted"
            self._sink.finish(aside=cut and self._kept and os.path.isfile(self._sink.path) and not overwrites())
        finally:
            self._sink.drop()

    def _settle(self):
        """Go back to the last whole chunk, should Ctrl-C have struck within a flush; keep texts inside the last one."""
        mark, k = self._done
        self._sink.back_to(mark)
        if self._k0 != k:
            self._pending = [m for m in self._pending if m[0] >= k]
            self._aim(k)
        if self._n:
            self._pending = [(min(at, self._k0 + self._n - 1), c, data) for at, c, data in self._pending]

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, LogError) or (error and not self._kept):
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


def _targets(topics):
    """Return [(every, positions in the vector)] of each rate, topics side by side."""
    return [
        (every, np.concatenate([t.index for t in topics if t.every == every]).astype(np.int64))
        for every in sorted({t.every for t in topics})
    ]


def _address(array):
    return array.__array_interface__["data"][0]
