"""Read a log back, bit for bit, into numpy and pandas."""

import os
import zlib

import numpy as np
import pandas as pd
import zstandard

from .format import Limits, TopicInfo, log_error
from .scan import scan, ticks


def open_log(path, *, limits=None):
    """Open a log strictly: checksums, structure and limits are checked before anything is returned.

    Raises LogError with the place for a file that is missing, cut, damaged, hostile, or not written by this package.
    """
    return Log(scan(path, limits or Limits()))


class Log:
    """Give the content of one log; memory is one chunk and what was asked for.

    `topics` {name: TopicInfo}, `metadata` {name: {str: str}}, `attachments` {name: bytes}, `media_types` {name: str},
    `dt_ns` [ns], `n_ticks`, `complete` (the run ended by itself and wrote its result), `result` {str: str} or None.
    """

    def __init__(self, found):
        self._scan = found
        self.path, self.dt_ns = found.path, found.dt_ns
        self.metadata = {r.name: r.metadata for _, _, r in found.metadata}
        self.attachments = {r.name: r.data for _, _, r in found.attachments}
        self.media_types = {r.name: r.media_type for _, _, r in found.attachments}
        self.result = self.metadata.get("result")
        self.complete = found.closed and self.result is not None
        self._spans = [ticks(c, self.dt_ns) for c in found.chunks]
        self.n_ticks = sum(n for _, n in self._spans)
        self.topics = {name: self._info(t) for name, t in found.topics.items()}

    def _info(self, t):
        rows = sum(len(range(-k0 % t.every, n, t.every)) for k0, n in self._spans)
        return TopicInfo(t.name, t.fields, t.units, t.every, rows, t.group, t.description)

    def array(self, topic):
        """Return the values of a topic (rows, fields) as float64, bit for bit as they were logged."""
        return self.arrays([topic])[topic]

    def arrays(self, topics=None):
        """Return {topic: (rows, fields)} of several topics (default: all), each chunk read once."""
        names = list(self.topics) if topics is None else list(topics)
        numbers = {self._number(name): name for name in names}
        out = {name: np.empty((self.topics[name].rows, len(self.topics[name].fields))) for name in names}
        done = dict.fromkeys(names, 0)
        for plan, content in self._contents():
            for number, name in numbers.items():
                if number not in plan.blocks:
                    continue
                rows = plan.blocks[number][1]
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
        parts = [np.arange(k0 + -k0 % every, k0 + n, every, dtype=np.int64) for k0, n in self._spans]
        return np.concatenate(parts) if parts else np.empty(0, np.int64)

    def _name(self, topic):
        self._number(topic)
        return topic

    def times_ns(self, topic):
        """Return the simulated time of each row of a topic (rows,) as int64 [ns]."""
        return self.ticks(topic) * self.dt_ns

    def _frame(self, topic, values):
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
        pairs = [name.rpartition(".")[::2] for name in names]
        for topic, field in pairs:
            if field not in self.topics[self._name(topic)].fields:
                raise KeyError(f"topic {topic} has no field {field!r}; it has {', '.join(self.topics[topic].fields)}")
        frames = self.frames(dict.fromkeys(topic for topic, _ in pairs))
        return pd.concat([frames[topic][field].rename(name) for name, (topic, field) in zip(names, pairs)], axis=1)

    def _contents(self):
        """Yield (plan, content as uint8) of each chunk, checked."""
        try:
            with open(self.path, "rb") as file:
                for chunk in self._scan.chunks:
                    yield load_chunk(self._scan, file, chunk)
        except OSError as error:
            raise log_error(f"cannot read the log: {error.strerror}", self.path) from error


def load_chunk(found, file, chunk):
    """Return (plan, content) of a chunk; raises LogError when a single byte is not as it must be."""
    file.seek(chunk.data_offset)
    content = _decompress(found, file.read(chunk.data_size), chunk)
    if len(content) != chunk.size or zlib.crc32(content) != chunk.crc:
        found.fail("the chunk is damaged (CRC)", chunk.offset)
    k0, n = ticks(chunk, found.dt_ns)
    plan, content = found.layout.plan(k0, n), np.frombuffer(content, "u1")
    wrong = plan.differs(content, k0)
    if wrong is not None:
        found.fail(f"the chunk's content is not one message per sample (its byte {wrong})", chunk.offset)
    return plan, content


def _decompress(found, data, chunk):
    """Return the content; a frame that does not state the chunk's own size is refused before memory is taken."""
    if not chunk.compression:
        return data
    try:
        if zstandard.get_frame_parameters(data).content_size != chunk.size:
            found.fail("the compressed frame is not as long as its chunk says", chunk.offset)
        return zstandard.ZstdDecompressor(max_window_size=1 << 27).decompress(data, allow_extra_data=False)
    except (zstandard.ZstdError, MemoryError) as error:
        raise log_error(f"the chunk cannot be decompressed: {error}", found.path, chunk.offset) from error


def is_log(path):
    """Tell whether a file begins as an MCAP file does."""
    with open(os.fspath(path), "rb") as file:
        return file.read(8) == b"\x89MCAP0\r\n"
