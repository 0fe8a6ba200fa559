"""Write a log while a run goes on: a vector per tick, a compressed chunk per hundred ticks, whole after any end."""

import errno
import hashlib
import os
import zlib

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema

from . import foxglove
from .chunk import Layout
from .format import LIBRARY, LogError, channel_metadata, log_error, schema_data, schema_name
from .records import MAGIC, closing, pack_chunk

# of zstd, measured on 100 ticks of 300 noisy values: level 1 takes 7.6 us a tick and leaves 76 %, -5 2.2 us and 82 %
# (lz4 3.6 us and 87 %)
LEVEL = -5
RESERVED = ("log", "result", "early_events", "recovered")


class LogWriter:
    """Write one self-contained MCAP log; use it as a context manager.

    `topics` are the sampled channels (at least one of them at every tick), `n_values` the length of the tick vector,
    `dt_ns` the tick [ns], `metadata` {name: {str: str}} and `attachments` {name: (media type, bytes)} go in first.
    `level` is that of zstd, 0 for none.
    Leaving the context without `close(result=...)`, as Ctrl-C does, gives a readable log that counts as incomplete.
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
        rows_per_chunk=100,
        level=LEVEL,
        pose=None,
    ):
        self.path, self.dt_ns = os.fspath(path), int(dt_ns)
        self._topics, self._pose = list(topics), pose
        self._check(n_values, metadata or {}, rows_per_chunk)
        self._buffer = np.zeros((rows_per_chunk, n_values))
        self._n = self._k0 = 0  # rows in the buffer, and the tick of the first
        self._pending = []  # (tick, channel id, payload) of irregular messages, in order
        self._index = [_as_slice(t.index) for t in self._topics]
        self._hashes = [hashlib.sha256() for _ in self._topics]
        self._offset = self._crc = 0
        self._chunks, self._metadata, self._attachments = [], [], []
        self._compress = zstandard.ZstdCompressor(level=level).compress if level else bytes
        self._compression = "zstd" if level else ""
        self._file = self._open()
        try:
            self._begin(metadata or {}, attachments or {})
        except BaseException:
            self._drop()
            raise

    def _check(self, n_values, metadata, rows_per_chunk):
        names = [t.name for t in self._topics]
        if len(set(names)) != len(names) or set(names) & set(foxglove.TOPICS):
            raise ValueError(f"topics must have distinct names other than {sorted(foxglove.TOPICS)}")
        if not any(t.every == 1 for t in self._topics):
            raise ValueError("at least one topic must be logged at every tick")
        for topic in self._topics:
            if topic.index.min() < 0 or topic.index.max() >= n_values:
                raise ValueError(f"topic {topic.name}: a position lies outside the tick vector of {n_values} values")
        if set(metadata) & set(RESERVED):
            raise ValueError(f"metadata names {RESERVED} are taken")
        if self.dt_ns <= 0 or rows_per_chunk < 1:
            raise ValueError("dt_ns and rows_per_chunk must be positive")

    def _open(self):
        try:
            return open(self.path, "wb", buffering=0)
        except OSError as error:
            raise log_error(f"cannot create the log: {error.strerror}", self.path, remedy=_ELSEWHERE) from error

    def _begin(self, metadata, attachments):
        self._put(MAGIC + _encode(Header(profile="", library=LIBRARY)))
        self._schemas, self._channels, self._ids = [], [], {}
        for topic in self._topics:
            data = schema_data(topic.name, topic.fields)
            self._declare(topic.name, schema_name(topic.name), data, channel_metadata(topic))
        for name, (message, data) in foxglove.TOPICS.items():
            self._declare(name, message, data(), {})
        self._layout = Layout([(self._ids[t.name], len(t.fields), t.every) for t in self._topics], self.dt_ns)
        self._put(b"".join(_encode(record) for pair in zip(self._schemas, self._channels) for record in pair))
        self._write_metadata("log", {"dt_ns": str(self.dt_ns)})
        for name, texts in metadata.items():
            self._write_metadata(name, texts)
        for name, (media_type, data) in attachments.items():
            record = Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=bytes(data))
            at, blob = self._offset, _encode(record)
            self._put(blob)
            self._attachments.append((at, len(blob), record))

    def _declare(self, topic, schema, data, metadata):
        number = len(self._channels) + 1
        self._schemas.append(Schema(id=number, name=schema, encoding="protobuf", data=data))
        self._channels.append(
            Channel(id=number, topic=topic, message_encoding="protobuf", schema_id=number, metadata=metadata)
        )
        self._ids[topic] = number

    def append(self, v):
        """Log the vector v (n_values,) of the next tick; it is copied. Raises LogError when the disk is full."""
        if self._n == len(self._buffer):
            self.flush()
        self._buffer[self._n] = v
        self._n += 1

    def event(self, k, message, level="info"):
        """Log a text at tick k on /log (foxglove.Log); level is debug, info, warning, error or fatal."""
        self._pending.append((k, self._ids["/log"], foxglove.log(k * self.dt_ns, message, level)))

    def window(self, k, start, end, **texts):
        """Log a foxglove.Event on /events at tick k: something lasts from tick `start` to `end` (None: open)."""
        data = foxglove.event(start * self.dt_ns, None if end is None else end * self.dt_ns, texts)
        self._pending.append((k, self._ids["/events"], data))

    def flush(self):
        """Write the buffered ticks as a chunk. Raises LogError when that fails; the chunks before it stay whole."""
        if not self._n:
            return
        k0, n = self._k0, self._n
        plan = self._layout.plan(k0, n)
        tail, entries, later = self._tail(plan, k0, n)
        content, hashes = plan.template(k0, tail), []
        for number, index in enumerate(self._index):
            hashes.append(self._hashes[number].copy())
            if number in plan.blocks:
                rows = np.ascontiguousarray(self._buffer[plan.blocks[number][0]][:, index])
                hashes[-1].update(rows)
                for fields, view in plan.values(content, number):
                    view[:] = rows[:, fields]
        data = self._compress(content)
        blobs, ref = pack_chunk(self._layout, content, data, self._compression, k0, n, entries, self._offset)
        crc = self._crc
        for blob in blobs:
            crc = zlib.crc32(blob, crc)
            self._write(blob)
        self._chunks.append(ref)
        # Ctrl-C strikes only at calls and jumps back, so these plain assignments happen all or not at all
        self._offset, self._crc, self._hashes, self._pending, self._k0, self._n = (
            ref.offset + ref.length + ref.index_length,
            crc,
            hashes,
            later,
            k0 + n,
            0,
        )

    def _tail(self, plan, k0, n):
        """Return the irregular messages of this chunk as (bytes, index entries), and those of later ticks.

        Their log times are kept inside the chunk, so that chunks never overlap; the messages hold their own times.
        """
        last = k0 + n - 1
        tail = [(max(k, k0), c, data) for k, c, data in self._pending if k <= last]
        if self._pose is not None:
            poses = self._pose.messages(self._buffer[:n], k0, self.dt_ns)
            tail += [(k, self._ids[name], data) for k, name, data in poses]
        builder, entries = RecordBuilder(), {}
        for k, channel, data in sorted(tail, key=lambda m: m[0]):
            ns = k * self.dt_ns
            entries.setdefault(channel, []).append((ns, plan.size + builder.count))
            Message(channel_id=channel, log_time=ns, data=data, publish_time=ns, sequence=k).write(builder)
        return builder.end(), entries, [m for m in self._pending if m[0] > last]

    def close(self, result=None):
        """Write what is buffered, the result with a hash per topic, and the summary; without a result: incomplete.

        The hash is the SHA-256 of the topic's float64 values, little endian, row after row.
        """
        if self._file.closed:
            return
        try:
            self._roll_back()
            self._pending = [(min(k, self._k0 + self._n - 1), c, data) for k, c, data in self._pending]
            early = [] if self._k0 + self._n else [(k, foxglove.text(data)) for k, _, data in self._pending]
            self.flush()
            if early:  # there is no chunk that could hold them
                self._write_metadata("early_events", {str(i): f"tick {k}: {text}" for i, (k, text) in enumerate(early)})
            if result is not None:
                digests = {f"sha256 {t.name}": h.hexdigest() for t, h in zip(self._topics, self._hashes)}
                self._write_metadata("result", {**result, **digests})
            declared = self._schemas, self._channels
            found = self._chunks, self._attachments, self._metadata
            self._write(closing(self._offset, self._crc, *declared, *found))
        finally:
            self._drop()

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, LogError):
            self._drop()
        else:
            self.close()

    def _write_metadata(self, name, texts):
        if not all(isinstance(text, str) for pair in texts.items() for text in pair):
            raise ValueError(f"metadata {name!r}: keys and values must be str")
        at, record = self._offset, Metadata(name=name, metadata=dict(texts))
        blob = _encode(record)
        self._put(blob)
        self._metadata.append((at, len(blob), record))

    def _put(self, blob):
        """Write bytes of the data section and keep count of them."""
        crc = zlib.crc32(blob, self._crc)
        self._write(blob)
        self._offset, self._crc = self._offset + len(blob), crc

    def _write(self, blob):
        """Write all of `blob`, or nothing and raise LogError; a raw file may take less than it is given."""
        view = memoryview(blob)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            at, full = self._offset, error.errno in _FULL
            self._drop()
            kept = f"The first {self._k0} ticks are kept: `cosim recover` makes them a readable log."
            remedy = f"{'Free some space, or l' if full else 'L'}og to another place (-o). {kept}"
            raise log_error(f"cannot write the log: {error.strerror}", self.path, at, remedy) from error

    def _roll_back(self):
        """Forget what an interrupted write left after the last whole chunk."""
        del self._chunks[next((i for i, c in enumerate(self._chunks) if c.offset >= self._offset), len(self._chunks)) :]
        self._file.seek(self._offset)
        self._file.truncate()

    def _drop(self):
        self._file.close()


_ELSEWHERE = "Choose another place (-o)."
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _encode(record):
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _as_slice(index):
    """Return the slice equal to `index` where it is a run of neighbours: a slice is gathered faster."""
    run = np.arange(index[0], index[0] + len(index))
    return slice(int(index[0]), int(index[0]) + len(index)) if np.array_equal(index, run) else index
