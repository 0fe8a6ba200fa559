"""Write a log while a run goes on: values go straight into message bytes, a compressed chunk per second."""

import os
from bisect import bisect_left, insort
from collections.abc import Sequence
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from mcap.records import Attachment, Channel, Metadata, Schema

from cosim.errors import CosimError

from . import foxglove
from .compression import compress, keep_memory
from .format import LogError, Topic, channel_metadata
from .layout import HEAD, Block, Layout, by_channel, content_hash, doubles, schema_data, schema_name
from .log_file import LogFile

ROWS = 200  # ticks of a chunk: one second at 200 Hz, lost when the process is killed
RESERVED = ("log", "preamble", "result", "recovered")  # names of metadata


class Target:
    """Rows that the values of a block are stored in: row k // every % len(rows) takes v[index] at the offsets `at`.

    The last number of `at` is the tick after the one stored last.
    """

    def __init__(self, block: Block, topics: Sequence[Topic], ticks: int):
        """Make rows for so many ticks, of topics that index the tick vector."""
        index = {t.name: t.index for t in topics}
        self.every, self.rows = block.every, np.tile(block.template, (-(-ticks // block.every), 1))
        self.index = np.concatenate([index[name] for name in block.places])
        self.at = np.concatenate([*block.places.values(), [0]])
        self._values = doubles(self.rows)

    def store(self, k: int, v: np.ndarray) -> None:
        """Store the values of tick `k`."""
        if k % self.every == 0:
            self._values[k // self.every % len(self.rows), self.at[:-1]] = v[self.index]
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
    "", "lz4" or "zstd"; `pose` adds /tf and /fix for viewers, of values that are logged at every tick. It takes its
    place when it is closed; what stood there stays until then. A kill or a full disk leaves `path`.part, unless `kept`
    is false, for what can be made again. Leaving the context without `close(result=...)`, as Ctrl-C does, gives a
    readable log that counts as incomplete; where it is not `kept`, an error leaves none.
    Raises ValueError for topics that do not fit together, LogError when the file cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike, topics: Any, *, n_values: Any, dt_ns: Any = 5_000_000,
        metadata: dict | None = None, attachments: dict | None = None, rows_per_chunk: Any = ROWS,
        compression: str = "lz4", pose: Any = None, kept: bool = True,
    ):  # fmt: skip
        self.dt_ns, topics, self._pose, self._rows = int(dt_ns), list(topics), pose, rows_per_chunk
        _check(topics, n_values, self.dt_ns, metadata or {})
        metadata = {"log": {"dt_ns": str(self.dt_ns)}, **(metadata or {})}
        self._compression, self._kept = compression, kept
        self._messages: list[tuple[int, str, bytes]] = []  # (tick, topic, payload) of those to come, in order
        keep_memory()
        records = [*_channels(topics), *(Metadata(name, dict(texts)) for name, texts in metadata.items())]
        records += [Attachment(0, 0, name, kind, bytes(data)) for name, (kind, data) in (attachments or {}).items()]
        self._ids = {r.topic: r.id for r in records if isinstance(r, Channel)}
        self._layout = Layout(topics, self._ids, self.dt_ns)
        self._blocks = [Target(block, topics, rows_per_chunk) for block in self._layout.blocks]
        every_tick = self._blocks[-1]  # of the fastest rate, one row a tick: what counts the ticks comes last
        self._last, place = every_tick.at, dict(zip(every_tick.index.tolist(), every_tick.at))
        self._where = [place[i] for i in pose.index] if pose else []
        self._file = LogFile(path, kept=kept)
        try:
            self._file.preamble(records)
        except BaseException:
            self._file.drop()
            raise

    @property
    def path(self) -> str:
        """Return where the log is."""
        return self._file.path

    @property
    def _k0(self):
        """Return the first tick of the chunk that is being filled."""
        return self._file.chunks[-1].end_ns // self.dt_ns + 1 if self._file.chunks else 0

    def append(self, v: np.ndarray) -> None:
        """Log the vector v (n_values,) of the next tick; it is copied. Raises LogError when the disk is full."""
        k, v = int(self._last[-1]), np.ascontiguousarray(v, float)
        self._room(k)
        for target in self._blocks:
            target.store(k, v)

    def _room(self, k):
        if k == self._k0 + self._rows:
            self.flush()

    def schedule(self, tape: Any) -> None:
        """Schedule on a tape to log the bus."""
        tape.first(self._room)
        for t in self._blocks:
            tape.scatter(t.index, t.at, t.rows, t.every)

    def message(self, k: int, topic: str, data: bytes) -> None:
        """Log a message on a topic of foxglove.TOPICS at tick k, which is still to come."""
        insort(self._messages, (k, topic, data))

    def window(self, k: Any, start: Any, end: Any, **texts: Any) -> None:
        """Log a foxglove.Event on /events at tick k: something lasts from tick `start` to `end` (None: open)."""
        data = foxglove.event(start * self.dt_ns, None if end is None else end * self.dt_ns, texts)
        self.message(k, "/events", data)

    def flush(self) -> None:
        """Write the buffered ticks as a chunk. Raises LogError when that fails; the chunks before it stay whole."""
        k0 = self._k0
        n = int(self._last[-1]) - k0
        if not n:
            return
        blocks = []
        for block, target in zip(self._layout.blocks, self._blocks):
            ticks = block.ticks(k0, n)
            blocks.append(block.stamp(target.of(ticks), ticks, self.dt_ns).data if ticks else b"")
        content = b"".join([*blocks, self._tail(k0, n)])
        times = k0 * self.dt_ns, (k0 + n - 1) * self.dt_ns
        data = compress(content, self._compression)
        index = self._layout.index(content, k0, n)
        self._file.chunk(data, self._compression, times, len(content), crc32(content), index)
        del self._messages[: bisect_left(self._messages, (k0 + n,))]

    def _tail(self, k0, n):
        """Return the irregular messages of this chunk in the order of time."""
        first, stop = (bisect_left(self._messages, (k,)) for k in (k0, k0 + n))
        tail = self._messages[first:stop]
        if self._pose:
            places = doubles(self._blocks[-1].of(range(k0, k0 + n)))[:, self._where]
            tail += self._pose.messages(places, k0, self.dt_ns)
        out = bytearray()
        for k, name, data in sorted(tail, key=lambda m: m[0]):
            ns = k * self.dt_ns
            out += HEAD.pack(5, HEAD.size - 9 + len(data), self._ids[name], k, ns, ns) + data
        return out

    def close(self, result: dict | None = None) -> None:
        """Write what is buffered, the result with a hash of all samples, and the summary; no result: incomplete.

        The log of a flight that did not end by itself replaces no other one: it stays at `path`.part, and `path` says
        so.
        """
        if not self._file.open:
            return
        try:
            self.flush()
            texts = {} if result is None else {"result": {**result, "content": content_hash(self._file.chunks)}}
            cut = result is None or result.get("status") == "interrupted"
            self._file.finish(texts, aside=cut and self._kept and os.path.isfile(self._file.path))
        finally:
            self._file.drop()

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, LogError) or (error and not self._kept):
            self._file.drop()
        else:
            self.close()
            if isinstance(error, CosimError) and self.path == os.fspath(self._file.part):
                left = f"The flight so far is {self.path}: remove it before the next flight to this log"
                error.remedy = ". ".join(filter(None, (error.remedy, left)))


def _channels(topics):
    """Yield the Schema and the Channel of each message of a log."""
    declared: list = [(name, schema_name(name), schema_data(name, tuple(parts)), channel_metadata(parts))
                      for name, parts in by_channel(topics).items()]  # fmt: skip
    declared += [(name, m.DESCRIPTOR.full_name, foxglove.schema(m), {}) for name, m in foxglove.TOPICS.items()]
    for i, (topic, message, data, texts) in enumerate(declared, 1):
        yield Schema(id=i, name=message, encoding="protobuf", data=data)
        yield Channel(id=i, topic=topic, message_encoding="protobuf", metadata=texts, schema_id=i)


def _check(topics, n_values, dt_ns, metadata):
    names = [t.name for t in topics]
    far = [t.name for t in topics if t.index.min() < 0 or t.index.max() >= n_values]
    for wrong, said in (
        (len({*names, *foxglove.TOPICS}) < len(names) + len(foxglove.TOPICS),
         f"topics must have distinct names other than {sorted(foxglove.TOPICS)}"),
        (all(t.every > 1 for t in topics), "at least one topic must be logged at every tick"),
        (far, f"topics {far}: a position lies outside the tick vector of {n_values} values"),
        (set(metadata) & set(RESERVED), f"metadata names {RESERVED} are taken"),
        (dt_ns <= 0, f"dt_ns must be positive, not {dt_ns}"),
    ):  # fmt: skip
        if wrong:
            raise ValueError(said)
