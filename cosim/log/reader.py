"""Read a log back, bit for bit, into numpy and pandas."""

import difflib
import os
import threading
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from actuators.object_cache import PLAIN
from cosim.errors import told_at_call
from cosim.table import Table

from . import foxglove
from .chunk import GATHER
from .compression import keep_memory
from .format import Limits, log_error
from .load import drop_damaged_chunks, load_chunk, load_topics
from .validate import identity, scan

BLOCK = 32  # chunks that are read at a time where a part of a topic is asked for
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
        drop_damaged_chunks(found)
    return Log(found)


class Log:
    """Give the content of one log; memory is one chunk and what was asked for.

    `topics` {name: TopicInfo}, `metadata` {name: {str: str}}, `attachments` {name: bytes}, `media_types` {name: str},
    `dt_ns` [ns], `n_ticks`, `spans` [(first tick, ticks)] of the chunks, `complete` (the run ended by itself and wrote
    its result), `result` {str: str} or None.
    """

    def __init__(self, found: Any):
        self._scan = found
        self.path, self.dt_ns = found.path, found.dt_ns
        self.metadata = {r.name: r.metadata for _, _, r in found.metadata}
        self.attachments = {r.name: r.data for _, _, r in found.attachments}
        self.media_types = {r.name: r.media_type for _, _, r in found.attachments}
        self.result = self.metadata.get("result")
        self.complete = found.closed and self.result is not None
        self.chunks, self.damage = found.chunks, found.damage
        self.spans = [found.ticks(c) for c in found.chunks]
        self._starts, self._largest = [k0 for k0, _ in self.spans], max((c.size for c in found.chunks), default=0)
        self.n_ticks = sum(n for _, n in self.spans)
        self._runs = _merged(self.spans)
        self._index: dict = {}  # of frames, by rate
        self._one = threading.Lock()  # one thread at a time reads without compiled code
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
        frame = self.fields(fields)
        units = frame.attrs["units"]
        shown = frame.iloc[:: max(1, len(frame) // MOST_DRAWN)].interpolate(limit_direction="both")
        figure = shown.plot(backend="plotly", facet_row="variable", height=180 * len(units) + 60)
        for mark in figure.layout.annotations:
            mark.text = ""
        for axis, unit in zip(reversed(list(figure.select_yaxes())), units.values()):
            axis.update(matches=None, title=unit.strip("-"))
        return figure.update_layout(legend_title_text="", xaxis_title="t, s")

    def array(self, topic: str, start: float = 0, stop: Any = None) -> Any:
        """Return the values of a topic (rows, fields) as float64, bit for bit as they were logged.

        `start` and `stop` bound the ticks, start <= k < stop; chunks outside them are not read.
        """
        return self.arrays([topic], start, stop)[topic]

    def arrays(self, topics: Sequence[Any] | None = None, start: float = 0, stop: Any = None) -> dict:
        """Return {topic: (rows, fields)} of several topics (default: all), each chunk read once; see `array`."""
        names = list(self.topics) if topics is None else list(topics)
        numbers = {self._number(name): name for name in names}
        low = max(0, bisect_right(self._starts, start) - 1)
        high = len(self.spans) if stop is None else bisect_left(self._starts, stop)
        bounds = {i: self._bounds(self.spans[i], start, stop) for i in range(low, high)}
        rates: dict = {}
        for name in numbers.values():
            rates.setdefault(self.topics[name].every, len(self.ticks(name, start, stop)))
        try:
            out = {n: np.empty((rates[self.topics[n].every], len(self.topics[n].fields))) for n in names}
        except MemoryError as error:
            raise log_error("the topics do not fit into memory", self.path, remedy="Ask for fewer.") from error
        read = [i for i, (a, b) in bounds.items() if a < b]
        few = list(numbers) if 3 * len(numbers) < len(self.topics) else None  # many at once are quicker compared as one
        parts = self._parts(read, bounds, rates)
        todo = [(number, self.topics[name].every, out[name]) for number, name in numbers.items()]
        if not PLAIN and GATHER.ready():  # otherwise whoever reads would wait for a compiler
            addresses = [(number, every, array.ctypes.data, array.strides[0]) for number, every, array in todo]

            def take(i, plan, content):
                where = {number: (address + size * parts[i][every][0], *parts[i][every][1:])
                         for number, every, address, size in addresses}  # fmt: skip
                return plan.gather(content, self.spans[i][0], where, few is not None)

            for _ in self._contents(read, few, take):
                pass
            return out
        with self._one:  # a plan's views are its own
            for i, (plan, content, _) in zip(read, self._contents(read, few)):
                for number, every, array in todo:
                    done, low, high = parts[i][every]
                    for fields, view in plan.values(content, number):
                        array[done : done + high - low, fields] = view[low:high]
        return out

    def _parts(self, read, bounds, rates):
        """Return {chunk: {every: (rows of the chunks before it, first and last of its own)}} of what is read."""
        out, done = {}, dict.fromkeys(rates, 0)
        for i in read:
            parts = {every: _part(self.spans[i], bounds[i], every) for every in rates}
            out[i] = {every: (done[every], part.start, part.stop) for every, part in parts.items()}
            done = {every: done[every] + part.stop - part.start for every, part in parts.items()}
        return out

    def _bounds(self, span, start, stop):
        k0, n = span
        return max(k0, start), k0 + n if stop is None else min(k0 + n, stop)

    def _number(self, topic):
        if topic not in self.topics:
            raise _Unknown(f"{self.path} has no topic {topic!r}{_near(topic, self.topics)}; log.topics has all")
        return list(self.topics).index(topic)

    def _place(self, topic, field):
        self._number(topic)
        known = self.topics[topic].fields
        if field not in known:
            near = _near(field, known, "fields")
            raise _Unknown(f"topic {topic} has no field {field!r}{near}; log.topics[{topic!r}].fields has all")
        return known.index(field)

    def ticks(self, topic: str, start: float = 0, stop: Any = None) -> np.ndarray:
        """Return the tick of each row of a topic (rows,) as int64; see `array` for the bounds."""
        self._number(topic)
        every = self.topics[topic].every
        bounds = [self._bounds(run, start, stop) for run in self._runs]
        parts = [np.arange(a + -a % every, b, every, dtype=np.int64) for a, b in bounds]
        return np.concatenate(parts) if parts else np.empty(0, np.int64)

    def _frame(self, topic, values, fields=None, start=0, stop=None):
        import pandas as pd  # half a second, which a run that only writes need not wait for

        info = self.topics[topic]
        names = list(info.fields if fields is None else fields)
        key = info.every, start, stop
        if key not in self._index:
            self._index = {k: v for k, v in self._index.items() if k[1:] == (0, None)}  # of whole topics
            self._index[key] = pd.Index(self.ticks(topic, start, stop) * self.dt_ns / 1e9, name="t_s")
        made = pd.DataFrame(values, index=self._index[key], columns=names, copy=False)
        units = dict(zip(info.fields, info.units))
        made.attrs["units"] = Units((name, units[name]) for name in names)
        return made

    def frame(
        self, topic: str, *, fields: Sequence[str] | None = None, start_s: float | None = None,
        end_s: float | None = None,
    ) -> Any:  # fmt: skip
        """Return a topic as a DataFrame: a column per field, index `t_s` in float seconds (tick x dt, rounded once).

        `fields` chooses columns, `start_s` <= t < `end_s` [s] rows; memory is that of the result and of a few chunks.
        `attrs["units"]` is {column: unit}, "-" for a number without one. Raises KeyError for a topic or field that is
        not there.
        """
        self._number(topic)
        chosen = [fields] if isinstance(fields, str) else fields
        start = 0 if start_s is None else max(0, self._first(start_s))
        stop = None if end_s is None else max(start, self._first(end_s))
        if chosen is None:
            values = self.array(topic, start, stop)
        else:
            values = self.columns(topic, chosen, start=start, stop=stop).T
        return self._frame(topic, values, chosen, start, stop)

    def frames(self, topics: Any = None) -> Any:
        """Return {topic: DataFrame} of several topics (default: all), each chunk read once; of one topic, given as a
        string, an iterator over DataFrames of its rows, a few chunks at a time."""
        if isinstance(topics, str):
            self._number(topics)
            return (self._frame(topics, self.array(topics, a, b), None, a, b) for a, b in self._blocks())
        return {name: self._frame(name, values) for name, values in self.arrays(topics).items()}

    def _blocks(self, start=0, stop=None):
        """Yield (start, stop) of the ticks of BLOCK chunks each, within the bounds; one at least, perhaps empty."""
        spans = self.spans or [(0, 0)]
        for i in range(0, len(spans), BLOCK):
            first, (k0, n) = spans[i][0], spans[min(i + BLOCK, len(spans)) - 1]
            a, b = max(start, first), k0 + n if stop is None else min(stop, k0 + n)
            if a < b or not i:
                yield a, max(a, b)

    def columns(
        self, topic: str, fields: Sequence[str], kind: Any = np.float64, *, start: int = 0, stop: int | None = None
    ) -> np.ndarray:
        """Return fields of a topic as (fields, rows) of `kind`, ticks start <= k < stop; memory is that of the result
        and of a few chunks. Raises KeyError for a topic or field that is not there."""
        at = [self._place(topic, name) for name in fields]
        out, done = np.empty((len(at), len(self.ticks(topic, start, stop))), kind), 0
        for a, b in self._blocks(start, stop):
            values = self.array(topic, a, b)
            out[:, done : done + len(values)] = values[:, at].T
            done += len(values)
        return out

    def _first(self, t_s):
        """Return the first tick at or after a time [s]; a time that was rounded to the index's is that of its tick."""
        near = round(t_s * 1e9 / self.dt_ns)
        return near if near * self.dt_ns / 1e9 >= t_s else near + 1

    def fields(self, names: Sequence[Any]) -> Any:
        """Return single fields, named "/topic.field", as one DataFrame; slower topics are NaN at the ticks between.

        `attrs["units"]` is {column: unit}. Raises KeyError for a field that is not there.
        """
        import pandas as pd

        names = [names] if isinstance(names, str) else list(names)
        pairs = [name.rpartition(".")[::2] for name in names]
        for name, (topic, field) in zip(names, pairs):
            if name in self.topics or not topic:
                example = f"{name}.{self.topics[name].fields[0]}" if name in self.topics else "/truth/aircraft.alpha"
                whole = f"; log.frame({name!r}) gives the whole topic" if name in self.topics else ""
                raise _Unknown(f"{name!r} names no field, which is '/topic.field', such as {example!r}{whole}")
            self._place(topic, field)
        frames = self.frames(dict.fromkeys(topic for topic, _ in pairs))
        made = pd.concat([frames[topic][field].rename(name) for name, (topic, field) in zip(names, pairs)], axis=1)
        made.attrs["units"] = Units((n, frames[topic].attrs["units"][field]) for n, (topic, field) in zip(names, pairs))
        return made

    def messages(self, topic: str) -> list[Any]:
        """Return the well-known messages of /log, /events, /tf or /fix as a list of (tick, protobuf message)."""
        if topic not in foxglove.TOPICS:
            raise KeyError(f"unknown topic {topic!r}; known: {', '.join(foxglove.TOPICS)}")
        kind = foxglove.message(foxglove.TOPICS[topic][0].removeprefix("foxglove."))
        wanted = self._scan.ids.get(topic)
        try:
            return [(k, kind.FromString(data)) for *_, tail in self._contents() for c, k, data in tail if c == wanted]
        except DecodeError as error:
            raise log_error(f"a message on {topic} is no {kind.DESCRIPTOR.full_name}", self.path) from error

    def _contents(self, numbers=None, topics=None, take=None):
        """Yield (plan, content as uint8, tail) of each chunk, or of those numbered, checked; see `load_chunk`.

        Of `topics` (numbers) alone only their own bytes are read and no tail, where the file is the one whose checksum
        was compared when it was opened.
        """
        try:
            with open(self.path, "rb", buffering=0 if topics else -1) as file:
                some = topics if topics and identity(os.fstat(file.fileno())) == self._scan.identity else None
                place = np.empty(self._largest if some else 0, "u1")  # a thread's own
                for i in range(len(self.chunks)) if numbers is None else numbers:
                    call = take and partial(take, i)
                    yield (some and load_topics(self._scan, file, self.chunks[i], some, call, place)) or load_chunk(
                        self._scan, file, self.chunks[i], topics, call
                    )
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


def _part(span, bounds, every):
    """Return the slice of a chunk's rows of one rate that lie within the bounds."""
    first, (a, b) = span[0] + -span[0] % every, bounds
    low = len(range(first, a, every))
    return slice(low, max(low, len(range(first, b, every))))
