"""Write a replay beside what was logged: a log with every old topic and, under /replay, the new outputs."""

from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import LogError
from cosim.log import Log, LogWriter, Pose, Topic
from cosim.log.writer import RESERVED

POSE = ("lat", "lon", "h", "phi", "theta", "psi")


class Overlay:
    """Write the log at `path` span after span; use as a context manager. Raises LogError for a log with gaps."""

    def __init__(self, log: Log, wired: Any, path: str | Path):
        if len(log.spans) == 0 or log.spans[0][0] or sum(log.spans[-1]) != log.n_ticks:
            raise LogError("ticks are missing, and an overlay needs every one", place=str(log.path))
        self._log, self._names, self._n = log, [n for n in log.topics if not n.startswith("/replay/")], 0
        self._topics = [self._topic(n, log.topics[n], log.topics[n].group) for n in self._names]
        self._topics += [self._topic("/replay" + w.topic, log.topics[w.topic], "replay") for w in wired]
        self._writer = self._open(path)

    def _topic(self, name, info, group):
        index = np.arange(self._n, self._n + len(info.fields))
        self._n += len(info.fields)
        return Topic(name, info.fields, info.units, index, info.every, group, info.description)

    def _open(self, path):
        log = self._log
        attachments = {n: (log.media_types[n], data) for n, data in log.attachments.items()}
        metadata = {n: v for n, v in log.metadata.items() if n not in RESERVED}
        metadata["replay_of"] = {"content": (log.result or {}).get("content", "")}
        writer = LogWriter(
            path,
            self._topics,
            n_values=self._n,
            dt_ns=log.dt_ns,
            metadata=metadata,
            attachments=attachments,
            rows_per_chunk=500,
            pose=self._pose(),
            kept=False,
        )
        for k, event in log.messages("/events"):
            end = event.end_time.ToNanoseconds() // log.dt_ns if event.HasField("end_time") else None
            writer.window(
                k, event.start_time.ToNanoseconds() // log.dt_ns, end, **{m.key: m.value for m in event.metadata}
            )
        return writer

    def _pose(self):
        for t in self._topics:
            if t.group == "truth" and set(POSE) <= set(t.fields):
                return Pose(**{n: int(t.index[t.fields.index(n)]) for n in POSE})
        return None

    def append(self, read: dict, new: Any, start: float, stop: Any) -> Any:
        """Write the ticks start <= k < stop: `read` {topic: (rows, fields)} as logged, `new` (rows, n) of each lane."""
        rows = np.zeros((min(stop, self._log.n_ticks) - start, self._n))
        for t, values in zip(self._topics, (*(read[n] for n in self._names), *new)):
            rows[-start % t.every :: t.every, t.index[0] : t.index[-1] + 1] = values
        for row in rows:
            self._writer.append(row)

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if kind is None:
            result = {k: v for k, v in (self._log.result or {}).items() if k != "content"}
            self._writer.close(result=result if self._log.complete else None)
        else:
            self._writer.__exit__(kind, error, trace)
