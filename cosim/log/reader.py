"""Read a log back, bit for bit, into numpy and pandas."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Attachment

from cosim.errors import did_you_mean, told_at_call

from . import foxglove
from .compression import keep_memory
from .format import LogError, log_error
from .layout import doubles
from .walker import content, scan

CACHE_BYTES = 32 << 20  # content of chunks that stays in memory: several topics of a short log are decompressed once


class Units(dict[str, str]):
    """{column: unit} in `attrs` of a table: pandas copies those deeply for every column that is taken."""

    def __deepcopy__(self, memo: Any) -> "Units":
        return Units(self)


@told_at_call
def open_log(path: str | Path, *, tolerant: bool = False) -> "Log":
    """Open a log strictly: checksums and structure are checked before anything is returned.

    With `tolerant`, a log that was cut or damaged gives what is whole: the ticks of damaged chunks are missing, and
    `damage` lists what is lost.
    Raises LogError with the place for a file that is missing, cut, damaged, hostile, or not written by this package.
    """
    keep_memory()
    return Log(scan(path, tolerant))


class Log:
    """Give the content of one log; memory is what was asked for, and some 32 MB.

    `topics` {name: Topic} are its parts, such as "/truth/aircraft" and "/sensors/left_inner"; what they have in
    common is a channel of the file, "/sensors", which names them all. `metadata` {name: {str: str}}, `attachments`
    {name: bytes}, `media_types` {name: str}, `dt_ns` [ns], `n_ticks`, `spans` [(first tick, ticks)] of the chunks,
    `gaps`, the number of ticks that are missing before the last, `complete` (the run ended by itself and wrote its
    result), `result` {str: str} or None.
    """

    def __init__(self, found: Any):
        self._scan = found
        self.path, self.dt_ns, self.metadata = found.path, found.dt_ns, found.metadata
        attached = [r for r in found.records if isinstance(r, Attachment)]
        self.attachments = {r.name: r.data for r in attached}
        self.media_types = {r.name: r.media_type for r in attached}
        self.result = self.metadata.get("result")
        self.complete = found.closed and self.result is not None
        self.chunks, self.damage = found.chunks, found.damage
        self.spans = [found.ticks(c) for c in found.chunks]
        self._starts = [k0 for k0, _ in self.spans]
        self.n_ticks = sum(n for _, n in self.spans)
        self.gaps = sum(self.spans[-1]) - self.n_ticks if self.spans else 0
        largest = max((c.size for c in found.chunks), default=1)
        self._content = lru_cache(max(1, CACHE_BYTES // largest))(partial(content, found))
        self.topics = {name: replace(t, rows=sum(len(range(-k0 % t.every, n, t.every)) for k0, n in self.spans))
                       for name, t in found.topics.items()}  # fmt: skip

    def __repr__(self) -> str:
        state = "complete" if self.complete else "incomplete"
        head = f"Log {self.path}: {self.n_ticks * self.dt_ns / 1e9:g} s, {len(self.topics)} topics, {state}"
        rows = [f"  {t.name:44}{t.rows:>8} rows, {len(t.fields)} fields" for t in self.topics.values()]
        return "\n".join([head, *rows])

    def array(
        self, topic: str, *, fields: Sequence[str] | None = None, start_s: float | None = None,
        end_s: float | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return the values of a topic (rows, fields) as float64, bit for bit as they were logged; see `frame`."""
        return self._values(self._columns(topic, fields), *self._bounds(start_s, end_s))

    def frame(
        self, topic: str, *, fields: Sequence[str] | None = None, start_s: float | None = None,
        end_s: float | None = None,
    ) -> Any:  # fmt: skip
        """Return a topic as a DataFrame: a column per field, index `t_s` in float seconds (tick x dt, rounded once).

        A channel has the columns of all its parts, with dots: `left_inner.rod` of "/sensors". `fields` chooses columns,
        `start_s` <= t < `end_s` [s] rows. `attrs["units"]` is {column: unit}, "-" for a number without one. Raises
        KeyError for a topic or field that is not there.
        """
        import pandas as pd  # half a second, which a run that only writes need not wait for

        columns, (start, stop) = self._columns(topic, fields), self._bounds(start_s, end_s)
        index = pd.Index(self.ticks(topic, start, stop) * self.dt_ns / 1e9, name="t_s")
        made = pd.DataFrame(
            self._values(columns, start, stop), index=index, columns=[name for name, *_ in columns], copy=False
        )
        made.attrs["units"] = Units((name, self.topics[part].units[at]) for name, part, at in columns)
        return made

    def ticks(self, topic: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Return the tick of each row of a topic (rows,) as int64, start <= k < stop."""
        spans = self._within(self.topics[self._parts(topic)[0]].every, start, stop).values()
        return np.concatenate([np.arange(0), *(np.arange(s.start, s.stop, s.step) for s in spans)])

    def messages(self, topic: str, start: int = 0, stop: int = 1 << 62) -> list[Any]:
        """Return the well-known messages of /events, /tf or /fix as a list of (tick, protobuf message), start <= k <
        stop."""
        kind, own, out = foxglove.TOPICS[topic], self._scan.ids.get(topic), []
        for i in self._within(1, start, stop):
            tail = self._scan.layout.tail(self._content(i), *self.spans[i])
            out += [(k, data) for channel, k, _, data in tail if channel == own and start <= k < stop]
        try:
            return [(k, kind.FromString(data)) for k, data in out]
        except DecodeError as error:
            raise log_error(f"a message on {topic} is no {kind.DESCRIPTOR.full_name}", self.path) from error

    def row(self, k: int) -> tuple[np.ndarray, dict[str, bytes]]:
        """Return what stands in the file at tick `k`: the messages of the topics of every tick (bytes,), and {topic:
        message} of /events, /tf and /fix, the last up to it."""
        i, layout = bisect_right(self._starts, k) - 1, self._scan.layout
        chunk, names = self._content(i), {number: topic for topic, number in self._scan.ids.items()}
        told = {names[c]: data for c, tick, _, data in layout.tail(chunk, *self.spans[i]) if tick <= k}
        return layout.rows(chunk, *self.spans[i])[-1][k - self._starts[i]], told

    def _parts(self, topic):
        parts = [topic] if topic in self.topics else [p for p in self.topics if p.startswith(f"{topic}/")]
        if len({self.topics[p].every for p in parts}) != 1:
            raise _Unknown(f"{self.path} has no topic {topic!r}; log.topics has all {len(self.topics)}. "
                           f"{did_you_mean(topic, self.topics)}")  # fmt: skip
        return parts

    def _columns(self, topic, fields):
        """Return [(name, part, position in it)] of the columns of a part or a channel."""
        known = {f"{p[len(topic) + 1:].replace('/', '.')}.{f}".lstrip("."): (p, i)
                 for p in self._parts(topic) for i, f in enumerate(self.topics[p].fields)}  # fmt: skip
        wanted = [fields] if isinstance(fields, str) else known if fields is None else fields
        for field in wanted:
            if field not in known:
                said = f"topic {topic} has no field {field!r} among its {len(known)}"
                raise _Unknown(f"{said}; log.topics[{topic!r}].fields has all. {did_you_mean(field, known)}")
        return [(name, *known[name]) for name in wanted]

    def _bounds(self, start_s, end_s):
        start = 0 if start_s is None else max(0, self._first(start_s))
        return start, None if end_s is None else max(start, self._first(end_s))

    def _first(self, t_s):
        """Return the first tick at or after a time [s]; a time that was rounded to the index's is that of its tick."""
        near = round(t_s * 1e9 / self.dt_ns)
        return near if near * self.dt_ns / 1e9 >= t_s else near + 1

    def _values(self, columns, start, stop):
        """Return (rows, columns) of the ticks start <= k < stop."""
        if not columns:
            return np.empty((sum(map(len, self._within(1, start, stop).values())), 0))
        layout = self._scan.layout
        number, places = layout.places([(part, at) for _, part, at in columns])
        every = layout.blocks[number].every
        spans = self._within(every, start, stop)
        out, done = np.empty((sum(map(len, spans.values())), len(columns))), 0
        for i, ticks in spans.items():
            k0, n = self.spans[i]
            first = len(range(k0 + -k0 % every, ticks.start, every))
            rows = layout.rows(self._content(i), k0, n)[number][first : first + len(ticks)]
            out[done : done + len(ticks)] = doubles(rows)[:, places]
            done += len(ticks)
        return out

    def _within(self, every: int, start: int, stop: int | None) -> dict[int, range]:
        """Return {number of a chunk: its ticks of one rate, start <= k < stop}."""
        low = max(0, bisect_right(self._starts, start) - 1)
        spans = self.spans[low : None if stop is None else bisect_left(self._starts, stop)]
        begins = [max(k0, start) for k0, _ in spans]
        ends = [k0 + n if stop is None else min(k0 + n, stop) for k0, n in spans]
        ticks = (range(a + -a % every, max(a, b), every) for a, b in zip(begins, ends))
        return dict(enumerate(ticks, low))


def log_info(path: str | Path) -> dict[str, Any]:
    """Return what `cosim info` tells: {log, complete, problem, title, status, duration_s, rate_hz, ticks, gaps, ...}.

    `problem` says why the strict reader refuses a log, which is then described by what is whole of it. Raises LogError
    when there is nothing to describe.
    """
    try:
        log, problem = open_log(path), None
    except LogError as error:
        log, problem = open_log(path, tolerant=True), str(error)
    run, result = log.metadata.get("run", {}), log.result or {}
    return {
        "log": str(path), "complete": log.complete, "problem": problem, "recovered": "recovered" in log.metadata,
        "title": run.get("title", ""), "status": result.get("status", ""),
        "duration_s": (log.n_ticks + log.gaps) * log.dt_ns / 1e9, "rate_hz": 1e9 / log.dt_ns, "ticks": log.n_ticks,
        "gaps": log.gaps, "size_mb": round(log._scan.size / 1e6, 2),
        "versions": {**{k: v for k, v in run.items() if k == "software"}, **log.metadata.get("libraries", {})},
        "result": dict(result),
        "topics": [{"name": t.name, "rows": t.rows, "every": t.every, "fields": list(t.fields),
                    "units": list(t.units)} for t in log.topics.values()],
        "attachments": list(log.attachments),
        "scenario": log.attachments.get("scenario.toml", b"").decode("utf-8", "replace"),
    }  # fmt: skip


class _Unknown(KeyError):
    """Say what is not there in plain words, which a KeyError would quote."""

    def __str__(self):
        return self.args[0]
