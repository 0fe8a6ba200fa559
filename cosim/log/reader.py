"""Read a log back, bit for bit, into numpy and pandas."""

import os
import struct
import zlib
from collections import Counter

import numpy as np
import zstandard
from google.protobuf.message import DecodeError

from . import foxglove
from .format import Limits, TopicInfo, log_error
from .scan import scan

_HEAD = struct.Struct("<BQHIQQ")  # a message record up to its payload, as chunk.HEAD


def open_log(path, *, limits=None):
    """Open a log strictly: checksums, structure and limits are checked before anything is returned.

    Raises LogError with the place for a file that is missing, cut, damaged, hostile, or not written by this package.
    """
    return Log(scan(path, limits or Limits()))


class Log:
    """Give the content of one log; memory is one chunk and what was asked for.

    `topics` {name: TopicInfo}, `metadata` {name: {str: str}}, `attachments` {name: bytes}, `media_types` {name: str},
    `dt_ns` [ns], `n_ticks`, `spans` [(first tick, ticks)] of the chunks, `complete` (the run ended by itself and wrote
    its result), `result` {str: str} or None.
    """

    def __init__(self, found):
        self._scan = found
        self.path, self.dt_ns = found.path, found.dt_ns
        self.metadata = {r.name: r.metadata for _, _, r in found.metadata}
        self.attachments = {r.name: r.data for _, _, r in found.attachments}
        self.media_types = {r.name: r.media_type for _, _, r in found.attachments}
        self.result = self.metadata.get("result")
        self.complete = found.closed and self.result is not None
        self.chunks = found.chunks
        self.spans = [found.ticks(c) for c in found.chunks]
        self.n_ticks = sum(n for _, n in self.spans)
        self.topics = {name: self._info(t) for name, t in found.topics.items()}

    def _info(self, t):
        rows = sum(len(range(-k0 % t.every, n, t.every)) for k0, n in self.spans)
        return TopicInfo(t.name, t.fields, t.units, t.every, rows, t.group, t.description)

    def array(self, topic):
        """Return the values of a topic (rows, fields) as float64, bit for bit as they were logged."""
        return self.arrays([topic])[topic]

    def arrays(self, topics=None):
        """Return {topic: (rows, fields)} of several topics (default: all), each chunk read once."""
        names = list(self.topics) if topics is None else list(topics)
        numbers = {self._number(name): name for name in names}
        try:
            out = {name: np.empty((self.topics[name].rows, len(self.topics[name].fields))) for name in names}
        except MemoryError as error:
            raise log_error("the topics do not fit into memory", self.path, remedy="Ask for fewer.") from error
        done = dict.fromkeys(names, 0)
        for plan, content, _ in self._contents():
            for number, name in numbers.items():
                if number not in plan.blocks:
                    continue
                rows = plan.blocks[number].rows
                part = out[name][done[name] : done[name] + rows]
                for fields, view in plan.values(content, number):
                    part[:, fields] = view
                done[name] += rows
        return out

    def _number(self, topic):
        if topic not in self.topics:
            raise KeyError(f"{self.path} has no topic {topic!r}; it has {', '.join(self.topics)}")
        return list(self.topics).index(topic)

    def ticks(self, topic):
        """Return the tick of each row of a topic (rows,) as int64."""
        every = self.topics[self._name(topic)].every
        parts = [np.arange(k0 + -k0 % every, k0 + n, every, dtype=np.int64) for k0, n in self.spans]
        return np.concatenate(parts) if parts else np.empty(0, np.int64)

    def _name(self, topic):
        self._number(topic)
        return topic

    def times_ns(self, topic):
        """Return the simulated time of each row of a topic (rows,) as int64 [ns]."""
        return self.ticks(topic) * self.dt_ns

    def _frame(self, topic, values):
        import pandas as pd  # half a second, which a run that only writes need not wait for

        index = pd.Index(self.times_ns(topic) / 1e9, name="t_s")
        return pd.DataFrame(values, index=index, columns=list(self.topics[topic].fields), copy=False)

    def frame(self, topic):
        """Return a topic as a DataFrame: a column per field, index `t_s` in float seconds (tick x dt, rounded once)."""
        return self._frame(topic, self.array(topic))

    def frames(self, topics=None):
        """Return {topic: DataFrame} of several topics (default: all), each chunk read once."""
        return {name: self._frame(name, values) for name, values in self.arrays(topics).items()}

    def fields(self, names):
        """Return single fields, named "/topic.field", as one DataFrame; slower topics are NaN at the ticks between."""
        import pandas as pd

        pairs = [name.rpartition(".")[::2] for name in names]
        for topic, field in pairs:
            if field not in self.topics[self._name(topic)].fields:
                raise KeyError(f"topic {topic} has no field {field!r}; it has {', '.join(self.topics[topic].fields)}")
        frames = self.frames(dict.fromkeys(topic for topic, _ in pairs))
        return pd.concat([frames[topic][field].rename(name) for name, (topic, field) in zip(names, pairs)], axis=1)

    def messages(self, topic):
        """Return the well-known messages of /log, /events, /tf or /fix as a list of (tick, protobuf message)."""
        if topic not in foxglove.TOPICS:
            raise KeyError(f"{topic!r} is none of {', '.join(foxglove.TOPICS)}")
        kind = foxglove.message(foxglove.TOPICS[topic][0].removeprefix("foxglove."))
        wanted = self._scan.ids.get(topic)
        try:
            return [(k, kind.FromString(data)) for *_, tail in self._contents() for c, k, data in tail if c == wanted]
        except DecodeError as error:
            raise log_error(f"a message on {topic} is no {kind.DESCRIPTOR.full_name}", self.path) from error

    def _contents(self):
        """Yield (plan, content as uint8, tail) of each chunk, checked."""
        try:
            with open(self.path, "rb") as file:
                for chunk in self._scan.chunks:
                    yield load_chunk(self._scan, file, chunk)
        except OSError as error:
            raise log_error(f"cannot read the log: {error.strerror}", self.path) from error


def load_chunk(found, file, chunk):
    """Return (plan, content, tail) of a chunk; raises LogError when a single byte is not as it must be.

    The tail is the list of irregular messages (channel id, tick, payload).
    """
    file.seek(chunk.data_offset)
    content = _decompress(found, file.read(chunk.data_size), chunk)
    if len(content) != chunk.size or zlib.crc32(content) != chunk.crc:
        raise log_error("the chunk is damaged (CRC)", found.path, chunk.offset)
    k0, n = found.ticks(chunk)
    plan, content = found.layout.plan(k0, n), np.frombuffer(content, "u1")
    wrong = plan.differs(content, k0)
    if wrong is not None:
        raise log_error(f"the chunk is not one message per sample (byte {wrong} of it)", found.path, chunk.offset)
    return plan, content, _tail(found, content[plan.size :].tobytes(), chunk)


def _tail(found, data, chunk):
    """Return the messages after the samples of a chunk; raises LogError unless they are whole and indexed."""
    irregular = {found.ids[name] for name in found.ids if name not in found.topics}
    tail, at = [], 0
    while at < len(data):
        whole = len(data) - at >= _HEAD.size
        op, length, channel, k, ns, publish = _HEAD.unpack_from(data, at) if whole else (0,) * 6
        end = at + 9 + length
        if not at + _HEAD.size <= end <= len(data) or op != 5 or channel not in irregular:
            raise log_error(f"byte {at} after the chunk's samples begins no message", found.path, chunk.offset)
        if not chunk.start_ns <= ns == publish <= chunk.end_ns or ns != k * found.dt_ns:
            raise log_error("a message has a time outside its chunk", found.path, chunk.offset)
        tail.append((channel, k, data[at + _HEAD.size : end]))
        at = end
    counts = Counter(channel for channel, _, _ in tail)
    if not found.tolerant and counts != {c: n for c, n in chunk.index_counts.items() if c in irregular}:
        raise log_error("the message indexes do not count what the chunk holds", found.path, chunk.offset)
    return tail


def _decompress(found, data, chunk):
    """Return the content; a frame that does not state the chunk's own size is refused before memory is taken."""
    if not chunk.compression:
        return data
    try:
        if zstandard.get_frame_parameters(data).content_size != chunk.size:
            raise log_error("the compressed frame is not as long as its chunk says", found.path, chunk.offset)
        return zstandard.ZstdDecompressor(max_window_size=1 << 27).decompress(data, allow_extra_data=False)
    except (zstandard.ZstdError, MemoryError) as error:
        raise log_error(f"the chunk cannot be decompressed: {error}", found.path, chunk.offset) from error


def is_log(path):
    """Tell whether a file begins as an MCAP file does."""
    with open(os.fspath(path), "rb") as file:
        return file.read(8) == b"\x89MCAP0\r\n"
