"""Read other people's recordings (text, Parquet, MATLAB, MCAP, folders) as tables over time, for our detectors."""

import contextlib
import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import CosimError, LogError
from cosim.files import regular
from cosim.log.foreign import read_mcap
from cosim.log.format import LIBRARY, log_error
from cosim.log.reader import open_log
from cosim.log.validate import BAD
from cosim.replay import clock
from cosim.replay.tables import KINDS, MOST_VALUES, folder, read_table, together
from cosim.texts import from_json

TIME_NAMES = ("t_s", "t", "time", "time_s", "timestamp", "t_ns", "time_ns", "timestamp_ns")  # looked for in this order
TIME_WORDS = {*"time clock timestamp seconds zeit uhrzeit temps tiempo datum date utc gmt".split()}
_SCALES = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "min": 60.0, "h": 3600.0}  # ends of a name: clock_ms, Zeit [ms]


def read_channels(
    path: str | Path,
    *,
    time: str | None = None,
    on_reset: Any = None,
    part: int = 0,
    wanted: Any = None,
    columns: tuple[str, ...] = (),
) -> dict:
    """Return {channel: DataFrame} of a recording; columns are float64, the index is `t_s` [s], ascending.

    A text, MATLAB or Parquet file is one channel, named by the file's stem; `time` names its time column (default: the
    first of TIME_NAMES in any case, else one with a word for time in its name, else Parquet's own index). Its name ends
    in _ns, (us) or [ms], say, where it is not in seconds; dates count from the first. `columns` name those of a file
    without names. A folder has a channel per table, and one for its files of a single column (cosim/replay/tables.py).
    An MCAP file has a channel per topic, times from its first message. Columns without numbers are left out and named
    in `attrs["texts"]`. A clock that goes back is an error, unless `on_reset` says what to do ("offset", or "split" for
    stretch number `part`); `attrs["oddities"]` tells of gaps, doubled times and changes of rate. Of an MCAP file only
    the topics that `wanted(topic)` accepts are decoded. Raises LogError when the file cannot be read or has no usable
    time, IndexError when there is no stretch of that number.
    """
    path = Path(os.fspath(path))
    if path.suffix.lower() == ".mcap":
        return _mcap(path, wanted)
    frames, told = _frames(path, columns, time=time)
    out = {name: _table(frame, path, name, time, on_reset, part) for name, frame in frames.items()}
    for frame in list(out.values())[:1]:
        frame.attrs["oddities"] += told
    return out


def _frames(path, columns=(), rows=None, time=None):
    """Return ({name: DataFrame}, sentences) of a file or a folder."""
    if path.is_dir():
        frames, told = together(path, columns)
        return {**frames, **{f.stem: _frame(f) for f in folder(path) if f.suffix.lower() == ".parquet"}}, told
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise LogError(f"unknown kind of file {kind!r}", place=str(path), allowed=", ".join((*KINDS, ".mcap")))
    frame = _frame(path, columns, rows, time)
    return {path.stem: frame}, frame.attrs.get("left", [])


def _mcap(path, wanted):
    import pandas as pd

    if _is_ours(path):
        return open_log(path).frames()
    read = read_mcap(path, wanted=wanted)
    first = min(times[0] for times, _ in read.values())
    out = {}
    for topic, (times, rows) in read.items():
        index = pd.Index((np.array(times, dtype=np.int64) - first) / 1e9, name="t_s")
        out[topic] = pd.DataFrame(rows, index=index)
        out[topic].attrs["oddities"] = clock.oddities(index.to_numpy(), topic)
    return out


def _is_ours(path):
    regular(path, LogError)
    try:
        with path.open("rb") as file:
            return LIBRARY.encode() in file.read(64)
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror}", path) from error


def columns_of(path: str | Path, columns: tuple[str, ...] = ()) -> list[str]:
    """Return the columns of a file or folder of tables, none of an MCAP file. Raises LogError."""
    path = Path(os.fspath(path))
    if path.suffix.lower() == ".mcap":
        return []
    frames, _ = _frames(path, columns, rows=5)
    return [c for f in frames.values() for c in (*map(str, f.columns), *f.attrs.get("texts", ()))]


def time_of(names: Any) -> str | None:
    """Return which of a table's columns is its time by its name, or None."""
    small = {re.split(r"\s*[\[(]", str(n).lower())[0]: n for n in reversed(list(names))}
    exact = next((small[n] for n in TIME_NAMES if n in small), None)
    return exact or next((n for n in names if set(re.split(r"[^a-z]+", str(n).lower())) & TIME_WORDS), None)


def _frame(path, columns=(), rows=None, time=None):
    if path.suffix.lower() != ".parquet":
        return read_table(path, columns, rows, time)
    regular(path, LogError)
    try:
        return _parquet(path)
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror or error}", path) from error
    except BAD as error:  # pyarrow's parser errors are ValueErrors and the like
        raise log_error(f"cannot be read as parquet: {error}", path) from error


def _table(frame, path, stem, time, on_reset, part):
    import pandas as pd

    name = time or time_of(frame.columns) or frame.attrs.get("index")
    if name is None or name not in frame.columns:
        raise LogError(
            f"no time column {name or ''}".rstrip(),
            place=str(path),
            allowed=f"one of its columns: {', '.join(map(str, frame.columns[:20]))}",
            remedy="--time COLUMN names it; without names: columns = [...] in the map, or cosim map --columns",
        )
    t = _seconds(frame[name], str(name), path)
    numbers = frame.drop(columns=name).select_dtypes(["number", "bool"], exclude="timedelta").astype(np.float64)
    numbers.columns = numbers.columns.map(str)
    texts = [str(c) for c in frame.columns if c != name and str(c) not in numbers.columns]
    numbers.attrs = {"texts": [*texts, *frame.attrs.get("texts", ())]}
    clock.finite(t, f"column {str(name)!r}", path)
    as_read = t
    t, rows = clock.rising(as_read, path, on_reset, part)
    frame = numbers.iloc[rows].set_axis(pd.Index(t, name="t_s"))
    told = clock.restarts(as_read, on_reset, part) + clock.oddities(t, stem)
    frame.attrs = numbers.attrs | {"oddities": told}
    return frame


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
        frame.attrs["index"] = str(from_json(own, place=str(path))["index_columns"][0])
    return frame


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
        dates = pd.to_datetime(column, errors="coerce", format="mixed", dayfirst=_day_first(column))
        return (dates - dates.iloc[0]).dt.total_seconds().to_numpy()
    unit = re.search(r"[\W_]([a-z]+)[)\]]?$", name.lower())
    return t * _SCALES.get(unit[1] if unit else "", 1.0)


def _day_first(column):
    """Tell whether dates are written 24.11.2026, or 24/11/2026 with days beyond 12 ahead."""
    heads = [re.match(r"\s*(\d{1,2})([./-])\d{1,2}[./-]\d{4}", str(value)) for value in column.iloc[:1000]]
    return any(h and (h[2] == "." or int(h[1]) > 12) for h in heads)
