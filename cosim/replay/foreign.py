"""Recordings of others: one table (text with a header line, Parquet) or one MCAP file, over one clock that is named.

Only the columns and fields that are asked for are read. What is not taken here is refused with the remedy: any tool
that reads it can write Parquet.
"""

import contextlib
import csv
import itertools
import warnings
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import LogError, did_you_mean
from cosim.files import regular
from cosim.log.foreign import BROKEN, ForeignMcap
from cosim.log.format import log_error
from cosim.replay import clock

TEXT = (".csv", ".tsv", ".txt", ".dat")
KINDS = (*TEXT, ".parquet", ".mcap")
CONVERT = "Convert to Parquet: one row per time, one column per signal"
MOST_VALUES = 50_000_000  # of all columns that are read: 400 MB in memory
MOST_BYTES = 20 * MOST_VALUES  # of a text or of messages, whose numbers take some twenty characters
LONGEST = 10_000_000  # letters of a header
STAMPS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))  # of a field that is a time
LOGGED, PUBLISHED = "log_time", "publish_time"


@dataclass
class Recording:
    """Channels of a recording by the names that were asked for, over the times of their table or topic."""

    clock: str = ""  # sentence: which field, unit and zero, and of each table or topic how many samples in which step
    times: dict[str, NDArray] = field(default_factory=dict)  # table or topic -> (rows,) [s], rising
    channels: dict[str, tuple[str, NDArray]] = field(default_factory=dict)  # name -> (table or topic, (rows,))
    notes: list[str] = field(default_factory=list)  # sentences: where it is cut


def read_recording(path: str | Path, names: Sequence[str], time: str | None = None) -> Recording:
    """Return the columns or fields `names` of the recording at `path` over the clock `time` (cosim/replay/clock.py).

    `time` is a column or a field, with "[us]" behind it where its name does not end in its unit, or for an MCAP file
    `log_time` (its default) or `publish_time`; of a table the default is the only column that is called t, time,
    timestamp or clock. Raises LogError for a file that is not read here, a name that it lacks, a column that holds no
    numbers, a clock that goes back or stands.
    """
    with _readable(path := Path(path)):
        return _mcap(path, names, time) if path.suffix.lower() == ".mcap" else _table(path, names, time)


def columns_of(path: str | Path) -> tuple[list[str], list[str]]:
    """Return (channels of numbers, columns or topics without numbers) of a recording. Raises LogError."""
    with _readable(path := Path(path)):
        if path.suffix.lower() == ".mcap":
            return _fields_of(path)
        kinds = [(str(name), y.dtype.kind in "iufb") for name, y in _head(path, rows=200).items()]
        return [name for name, numbers in kinds if numbers], [name for name, numbers in kinds if not numbers]


@contextlib.contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Raise LogError for a file that is not of a kind and size that is read here, or in which a reader fails."""
    kind = path.suffix.lower()
    if path.is_dir() or kind not in KINDS:
        said = "is a folder" if path.is_dir() else f"unknown kind of file {kind!r}"
        raise LogError(said, place=str(path), allowed=f"one file: {', '.join(KINDS)}", remedy=CONVERT)
    regular(path, LogError)
    if path.is_file() and kind != ".parquet" and (size := path.stat().st_size) > MOST_BYTES:
        raise LogError(f"has {size / 1e9:.3g} GB", place=str(path), allowed=f"{MOST_BYTES / 1e9:g} GB",
                       remedy=f"Cut it. {CONVERT}")  # fmt: skip
    try:
        yield
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror or error}", path) from error
    except (*BROKEN, csv.Error) as error:  # of pandas and Arrow, too, whose errors are ValueErrors
        raise log_error(
            f"cannot be read: {error or type(error).__name__}", path, remedy=CONVERT * (kind != ".parquet")
        ) from error


# -- tables
def _table(path: Path, names: Sequence[str], time: str | None) -> Recording:
    header = list(_head(path, rows=0).columns)
    name, unit = clock.of_table(header, time, path)
    for wanted in (name, *names):
        if header.count(wanted) != 1:
            said = "has no column" if wanted not in header else "has more than one column"
            raise LogError(f"{said} {wanted!r}", place=str(path), allowed=", ".join(header[:20]),
                           remedy=did_you_mean(wanted, {*header} - {wanted}))  # fmt: skip
    used, out = list(dict.fromkeys((name, *names))), Recording()
    if path.suffix.lower() == ".parquet":
        frame = _parquet(path, used)
    else:
        frame = _text(path, used)
        if len(frame) > 1 and not _ended(path):
            frame = frame.iloc[:-1]
            out.notes.append(f"the file is cut: its last line, row {len(frame) + 1}, has no end and is not read")
    stamps, label = clock.stamps(frame[name], name, unit, path)
    clock.check(stamps, path)
    zero = stamps[0] if stamps.dtype.kind == "M" else None
    out.times = {"": clock.since(stamps, zero)}
    out.clock = clock.sentence(label, zero, out.times)
    out.channels = {n: ("", _numbers(frame[n], n, path)) for n in names}
    return out


def _head(path: Path, rows: int) -> Any:
    """Return a pandas frame of the columns of a table, of its first `rows`, which say the kinds of a text's."""
    import pyarrow.parquet as pq

    if path.suffix.lower() == ".parquet":
        return pq.read_schema(path).empty_table().to_pandas(ignore_metadata=True)
    return _text(path, None, rows)


def _parquet(path: Path, used: Sequence[str]) -> Any:
    import pyarrow.parquet as pq

    if pq.read_metadata(path).num_rows * len(used) > MOST_VALUES:
        raise ValueError(f"more than {MOST_VALUES} values")
    return pq.read_table(path, columns=list(used)).to_pandas(ignore_metadata=True)


def _text(path: Path, used: Sequence[str] | None, rows: int | None = None) -> Any:
    """Return the columns `used` (default: all, whose names may stand twice) of a text, its first `rows`."""
    import pandas as pd

    exact: dict[str, Any] = {"float_precision": "round_trip"} if pd.__version__ < "3" else {}  # what 3 does anyway
    with path.open(encoding="utf-8-sig") as file:
        lines = [line for _ in range(10) if (line := file.readline(LONGEST)).strip()]
    if not lines:
        raise ValueError("it is empty")
    head, row = lines[0], lines[min(1, len(lines) - 1)]
    sep = max(",;\t|", key=lambda mark: min(head.count(mark), row.count(mark)))  # not the comma of a name or a number
    spaces = sep not in row
    header = head.split() if spaces else next(csv.reader(lines, delimiter=sep, skipinitialspace=True))
    header = [n.strip() for n in header]
    _check_rows(path, header, " " if spaces else sep, rows)
    at = sorted(range(len(header)) if used is None else [header.index(n) for n in used])
    how: dict[str, Any] = {"sep": r"\s+" if spaces else sep, "encoding": "utf-8-sig", "skipinitialspace": True, **exact}
    with warnings.catch_warnings(action="ignore", category=pd.errors.DtypeWarning):  # numbers with a text among them
        frame = pd.read_csv(path, usecols=at, index_col=False, nrows=rows, **how)
    frame.columns = pd.Index([header[k] for k in at])
    for name, cells in frame.select_dtypes(exclude="number").astype(str).items():
        for cell in cells[cells.str.fullmatch(r"[-+]?\d+,\d+([eE][-+]?\d+)?")]:
            said = f"column {name!r} holds {cell!r}: a comma is no decimal point here"
            raise LogError(said, place=str(path), remedy="Write numbers with a point")
    return frame


def _check_rows(path: Path, header: list[str], sep: str, rows: int | None) -> None:
    """Raise LogError for one of the first `rows` of a text that has other cells than its header, but for a separator
    at the end of either; a last line without its end may be cut."""
    least = len(header) - (not header[-1])
    with contextlib.suppress(csv.Error), path.open(encoding="utf-8-sig", newline="") as file:  # pandas says it better
        lines = csv.reader(file, delimiter=sep, skipinitialspace=True)
        odd = ((lines.line_num, len(row)) for row in itertools.islice(lines, None if rows is None else rows + 2)
               if any(row) and not least <= len(row) <= len(header) + (not row[-1]))  # fmt: skip
        for line, n in itertools.islice(odd, 1):
            if next(lines, None) is not None or _ended(path):
                raise LogError(f"has {n} cell{'s' * (n > 1)}", place=f"{path}, line {line}",
                               allowed=f"{least}, as in the header",
                               remedy="A lost sample is an empty cell")  # fmt: skip


def _ended(path: Path) -> bool:
    """Tell whether the last line of a text has its end."""
    with path.open("rb") as file:
        file.seek(-1, 2)
        return file.read() in (b"\n", b"\r")


def _numbers(column: Any, name: str, path: Path) -> NDArray:
    """Return a column as float64. Raises LogError with the first cell that is no number."""
    import pandas as pd

    if column.dtype.kind in "iufb":
        return column.to_numpy(np.float64)
    k = int(np.argmax((pd.to_numeric(column, errors="coerce").isna() & column.notna()).to_numpy()))
    what = f"column {name!r} holds something that is no number: {str(column.iloc[k])[:40]!r} in row {k + 1}"
    raise LogError(what, place=str(path), remedy="An empty cell or NaN is a lost sample")


# -- MCAP
@dataclass
class _Topic:
    """The messages of a topic: their times, the channels that sent them, and a column per name."""

    columns: dict[str, array]  # name in the map -> numbers
    stamps: list = field(default_factory=list)
    senders: array = field(default_factory=lambda: array("q"))


def _mcap(path: Path, names: Sequence[str], time: str | None) -> Recording:
    name, unit = clock.of_messages(time)
    topics: dict[str, _Topic] = {}
    unread: dict[str, str] = {}
    file, left = ForeignMcap(path), MOST_VALUES
    for sent in file:
        where = sent.channel.topic
        if where not in topics:
            topics[where] = _Topic({n: array("d") for n in names if n.startswith(f"{where}.")})
        topic = topics[where]
        if not topic.columns:
            continue
        if sent.decoder is None:
            unread[where] = sent.channel.message_encoding
            continue
        values = dict(_flat(sent.decoded(), f"{where}."))
        topic.senders.append(sent.channel.id)
        topic.stamps.append(_stamp(sent.record, values, name, f"{path}, {where}"))
        for n, column in topic.columns.items():
            column.append(_number(values.get(n), n))
        left -= 10 + len(topic.columns)  # a time takes ten times the memory of a number
        if left < 0:
            raise ValueError(f"more than {MOST_VALUES} values; map fewer channels or cut the file")
    out = _recording(path, {n: t for n, t in topics.items() if t.stamps}, name, unit)
    out.notes = ["the file is cut: read up to its last whole chunk or message"] * file.cut
    for n in names:
        if n not in out.channels:
            raise _lacks(path, n, unread, file.cut)
    return out


def _recording(path: Path, topics: dict[str, _Topic], name: str, unit: str) -> Recording:
    """Return the Recording of the messages that were read; raise LogError for a clock that goes back or stands."""
    import pandas as pd

    out, stamps, label = Recording(), {}, name
    for topic, got in topics.items():
        place = f"{path}, {topic}"
        made, label = clock.stamps(pd.Series(got.stamps), name, unit, place)
        _one_sender(np.array(got.senders), made, place)
        order = np.argsort(made, kind="stable")
        stamps[topic] = made[order]
        clock.check(stamps[topic], place)
        columns = ((n, np.array(column)[order]) for n, column in got.columns.items())
        out.channels |= {n: (topic, y) for n, y in columns if not np.isnan(y).all()}
    zero = min((s[0] for s in stamps.values() if s.dtype.kind == "M"), default=None)
    out.times = {topic: clock.since(s, zero) for topic, s in stamps.items()}
    out.clock = clock.sentence(label, zero, out.times)
    return out


def _lacks(path: Path, name: str, unread: dict[str, str], cut: bool) -> LogError:
    """Return the error for a channel that no message has."""
    topic = next((t for t in unread if name.startswith(f"{t}.")), "")
    if topic:
        remedy = "pip install 'cosim-fdi[ros2]' reads it" if unread[topic] == "cdr" else CONVERT
        said = f"the messages of {topic} are {unread[topic] or 'of no encoding'}"
        return LogError(said, place=str(path), allowed="protobuf, json, cdr of ROS 2", remedy=remedy)
    known, texts = _fields_of(path)
    close = next((k for k in known if k.endswith(f".{name}")), "")
    remedy = f"Did you mean {close!r}?" if close else did_you_mean(name, known)
    said = f"no message{' up to its cut' if cut else ''} holds a number {name!r}"
    allowed = [", ".join(known[:20]), f"topics without numbers: {', '.join(texts[:5])}" * bool(texts)]
    return LogError(said, place=str(path), allowed="; ".join(filter(None, allowed)), remedy=remedy)


def _one_sender(senders: NDArray, stamps: NDArray, place: str) -> None:
    """Raise LogError where channels of one topic overlap in time: two sources are two signals."""
    spans = sorted((stamps[senders == s].min(), stamps[senders == s].max()) for s in np.unique(senders))
    if any(begin <= end for (_, end), (begin, _) in itertools.pairwise(spans)):
        said = f"{len(spans)} channels share the topic and overlap in time"
        raise LogError(said, place=place, allowed="one source at a time",
                       remedy="Record each source on a topic of its own")  # fmt: skip


def _stamp(record: Any, values: dict[str, Any], name: str, place: str) -> Any:
    """Return the time of a message: nanoseconds as a date, a number of the field's unit as it is, or a text."""
    if name in (LOGGED, PUBLISHED):
        return np.datetime64(getattr(record, name), "ns")
    own = f"{place.rpartition(', ')[2]}.{name}"
    for whole, rest in ((f"{own}.{a}", f"{own}.{b}") for a, b in STAMPS):
        if whole in values and rest in values:
            return np.datetime64(int(values[whole]) * 1_000_000_000 + int(values[rest]), "ns")
    if values.get(own) is not None:
        return values[own]
    pairs = ", ".join(f"{{{a}, {b}}}" for a, b in STAMPS)
    allowed = f"log_time, publish_time, or a field: {pairs}, a number with its unit, ISO 8601"
    raise LogError(f"a message has no time {name!r}", place=place, allowed=allowed)


def _number(value: Any, name: str) -> float:
    """Return a field as a float: NaN where it is null; 64-bit integers and infinities come as texts in JSON."""
    if value is None:
        return np.nan
    with contextlib.suppress(ValueError, TypeError):
        return float(value)
    raise ValueError(f"channel {name!r} holds something that is no number: {str(value)[:40]!r}")


def _fields_of(path: Path) -> tuple[list[str], list[str]]:
    """Return (channels of numbers, topics without one) by the first message of each topic."""
    found: dict[str, list[str]] = {}
    for sent in ForeignMcap(path):
        topic = sent.channel.topic
        if topic not in found:
            values = _flat(sent.decoded(), f"{topic}.") if sent.decoder else ()
            found[topic] = [name for name, value in values if isinstance(value, int | float)]
    return [n for some in found.values() for n in some], [topic for topic, some in found.items() if not some]


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield (name, value) of what a message holds, "a.b[2]": of JSON, protobuf, ROS 2."""
    if isinstance(value, int | float | str | bytes | None):
        yield name, value
    elif isinstance(value, dict) or hasattr(value, "DESCRIPTOR") or hasattr(value, "__slots__"):
        start = name if name.endswith(".") else f"{name}."
        for key, part in value.items() if isinstance(value, dict) else _parts(value):
            yield from _flat(part, f"{start}{key}")
    else:
        for k, part in enumerate(value):
            yield from _flat(part, f"{name}[{k}]")


def _parts(message: Any) -> Iterator[tuple[str, Any]]:
    """Yield (field, value) of a message of protobuf or ROS 2; one that is not there, which may hold itself, is left."""
    names = [f.name for f in message.DESCRIPTOR.fields] if hasattr(message, "DESCRIPTOR") else message.__slots__
    for name in names:
        part = getattr(message, name)
        if not hasattr(part, "DESCRIPTOR") or message.HasField(name):
            yield name, part
