"""Read recordings of others as tables over time: text, Parquet, MATLAB, MCAP, a folder of files."""

import codecs
import contextlib
import os
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import CosimError, LogError
from cosim.files import regular
from cosim.log.foreign import read_mcap
from cosim.log.format import OURS, log_error
from cosim.log.reader import open_log
from cosim.log.walker import BAD
from cosim.replay import clock
from cosim.replay.units import is_unit, known
from cosim.texts import from_json

TEXT = (".csv", ".tsv", ".txt", ".asc", ".dat")
KINDS = (*TEXT, ".parquet", ".mat")
LOOKED_AT = 60  # lines in which the numbers of a text begin
MOST_LETTERS = 1_000_000  # of such a line: some tens of thousands of columns
MOST_VALUES = 50_000_000  # of a file: 400 MB in memory
MOST_BYTES = 20 * MOST_VALUES  # of a text, whose numbers take some twenty characters, or of messages
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|[-+]?nan|[-+]?inf", re.IGNORECASE)
TIME_NAMES = ("t_s", "t", "time", "time_s", "timestamp", "t_ns", "time_ns", "timestamp_ns")  # looked for in this order
TIME_WORDS = {*"time clock timestamp stamp seconds zeit uhrzeit temps tiempo datum date utc gmt".split()}
_SCALES = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}  # ends of a name: Zeit [ms]
_UNIT = re.compile(r"(?<=\S)\s*\[(ns|us|ms|s|min|h)\]$")  # said of a column without one: timestamp [us]
_DAY_S = 86400.0
LEAST_MS = 4  # whole numbers farther apart are no seconds: 200 Hz in ms, 1 Hz in ms is up to 1e3, in us up to 1e6


def read_channels(
    path: str | Path, *, time: str | None = None, on_reset: Any = None, part: int = 0, wanted: Any = None,
    columns: tuple[str, ...] = ()
) -> dict:  # fmt: skip
    """Return {channel: DataFrame} of a recording; columns are float64, the index is `t_s` [s], ascending.

    A text, MATLAB or Parquet file is one channel, named by the file's stem; `time` names its time column (default: the
    first of TIME_NAMES in any case, else one with a word for time in its name, else Parquet's own index). Its name ends
    in _ns, (us) or [ms], say, where it is not in seconds, or `time` says so: "timestamp [us]" of a column `timestamp`.
    Dates count from the first. `columns` name those of a file without names. A folder has a channel per table, and one
    for its files of a single column.
    An MCAP file has a channel per topic, times from its first message: when it was logged, or with `time`
    "header.stamp", say, that stamp of ROS where a topic has it. Columns without numbers are left out and named
    in `attrs["texts"]`. A clock that goes back is an error, unless `on_reset` says what to do ("offset", or "split" for
    stretch number `part`); `attrs["oddities"]` tells of gaps, doubled times and changes of rate. Of an MCAP file only
    the topics that `wanted(topic)` accepts are decoded. Raises LogError when the file cannot be read or has no usable
    time, IndexError when there is no stretch of that number.
    """
    path = Path(os.fspath(path))
    if path.suffix.lower() == ".mcap":
        return _mcap(path, wanted, time)
    frames, told = _frames(path, columns, time=time)
    out = {name: _timed(frame, path, name, time, on_reset, part) for name, frame in frames.items()}
    for frame in list(out.values())[:1]:
        frame.attrs["oddities"] += told
    return out


def _frames(path, columns=(), rows=None, time=None):
    """Return ({name: DataFrame}, sentences) of a file or a folder."""
    if path.is_dir():
        return _together(path, columns)
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise LogError(f"unknown kind of file {kind!r}", place=str(path), allowed=", ".join((*KINDS, ".mcap")))
    frame = read_table(path, columns, rows, time)
    return {path.stem: frame}, frame.attrs.get("left", [])


def _together(path, columns):
    """Return ({name: DataFrame} of the tables in a folder, sentences): files of one column each and of the same length
    are one table, named by the folder, with a column per file."""
    import pandas as pd

    files = sorted(f for f in path.iterdir() if f.suffix.lower() in KINDS and f.is_file() and f.name[0] != ".")
    if not files:
        raise LogError("holds no table", place=str(path), allowed=", ".join(KINDS))
    read = {f.stem: read_table(f, columns) for f in files}
    single = {stem: frame.iloc[:, 0] for stem, frame in read.items() if frame.shape[1] == 1}
    if len(single) < 2:
        return read, []
    lengths = [len(column) for column in single.values()]
    n = max(set(lengths), key=lengths.count)
    joined = pd.DataFrame({stem: column.to_numpy() for stem, column in single.items() if len(column) == n})
    left = [f"{stem} ({len(c)} rows)" for stem, c in single.items() if len(c) != n]
    told = [f"left out, other than {n} rows: {', '.join(left)}"] if left else []
    return {path.name: joined, **{stem: frame for stem, frame in read.items() if stem not in single}}, told


def _mcap(path, wanted, time):
    import pandas as pd

    regular(path, LogError)
    try:
        if OURS(path):
            log = open_log(path)
            return {topic: log.frame(topic) for topic in log.topics}
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror}", path) from error
    _bounded(path, MOST_BYTES)  # each of its messages is looked at, wanted or not
    read = read_mcap(path, wanted=wanted)
    if time and not any(f"{time}.sec" in rows for _, rows in read.values()):
        allowed = "a stamp of whole seconds and nanoseconds: header.stamp of header.stamp.sec and .nanosec"
        raise LogError(f"no topic has the time {time!r}", place=str(path), allowed=allowed)
    at = {topic: _stamps(time, rows, np.array(times, np.int64)) for topic, (times, rows) in read.items()}
    first = min(int(times.min()) for times in at.values())
    out = {}
    for topic, (_, rows) in read.items():
        order = np.argsort(at[topic], kind="stable")
        index = pd.Index((at[topic][order] - first) / 1e9, name="t_s")
        out[topic] = pd.DataFrame(rows).iloc[order].set_axis(index)
        out[topic].attrs["oddities"] = clock.oddities(index.to_numpy(), topic)
    return out


def _stamps(name, rows, logged):
    """Return the times [ns] of a topic's messages: their own stamps `name` where they have some, else `logged`."""
    whole, rest = (rows.get(f"{name}.{part}") for part in ("sec", "nanosec"))
    if whole is None or rest is None or not np.isfinite(whole + rest).all():
        return logged
    return whole.astype(np.int64) * 1_000_000_000 + rest.astype(np.int64)


def _bounded(path, most):
    """Raise LogError for what is no file, or one of more than `most` bytes."""
    regular(path, LogError)
    if path.is_file() and (size := path.stat().st_size) > most:
        remedy = "Cut it, or keep the columns that are needed as Parquet"
        raise LogError(f"has {size / 1e9:.3g} GB", place=str(path), allowed=f"{most / 1e9:g} GB", remedy=remedy)


def columns_of(path: str | Path) -> list[str]:
    """Return the columns of a file or folder of tables. Raises LogError."""
    frames, _ = _frames(Path(path), rows=5)
    return [c for f in frames.values() for c in (*map(str, f.columns), *f.attrs.get("texts", ()))]


def time_in(path: Path, columns: tuple[str, ...] = ()) -> str | None:
    """Return the time column of a table by its name, with a unit where its whole numbers are too far apart for seconds:
    "timestamp [us]"; None where `read_channels` finds it alone or there is none. Raises LogError."""
    if path.suffix.lower() not in KINDS or path.is_dir():
        return None
    frame = read_table(path, columns, rows=200)
    names = [*map(str, frame.columns), *frame.attrs.get("texts", ())]
    name = time_of(names)
    t = frame[name] if name in frame.columns else np.empty(0)
    if t.dtype.kind in "iuf" and np.isfinite(t).all() and not _scale(_apart(name)) and (t % 1 == 0).all():
        step = clock.interval(np.asarray(t, np.float64))
        if unit := next((u for u, least in (("ns", 1e6), ("us", 1e3), ("ms", LEAST_MS)) if step > least), ""):
            return f"{name} [{unit}]"
    return None if set(names) & set(TIME_NAMES) else name


def time_of(names: Any) -> str | None:
    """Return which of a table's columns is its time by its name, or None."""
    small = {re.split(r"\s*[\[(]", str(n).lower())[0]: n for n in reversed(list(names))}
    exact = next((small[n] for n in TIME_NAMES if n in small), None)
    return exact or next((n for n in names if set(re.split(r"[^a-z]+", _apart(n).lower())) & TIME_WORDS), None)


def _apart(name):
    """Return the name of a column with its unit apart: Time_US of TimeUS."""
    return re.sub(r"(?<=[a-z])(US|MS|NS|S)$", r"_\1", str(name))


def _timed(frame, path, stem, time, on_reset, part):
    import pandas as pd

    name = time or time_of(frame.columns) or frame.attrs.get("index")
    said = name
    if name not in frame.columns and time and (unit := _UNIT.search(time)):
        name, said = time[: unit.start()], time
    if (text := time or time_of(frame.attrs.get("texts", ()))) in frame.attrs.get("texts", ()):
        raise LogError(f"its time column {text!r} is text", place=str(path), remedy="Save its columns as numbers")
    if name is None or name not in frame.columns:
        allowed = f"one of its columns: {', '.join(map(str, frame.columns[:20]))}"
        remedy = "--time COLUMN names it; without names: columns = [...] in the map, or cosim map --columns"
        raise LogError(f"no time column {name or ''}".rstrip(), place=str(path), allowed=allowed, remedy=remedy)
    t = _seconds(frame[name], _apart(said), path)
    numbers = frame.drop(columns=name).select_dtypes(["number", "bool"], exclude="timedelta").astype(np.float64)
    numbers.columns = numbers.columns.map(str)
    texts = {str(c): _word(frame[c]) for c in frame.columns if c != name and str(c) not in numbers.columns}
    numbers.attrs = {"texts": texts | dict.fromkeys(frame.attrs.get("texts", ()), "")}
    clock.finite(t, f"column {str(name)!r}", path)
    rising, rows, told = clock.rising(t, path, on_reset, part)
    frame = numbers.iloc[rows].set_axis(pd.Index(rising, name="t_s"))
    frame.attrs = numbers.attrs | {"oddities": told + clock.oddities(rising, stem)}
    return frame


def _word(column):
    """Return the first cell of a column that is no number, with its row, counted from 1 below the header; "" without
    one."""
    import pandas as pd

    bad = (pd.to_numeric(column, errors="coerce").isna() & column.notna()).to_numpy()
    k = int(np.argmax(bad)) if bad.any() else -1
    return f": {str(column.iloc[k])[:40]!r} in row {k + 1}" if k >= 0 else ""


def _seconds(column, name, path):
    """Return a time column in seconds as float64."""
    import pandas as pd

    if not len(column):
        raise log_error("holds no row", path)
    if isinstance(column.dtype, pd.DatetimeTZDtype) or column.dtype.kind == "M":
        return (column - column.iloc[0]).dt.total_seconds().to_numpy()
    if column.dtype.kind == "m":
        return column.dt.total_seconds().to_numpy()
    t = pd.to_numeric(column, errors="coerce").to_numpy(np.float64)
    if column.dtype.kind not in "iuf" and not np.isfinite(t).any():
        dates = pd.to_datetime(column, errors="coerce", format="mixed", dayfirst=_day_first(column), utc=True)
        t = (dates - dates.iloc[0]).dt.total_seconds().to_numpy()
        if re.fullmatch(r"\s*\d{1,2}:[\d:.,]+\s*Z?", str(column.iloc[0])):  # times of day alone: past midnight
            t = t + _DAY_S * np.cumsum(np.diff(t, prepend=0.0) < -0.5 * _DAY_S)
        return t
    return t * (_scale(name) or 1.0)


def _scale(name):
    """Return what one of a time column is in seconds, by the end of its name; None without a unit there."""
    unit = re.search(r"[\W_]([a-z]+)[)\]]?$", name.lower())
    return _SCALES.get(unit[1]) if unit else None


def _day_first(column):
    """Tell whether dates are written 24.11.2026, or 24/11/2026 with days beyond 12 ahead."""
    heads = [re.match(r"\s*(\d{1,2})([./-])\d{1,2}[./-]\d{4}", str(value)) for value in column.iloc[:1000]]
    return any(h and (h[2] == "." or int(h[1]) > 12) for h in heads)


def read_table(path: Path, columns: tuple[str, ...] = (), rows: int | None = None, time: str | None = None) -> Any:
    """Return the table in a text, Parquet or MATLAB file as a DataFrame; `columns` name those of a file without names,
    `time` chooses among the structures of a MATLAB file the one of its time column.

    Columns that are no numbers stay as they are. Raises LogError where the file cannot be read, is too large or does
    not have as many columns as are named.
    """
    kind = path.suffix.lower()
    _bounded(path, {".mat": 8.0 * MOST_VALUES, ".parquet": np.inf}.get(kind, MOST_BYTES))
    try:
        if kind == ".mat":
            return _mat(path, columns, time)
        return _parquet(path) if kind == ".parquet" else _text(path, columns, rows)
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror or error}", path) from error
    except NotImplementedError:
        how = {"allowed": "versions 4 to 7", "remedy": "save -v7 in MATLAB"}
        raise LogError("is a MATLAB file of version 7.3", place=str(path), **how) from None
    except BAD as error:  # parser errors are ValueErrors and the like
        raise log_error(f"cannot be read as {kind[1:]}: {error}", path) from error


def _parquet(path):
    """Return the columns of numbers and times of a Parquet file; `attrs` name the others, and the column of its index.

    Nothing else is decoded: a text of a few bytes may stand for gigabytes.
    """
    import pyarrow.parquet as pq
    from pyarrow import types

    with pq.ParquetFile(path) as file:
        schema, about = file.schema_arrow, file.metadata
        if len(set(schema.names)) != len(schema.names):
            raise ValueError("a column is there twice")
        kinds = (types.is_integer, types.is_floating, types.is_boolean, types.is_timestamp, types.is_duration)
        taken = [f.name for f in schema if any(is_kind(f.type) for is_kind in kinds)]
        if about.num_rows * len(taken) > MOST_VALUES:
            raise ValueError(f"more than {MOST_VALUES} values; keep fewer columns or cut the file")
        frame = file.read(taken).to_pandas(ignore_metadata=True)
    frame.attrs = {"texts": [n for n in schema.names if n not in taken]}
    own = (schema.metadata or {}).get(b"pandas", b"{}")
    with contextlib.suppress(CosimError, AttributeError, LookupError, TypeError):
        index = from_json(own, place=str(path))["index_columns"][0]
        frame.attrs["index"] = index if isinstance(index, str) else None  # a range of rows has no name
    return frame


# -- text
def _text(path, columns, rows):
    import pandas as pd

    how: dict[str, Any] = {"encoding": _encoding(path), "encoding_errors": "replace", "nrows": rows}
    begin, names, separator, decimal = _layout(path, how["encoding"])
    how |= {"sep": separator, "decimal": decimal}
    if begin is None:  # an ordinary header, and anything below it
        frame = pd.read_csv(path, **_exactly(), **how)
        with contextlib.suppress(ValueError):  # a header alone
            names = pd.read_csv(path, header=None, dtype=str, **{**how, "nrows": 1}).iloc[0]
    else:
        frame = pd.read_csv(path, header=None, skiprows=begin, **_exactly(), **how)
        names = _named(path, frame.shape[1], columns or names)
        frame.columns = [n if n not in names[:i] else f"{n}.{names[:i].count(n)}" for i, n in enumerate(names)]
    many = Counter(map(str, names))
    frame.attrs["left"] = [f"{k} columns are called {n!r}: the others {n}.1 to {n}.{k - 1}"
                           for n, k in many.items() if k > 1]  # fmt: skip
    return frame


def _encoding(path):
    """Return how a text is written, by its first megabyte: UTF-16, UTF-8, or what is neither as Windows writes it."""
    with path.open("rb") as file:
        head = file.read(MOST_LETTERS)
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _layout(path, encoding):
    """Return (first line of numbers, names, separator, decimal point); line None for a header of one line."""
    with path.open(encoding=encoding, errors="replace") as file:
        lines = [file.readline(MOST_LETTERS) for _ in range(LOOKED_AT)]
    filled = [k for k, line in enumerate(lines) if line.strip()]
    body = next((k for k in filled if _numbers(lines[k])), None)
    if body is None:  # dates, texts: what pandas makes of it
        first = lines[filled[0]] if filled else ","
        return None, (), max(";\t,", key=first.count), "."
    row = lines[body]
    separator = next((c for c in ";\t" if c in row), ",")
    spaced = separator not in row or (separator == "," and re.search(r"\d,\d", row) and not re.search(r",\s", row))
    if spaced and len(row.split()) > 1:
        separator = r"\s+"
    comma = separator != "," and any(re.search(r"\d,\d", lines[k]) for k in filled if k >= body)
    width = len(_cells(row, separator))
    heads = [h for h in (_cells(lines[k], separator) for k in filled if k < body) if len(h) == width]
    quoted = not heads and body != filled[0] and separator != r"\s+"  # a header over several lines
    if quoted or (heads and body == filled[1]):
        return None, (), separator, "," if comma else "."
    units = heads.pop() if len(heads) > 1 and sum(map(is_unit, heads[-1])) > 0.5 * width else ()
    names = tuple(heads[-1]) if heads else ()
    if units:
        names = tuple(f"{n} [{u}]" if known(u) else n for n, u in zip(names, units))
    return body, names, separator, "," if comma else "."


def _cells(line, separator):
    parts = line.split() if separator == r"\s+" else line.rstrip("\r\n").split(separator)
    return [p.strip().strip('"') for p in parts]


def _numbers(line):
    """Tell whether a line holds numbers, empty cells and separators only, and at least one number."""
    cells = [c for c in re.split(r"[;,\s]+", line.strip().replace('"', "")) if c]
    return bool(cells) and all(NUMBER.fullmatch(c) for c in cells)


def _named(path, width, names):
    """Return the names of `width` columns: those given, of one alone the file's, else numbers."""
    if names and len(names) != width:
        what, remedy = f"has {width} columns, and {len(names)} are named", "columns = [...] in the map"
        raise LogError(what, place=str(path), remedy=remedy)
    return names or ((path.stem,) if width == 1 else tuple(f"column_{i + 1}" for i in range(width)))


def _exactly():
    """Return the options with which read_csv reads doubles bit for bit, as pandas 3 does anyway, and whole columns."""
    import pandas as pd

    exact = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
    return {"low_memory": False, **exact}  # a column has one type, whatever its length


# -- MATLAB
def _mat(path, columns, time=None):
    """Return vectors and the columns of matrices of one length, and of one structure where there are several: those of
    `time`, else those that hold most values; `varlab` and kin name columns. `attrs` tell what is left out."""
    import pandas as pd
    from scipy.io import loadmat, whosmat

    try:
        size = sum(int(np.prod(shape)) for _, shape, _ in whosmat(path))
        found = loadmat(path, simplify_cells=True) if size <= MOST_VALUES else {}
    except (OSError, NotImplementedError):
        raise
    except Exception as error:  # a damaged file ends in whatever the parser runs into
        raise ValueError(str(error) or type(error).__name__) from error
    if size > MOST_VALUES:
        raise ValueError(f"more than {MOST_VALUES} values; keep fewer")
    found = {n: v for n, v in found.items() if not n.startswith("__")}
    flat: dict[str, np.ndarray] = {}
    _flatten("", found, flat)
    numbers = {n: v for n, v in flat.items() if v.dtype.kind in "fiub" and 1 <= v.ndim <= 2}
    tables: Counter = Counter()  # (structure, rows): values
    for name, v in numbers.items():
        if len(v) > 2:
            tables[_table(name, v)] += v.size
    if not tables:
        raise ValueError("no variable of it is a table or a vector")
    asked = [_table(time, numbers[time])] if time in numbers else []
    chosen = max(asked or tables, key=lambda table: (tables[table], table[1]))
    n = chosen[1]
    texts = [v for v in flat.values() if v.dtype.kind == "U" and v.ndim == 1]
    out: dict[str, np.ndarray] = {}
    for name, v in numbers.items():
        if len(v) != n or (chosen[0] and _table(name, v)[0] not in ("", chosen[0])):
            continue
        if v.ndim == 1:
            out.setdefault(name, v)
            continue
        labels = next((t for t in texts if len(t) == v.shape[1]), None)
        own = columns
        if len(columns) != v.shape[1] and labels is not None:
            own = tuple(re.sub(r"\s+", " ", str(x)).strip() for x in labels)
        elif len(columns) != v.shape[1]:
            own = tuple(f"{name}_{i + 1}" for i in range(v.shape[1]))
        for label, column in zip(own, v.T):
            out.setdefault(label, column)
    if columns and not set(columns) <= set(out):
        widths = ", ".join(f"{name} has {v.shape[1]}" for name, v in numbers.items() if v.ndim == 2 and len(v) == n)
        raise LogError(f"{len(columns)} columns are named, {widths or 'it has vectors only'}", place=str(path))
    frame = pd.DataFrame({name: np.asarray(v, np.float64) for name, v in out.items()})
    frame.attrs["texts"] = [name for name in flat if name not in numbers]
    left = [f"{of or 'variables'} of {rows} rows" for of, rows in tables if (of, rows) != chosen]
    if left and chosen[0]:
        told = f"read: {chosen[0]}, {n} rows; left out: {', '.join(left)}; --time NAME.COLUMN reads another"
        frame.attrs["left"] = [told]
    return frame


def _table(name, values):
    """Return (structure that holds a variable, its rows)."""
    return name.partition(".")[0] if "." in name else "", len(values)


def _flatten(prefix, value, out):
    """Fill `out` with the arrays in a structure, named by their path."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _flatten(f"{prefix}.{name}" if prefix else name, inner, out)
    elif isinstance(value, np.ndarray):
        out[prefix] = value
