"""Read a log back, bit for bit, into numpy and pandas."""

import difflib
import threading
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from cosim.errors import told_at_call
from cosim.table import Table

from . import foxglove
from .compression import keep_memory
from .format import Limits, log_error
from .walker import drop_damaged, load, scan, tail

CACHE_BYTES = 64 << 20  # content of chunks that stays in memory: several topics of a short log are decompressed once
MOST_DRAWN = 4000  # samples of a curve


class Units(dict[str, str]):
    """{column: unit} in `attrs` of a table: pandas copies those deeply for every column that is taken."""

    def __deepcopy__(self, memo: Any) -> "Units":
        return Units(self)


@told_at_call
def open_log(path: str | Path, *, limits: Any = None, tolerant: bool = False) -> "Log":
    """Open a log strictly: checksums, structure and limits are checked before anything is returned.

    With `tolerant`, a log that was cut or damaged gives what is whole: the ticks of damaged chunks are missing, and
    `damage` lists what is lost.
    Raises LogError with the place for a file that is missing, cut, damaged, hostile, or not written by this package.
    """
    keep_memory()
    found = scan(path, limits or Limits(), tolerant)
    if tolerant:
        drop_damaged(found)
    return Log(found)


class Log:
    """Give the content of one log; memory is what was asked for, and some 64 MB.

    `topics` {name: TopicInfo} are its parts, such as "/truth/aircraft" and "/sensors/left_inner"; what they have in
    common is a channel of the file, "/sensors", which names them all. `metadata` {name: {str: str}}, `attachments`
    {name: bytes}, `media_types` {name: str}, `dt_ns` [ns], `n_ticks`, `spans` [(first tick, ticks)] of the chunks,
    `complete` (the run ended by itself and wrote its result), `result` {str: str} or None.
    """

    def __init__(self, found: Any):
        self._scan = found
        self.path, self.dt_ns, self.metadata = found.path, found.dt_ns, found.metadata
        self.attachments = {name: data for name, (_, data) in found.attachments.items()}
        self.media_types = {name: kind for name, (kind, _) in found.attachments.items()}
        self.result = self.metadata.get("result")
        self.complete = found.closed and self.result is not None
        self.chunks, self.damage = found.chunks, found.damage
        self.spans = [found.ticks(c) for c in found.chunks]
        self._starts = [k0 for k0, _ in self.spans]
        self.n_ticks = sum(n for _, n in self.spans)
        self._runs = _merged(self.spans)
        self._cache: dict[int, np.ndarray] = {}
        self._lock = threading.Lock()
        rows = {t.every: sum(len(range(-k0 % t.every, n, t.every)) for k0, n in self._runs)
                for t in found.topics.values()}  # fmt: skip
        self.topics = {name: replace(t, rows=rows[t.every]) for name, t in found.topics.items()}

    def __repr__(self) -> str:
        rows = [f"  {t.name:44}{t.rows:>8} rows, {len(t.fields)} fields" for t in self.topics.values()]
        return "\n".join([self._about(), *rows])

    def _repr_html_(self) -> str:
        made = Table(self._about(), "topic", "rows>", "fields", kind="")
        for t in self.topics.values():
            made.add(t.name, t.rows, ", ".join(t.fields[:8]) + ", …" * (len(t.fields) > 8))
        return made._repr_html_()

    def _about(self):
        state = "complete" if self.complete else "incomplete"
        return f"Log {self.path}: {self.n_ticks * self.dt_ns / 1e9:g} s, {len(self.topics)} topics, {state}"

    def plot(self, fields: str | list[str]) -> Any:
        """Return a plotly figure of fields named "/topic.field" over time [s], one below the other, in their units.

        A notebook shows it, elsewhere `write_html(path)` keeps it. Raises KeyError for a field that is not there.
        """
        import pandas as pd

        pairs = [name.rpartition(".")[::2] for name in ([fields] if isinstance(fields, str) else fields)]
        frames = [self.frame(topic, fields=[field]).add_prefix(f"{topic}.") for topic, field in pairs]
        frame = pd.concat(frames, axis=1)
        units = [self.frame(topic, fields=[field], end_s=0.0).attrs["units"][field] for topic, field in pairs]
        shown = frame.iloc[:: max(1, len(frame) // MOST_DRAWN)].interpolate(limit_direction="both")
        figure = shown.plot(backend="plotly", facet_row="variable", height=180 * len(units) + 60)
        for mark in figure.layout.annotations:
            mark.text = ""
        for axis, unit in zip(reversed(list(figure.select_yaxes())), units):
            axis.update(matches=None, title=unit.strip("-"))
        return figure.update_layout(legend_title_text="", xaxis_title="t, s")

    def array(
        self, topic: str, *, fields: Sequence[str] | None = None, start_s: float | None = None,
        end_s: float | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return the values of a topic (rows, fields) as float64, bit for bit as they were logged; see `frame`."""
        return self._array(self._columns(topic, fields), *self._bounds(start_s, end_s))

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
        index = pd.Index(self.ticks(columns[0][1], start, stop) * self.dt_ns / 1e9, name="t_s")
        names = [name for name, *_ in columns]
        made = pd.DataFrame(self._array(columns, start, stop), index=index, columns=names, copy=False)
        made.attrs["units"] = Units((name, self.topics[part].units[at]) for name, part, at in columns)
        return made

    def _columns(self, topic, fields):
        """Return [(name, part, position in it)] of the columns of a part or a channel."""
        parts = [topic] if topic in self.topics else [p for p in self.topics if p.startswith(f"{topic}/")]
        if len({self.topics[p].every for p in parts}) != 1:
            near = _near(topic, self.topics)
            raise _Unknown(f"{self.path} has no topic {topic!r}{near}; log.topics has all")
        known = {f"{p[len(topic) + 1:].replace('/', '.')}.{f}".lstrip("."): (p, i)
                 for p in parts for i, f in enumerate(self.topics[p].fields)}  # fmt: skip
        for field in [fields] if isinstance(fields, str) else fields or ():
            if field not in known:
                near = _near(field, known, "fields")
                raise _Unknown(f"topic {topic} has no field {field!r}{near}; log.topics[{topic!r}].fields has all")
        return [(n, *known[n]) for n in ([fields] if isinstance(fields, str) else known if fields is None else fields)]

    def _bounds(self, start_s, end_s):
        start = 0 if start_s is None else max(0, self._first(start_s))
        return start, None if end_s is None else max(start, self._first(end_s))

    def _first(self, t_s):
        """Return the first tick at or after a time [s]; a time that was rounded to the index's is that of its tick."""
        near = round(t_s * 1e9 / self.dt_ns)
        return near if near * self.dt_ns / 1e9 >= t_s else near + 1

    def _array(self, columns, start, stop):
        wanted: dict = {}
        for column, (_, part, at) in enumerate(columns):
            wanted.setdefault(part, ([], []))[0].append(column)
            wanted[part][1].append(at)
        rows = len(self.ticks(columns[0][1], start, stop)) if columns else 0
        try:
            out = np.empty((rows, len(columns)))
        except MemoryError as error:
            raise log_error("the topics do not fit into memory", self.path, remedy="Ask for fewer.") from error
        done = 0
        for span, content in self._contents(start, stop):
            low, high = 0, 0
            for part, (into, at) in wanted.items():
                whole = at == list(range(len(self.topics[part].fields)))
                values = self._scan.layout.values(content, *span, part, None if whole else at)
                low, high = self._rows(span, start, stop, self.topics[part].every)
                into = slice(into[0], into[-1] + 1) if into[-1] - into[0] + 1 == len(into) else into
                out[done : done + high - low, into] = values[low:high]
            done += high - low
        return out

    def arrays(self, topics: Iterable[str] | None = None, start: int = 0, stop: int | None = None) -> dict:
        """Return {topic: (rows, fields)} of several parts (default: all), ticks start <= k < stop."""
        names = self.topics if topics is None else topics
        return {name: self._array(self._columns(name, None), start, stop) for name in names}

    @staticmethod
    def _rows(span, start, stop, every):
        """Return (first, last + 1) of a chunk's rows of one rate within the bounds."""
        k0, n = span
        first, b = k0 + -k0 % every, k0 + n if stop is None else min(k0 + n, stop)
        low = len(range(first, max(k0, start), every))
        return low, max(low, len(range(first, b, every)))

    def ticks(self, topic: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Return the tick of each row of a part (rows,) as int64, start <= k < stop."""
        every = self.topics[self._columns(topic, None)[0][1]].every
        bounds = [(max(k0, start), k0 + n if stop is None else min(k0 + n, stop)) for k0, n in self._runs]
        parts = [np.arange(a + -a % every, b, every, dtype=np.int64) for a, b in bounds]
        return np.concatenate(parts) if parts else np.empty(0, np.int64)

    def messages(self, topic: str) -> list[Any]:
        """Return the well-known messages of /events, /tf or /fix as a list of (tick, protobuf message)."""
        if topic not in foxglove.TOPICS:
            raise KeyError(f"unknown topic {topic!r}; known: {', '.join(foxglove.TOPICS)}")
        kind = foxglove.message(foxglove.TOPICS[topic][0].removeprefix("foxglove."))
        wanted = self._scan.ids.get(topic)
        tails = (tail(self._scan, chunk, content) for chunk, (_, content) in zip(self.chunks, self._contents()))
        try:
            return [(k, kind.FromString(data)) for found in tails for c, k, _, data in found if c == wanted]
        except DecodeError as error:
            raise log_error(f"a message on {topic} is no {kind.DESCRIPTOR.full_name}", self.path) from error

    def _contents(self, start: int = 0, stop: int | None = None) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
        """Yield (ticks, content) of the chunks with ticks start <= k < stop, checked."""
        low = max(0, bisect_right(self._starts, start) - 1)
        try:
            with open(self.path, "rb") as file:
                for i in range(low, len(self.spans) if stop is None else bisect_left(self._starts, stop)):
                    content = self._cache.get(i)
                    if content is None:
                        content = load(self._scan, file, self.chunks[i])[1]
                        with self._lock:
                            while self._cache and sum(map(len, self._cache.values())) + len(content) > CACHE_BYTES:
                                self._cache.pop(next(iter(self._cache)))
                            self._cache[i] = content
                    yield self.spans[i], content
        except OSError as error:
            raise log_error(f"cannot read the log: {error.strerror}", self.path) from error


class _Unknown(KeyError):
    """Say what is not there in plain words, which a KeyError would quote."""

    def __str__(self):
        return self.args[0]


def _near(word, choices, what="topics"):
    """Return how many `choices` there are and which of them are like `word`."""
    found = difflib.get_close_matches(str(word), list(choices), n=5, cutoff=0.5)
    return f" among its {len(choices)} {what}" + (f"; near: {', '.join(found)}" if found else "")


def _merged(spans):
    """Return spans [(first tick, ticks)] with those joined that follow one another."""
    out: list = []
    for k0, n in spans:
        if out and sum(out[-1]) == k0:
            out[-1] = (out[-1][0], out[-1][1] + n)
        else:
            out.append((k0, n))
    return out
