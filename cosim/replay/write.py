"""Write a replay beside what was logged: a log with every old topic and, under /replay, the new outputs."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
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


@contextmanager
def overlay(log: Log, again: Sequence[str], path: str | Path) -> Iterator[Callable[[dict, dict, int, int], None]]:
    """Give a function that writes the ticks start <= k < stop of `log` to a log at `path`: all of its topics as they
    were read, {topic: (rows, fields)}, and those of `again` as they were replayed. Raises LogError for a log with gaps.
    """
    if not log.n_ticks or log.gaps:
        raise LogError("ticks are missing, and an overlay needs every one", place=str(log.path))
    names = [n for n in log.topics if not n.startswith("/replay/")]
    olds = [(n, log.topics[n], log.topics[n].group) for n in names]
    topics = stacked([*olds, *(("/replay" + n, log.topics[n], "replay") for n in again)])
    how: dict[str, Any] = {"attachments": {n: (log.media_types[n], data) for n, data in log.attachments.items()}}
    how["metadata"] = {n: v for n, v in log.metadata.items() if n not in RESERVED}
    how["metadata"]["replay_of"] = {"content": (log.result or {}).get("content", "")}
    how |= {"n_values": topics[-1].index[-1] + 1, "dt_ns": log.dt_ns, "rows_per_chunk": 500, "kept": False}
    with LogWriter(path, topics, **how) as writer:

        def written(read, new, start, stop):
            for topic in TOPICS:
                for k, message in log.messages(topic, start, stop):
                    writer.message(k, topic, message.SerializeToString())
            append(writer, topics, [*(read[n] for n in names), *(new[n] for n in again)], start, stop)

        yield written
        result = {k: v for k, v in (log.result or {}).items() if k != "content"}
        writer.close(result=result if log.complete else None)
