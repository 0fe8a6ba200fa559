"""Write a replay beside what was logged: a log with every old topic and, under /replay, the new outputs."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import LogError
from cosim.log import Log, LogWriter, Topic
from cosim.log.foxglove import TOPICS
from cosim.log.writer import RESERVED


def stacked(topics: Iterable[tuple[str, Any, str]]) -> list[Topic]:
    """Return Topics of one tick vector of (name, what has name, channel, fields, units, every, group), one behind the
    other."""
    out, at = [], 0
    for name, t, group in topics:
        index = np.arange(at, at + len(t.fields))
        out.append(Topic(name, t.fields, t.units, index, t.every, group, name.removesuffix(t.name) + t.channel))
        at += len(t.fields)
    return out


def append(writer: LogWriter, topics: Sequence[Topic], values: Iterable[Any], start: int, stop: int) -> None:
    """Write the ticks start <= k < stop of `topics`, one behind the other, of each the values (rows, fields)."""
    rows = np.zeros((stop - start, topics[-1].index[-1] + 1))
    for t, own in zip(topics, values):
        rows[-start % t.every :: t.every, t.index[0] : t.index[-1] + 1] = own
    for row in rows:
        writer.append(row)


class Overlay:
    """Write the log at `path` span after span; use as a context manager. Raises LogError for a log with gaps."""

    def __init__(self, log: Log, wired: Any, path: str | Path):
        if len(log.spans) == 0 or log.spans[0][0] or sum(log.spans[-1]) != log.n_ticks:
            raise LogError("ticks are missing, and an overlay needs every one", place=str(log.path))
        self._log, self._names = log, [n for n in log.topics if not n.startswith("/replay/")]
        olds = [(n, log.topics[n], log.topics[n].group) for n in self._names]
        self._new = [w.topic for w in wired]
        news = [("/replay" + topic, log.topics[topic], "replay") for topic in self._new]
        self._topics = stacked([*olds, *news])
        how: dict[str, Any] = {"attachments": {n: (log.media_types[n], data) for n, data in log.attachments.items()}}
        how["metadata"] = {n: v for n, v in log.metadata.items() if n not in RESERVED}
        how["metadata"]["replay_of"] = {"content": (log.result or {}).get("content", "")}
        how |= {"n_values": self._topics[-1].index[-1] + 1, "dt_ns": log.dt_ns, "rows_per_chunk": 500, "kept": False}
        self._writer = LogWriter(path, self._topics, **how)

    def append(self, read: dict, new: dict, start: int, stop: int) -> None:
        """Write the ticks start <= k < stop: {topic: (rows, fields)} as logged, and of each lane as replayed."""
        for topic in TOPICS:
            for k, message in self._log.messages(topic, start, stop):
                self._writer.message(k, topic, message.SerializeToString())
        values = [*(read[n] for n in self._names), *(new[n] for n in self._new)]
        append(self._writer, self._topics, values, start, stop)

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if kind is None:
            result = {k: v for k, v in (self._log.result or {}).items() if k != "content"}
            self._writer.close(result=result if self._log.complete else None)
        else:
            self._writer.__exit__(kind, error, trace)
