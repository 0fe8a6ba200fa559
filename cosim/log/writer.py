"""Write a log while a run goes on: values go straight into message bytes, a compressed chunk per second."""

import contextlib
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from isal.isal_zlib import crc32

from . import foxglove
from .compression import COMPRESSIONS, compress, keep_memory
from .format import Limits, LogError, channel_metadata, check_texts
from .layout import HEAD, Layout, by_channel, content_hash, schema_data, schema_name
from .log_file import LogFile

ROWS = 200  # ticks of a chunk: one second at 200 Hz, lost when the process is killed
RESERVED = ("log", "preamble", "result", "late_events", "recovered")  # names of metadata
LEAST_SHARE = 0.5  # of a log's content, at least, is taken on the disk: noise does not compress


def fits(path: str | os.PathLike, topics: Any, ticks: int, dt_s: float) -> None:
    """Raise LogError where a log of so many ticks could not be read again, or has no place on its disk."""
    blocks = Layout(topics, dict.fromkeys((t.channel for t in topics), 0), 1).blocks
    per_tick = sum(block.size / block.every for block in blocks)
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


class _Target:
    """Rows that the values of one rate are stored in: row k // every % len(rows) takes v[index] at the offsets `at`.

    The last number of `at` is the tick after the one stored last.
    """

    def __init__(self, every: int, index: Any, at: Any, rows: np.ndarray):
        self.every, self.rows = every, rows
        self.index, self.at = np.array(index, np.int64), np.array([*at, 0], np.int64)
        self._bytes = self.at[:-1, None] + np.arange(8)

    def store(self, k: int, v: np.ndarray) -> None:
        """Store the values of tick `k`."""
        if k % self.every == 0:
            self.rows[k // self.every % len(self.rows)][self._bytes] = v[self.index].view("u1").reshape(-1, 8)
        self.at[-1] = k + 1

    def of(self, ticks: range) -> np.ndarray:
        """Return the rows of these ticks, which last until the next one is stored."""
        first, size = ticks.start // self.every % len(self.rows), len(ticks)
        whole = first + size <= len(self.rows)
        return self.rows[first : first + size] if whole else np.roll(self.rows, -first, 0)[:size]


class LogWriter:
    """Write one self-contained MCAP log; use it as a context manager.

    `topics` are the parts (at least one of them at every tick), `n_values` the length of the tick vector, `dt_ns` the
    tick [ns], `metadata` {name: {str: str}} and `attachments` {name: (media type, bytes)} go in first; `compression` is
    one of COMPRESSIONS; `pose` adds /tf and /fix for viewers. It takes its place when it is closed; what stood there
    stays until then. A kill or a full disk leaves `path`.part, unless `kept` is false, for what can be made again.
    Leaving the context without `close(result=...)`, as Ctrl-C does, gives a readable log that counts as incomplete;
    where it is not `kept`, an error leaves none.
    Raises ValueError for topics that do not fit together, LogError when the file cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike, topics: Any, *, n_values: Any, dt_ns: Any = 5_000_000,
        metadata: dict | None = None, attachments: dict | None = None, rows_per_chunk: Any = ROWS,
        compression: str = "lz4", pose: Any = None, kept: bool = True,
    ):  # fmt: skip
        self.dt_ns, topics, self._pose, self._rows = int(dt_ns), list(topics), pose, rows_per_chunk
        _check(topics, n_values, self.dt_ns, metadata or {}, rows_per_chunk, compression)
        self._shape, self._compression, self._kept = (n_values,), compression, kept
        self._pending: list[tuple[int, int, bytes]] = []  # (tick, channel id, payload) of irregular messages
        keep_memory()
        declared: list = [(name, schema_name(name), schema_data(name, parts), channel_metadata(parts))
                          for name, parts in by_channel(topics).items()]  # fmt: skip
        declared += [(name, message, data(), {}) for name, (message, data) in foxglove.TOPICS.items()]
        self._layout = Layout(topics, {name: i for i, (name, *_) in enumerate(declared, 1)}, self.dt_ns)
        self._targets = [self._target(block, {t.name: t.index for t in topics}) for block in self._layout.blocks]
        self._posed = None
        if pose is not None:
            rows = np.zeros((-(-rows_per_chunk // pose.every), 48), "u1")
            self._posed = _Target(pose.every, pose.index, range(0, 48, 8), rows)
        self._last = self._targets[-1].at  # of the fastest rate, one row a tick
        self._file = LogFile(path, kept=kept)
        try:
            self._file.preamble(declared, {"log": {"dt_ns": str(self.dt_ns)}, **(metadata or {})}, attachments or {})
        except BaseException:
            self._file.drop()
            raise
        self._done = self._file.mark(), 0  # what is safely written: place in the file, next tick

    def _target(self, block, index):
        rows = np.tile(block.template, (-(-self._rows // block.every), 1))
        columns = np.concatenate([index[name] for name in block.places])
        return _Target(block.every, columns, np.concatenate([*block.places.values()]), rows)

    @property
    def path(self) -> str:
        """Return where the log is."""
        return self._file.path

    @property
    def _k0(self):
        return self._done[1]  # first tick of the chunk that is being filled

    @property
    def _n(self):
        return int(self._last[-1]) - self._k0  # ticks of it so far

    def append(self, v: np.ndarray) -> None:
        """Log the vector v (n_values,) of the next tick; it is copied. Raises LogError when the disk is full."""
        if v.shape != self._shape:
            raise ValueError(f"a vector of shape {v.shape}; the log takes {self._shape}")
        k, v = int(self._last[-1]), np.ascontiguousarray(v, float)
        self._room(k)
        for target in (*([self._posed] if self._posed else ()), *self._targets):  # what counts the ticks comes last
            target.store(k, v)

    def _room(self, k):
        if k == self._k0 + self._rows:
            self.flush()

    def tell(self, tape: Any) -> None:
        """Tell a tape to log the bus."""
        tape.first(self._room)
        for t in (*([self._posed] if self._posed else ()), *self._targets):
            tape.scatter(t.index, t.at, t.rows, t.every)

    def window(self, k: Any, start: Any, end: Any, **texts: Any) -> None:
        """Log a foxglove.Event on /events at tick k: something lasts from tick `start` to `end` (None: open)."""
        data = foxglove.event(start * self.dt_ns, None if end is None else end * self.dt_ns, texts)
        self._pending.append((k, self._file.ids["/events"], data))

    def flush(self) -> None:
        """Write the buffered ticks as a chunk. Raises LogError when that fails; the chunks before it stay whole."""
        k0, n = self._k0, self._n
        if not n:
            return
        blocks = []
        for block, target in zip(self._layout.blocks, self._targets):
            ticks = block.ticks(k0, n)
            blocks.append(block.stamp(target.of(ticks), ticks, self.dt_ns).data if ticks else b"")
        tail, index = self._tail(sum(self._layout.sizes(k0, n)), k0, n)
        content = b"".join([*blocks, tail])
        times = k0 * self.dt_ns, (k0 + n - 1) * self.dt_ns
        data = compress(content, self._compression)
        entries = (*self._layout.index(k0, n), *index.items())
        self._file.chunk(data, self._compression, times, len(content), crc32(content), entries)
        # Ctrl-C may strike between any two lines: `_settle` tells from this one how far it came
        self._done = self._file.mark(), k0 + n
        self._pending = [m for m in self._pending if m[0] >= k0 + n]

    def _tail(self, size, k0, n):
        """Return the irregular messages of this chunk as (bytes, {channel: (messages, 2) of time and offset}).

        Their log times are kept inside the chunk, so that chunks never overlap; the messages hold their own times.
        """
        tail = [(max(k, k0), c, data) for k, c, data in self._pending if k < k0 + n]
        if self._posed:
            ticks = range(k0 + -k0 % self._pose.every, k0 + n, self._pose.every)
            rows = self._posed.of(ticks).view("<f8")
            poses = self._pose.messages(rows, ticks.start, self.dt_ns)
            tail += [(k, self._file.ids[name], data) for k, name, data in poses]
        entries: dict = {}
        out = bytearray()
        for k, channel, data in sorted(tail, key=lambda m: m[0]):
            ns = k * self.dt_ns
            entries.setdefault(channel, []).append((ns, size + len(out)))
            out += HEAD.pack(5, HEAD.size - 9 + len(data), channel, k, ns, ns) + data
        return bytes(out), {channel: np.array(own, "<u8") for channel, own in entries.items()}

    def close(self, result: dict | None = None) -> None:
        """Write what is buffered, the result with a hash of all samples, and the summary; no result: incomplete.

        The log of a flight that did not end by itself replaces no other one: it stays at
        `path`.part, and `path` says so.
        """
        if not self._file.open:
            return
        check_texts("result", result or {})
        try:
            self._settle()
            self.flush()
            if self._pending:  # no tick came after them, so no chunk can hold them
                texts = {str(i): f"tick {k}: a window of /events" for i, (k, *_) in enumerate(self._pending)}
                self._file.metadata("late_events", texts)
            if result is not None:
                self._file.metadata("result", {**result, "content": content_hash(self._file.chunks)})
            cut = result is None or result.get("status") == "interrupted"
            self._file.finish(aside=cut and self._kept and os.path.isfile(self._file.path))
        finally:
            self._file.drop()

    def _settle(self):
        """Go back to the last whole chunk, should Ctrl-C have struck within a flush; keep texts inside the last one."""
        mark, k0 = self._done
        self._file.back_to(mark)
        self._pending = [m for m in self._pending if m[0] >= k0 or self._n]
        if self._n:
            self._pending = [(min(at, k0 + self._n - 1), c, data) for at, c, data in self._pending]

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, LogError) or (error and not self._kept):
            self._file.drop()
        else:
            self.close()


def _check(topics, n_values, dt_ns, metadata, rows_per_chunk, compression):
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
    if dt_ns <= 0 or rows_per_chunk < 1 or compression not in COMPRESSIONS:
        raise ValueError(f"dt_ns and rows_per_chunk must be positive, compression one of {COMPRESSIONS}")
