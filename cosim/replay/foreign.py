"""Read other people's recordings (CSV, Parquet, MCAP) as tables over time, for diagnosis by our detectors."""

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
from cosim.log.scan import BAD
from cosim.replay import clock
from cosim.texts import from_json

TIME_NAMES = ("t_s", "t", "time", "time_s", "timestamp", "t_ns", "time_ns", "timestamp_ns")  # looked for in this order
MOST_VALUES = 50_000_000  # of a Parquet file, which may hold as many in a few bytes
_SCALES = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3}  # ends of a name: clock_ms, Clock (ms), clock [ms]


def read_channels(
    path: str | Path, *, time: str | None = None, on_reset: Any = None, part: int = 0, wanted: Any = None
) -> dict:
    """Return {channel: DataFrame} of a recording; columns are float64, the index is `t_s` [s], ascending.

    A CSV or Parquet file is one channel, named by the file's stem; `time` names its time column (default: the first
    of TIME_NAMES, else Parquet's own index). Its name ends in _ns, (us) or [ms], say, where it is not in seconds; dates
    count from the first. An MCAP file has a channel per topic, times from its first message. Columns without numbers
    are left out and named in `attrs["texts"]`. A clock that goes back is an error, unless `on_reset` says what to do
    ("offset", or "split" for stretch number `part`); `attrs["oddities"]` tells of gaps, doubled times and changes of
    rate. Of an MCAP file only the topics that `wanted(topic)` accepts are decoded. Raises LogError when the file cannot
    be read or has no usable time, IndexError when there is no stretch of that number.
    """
    path = Path(os.fspath(path))
    kind = path.suffix.lower()
    if kind == ".mcap":
        return _mcap(path, wanted)
    if kind not in (".csv", ".parquet"):
        raise LogError(f"unknown kind of file {kind!r}", place=str(path), allowed=".csv, .parquet or .mcap")
    return {path.stem: _table(path, kind, time, on_reset, part)}


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


def columns_of(path: str | Path) -> list[str]:
    """Return the columns of a CSV or Parquet file, none of another. Raises LogError."""
    path = Path(os.fspath(path))
    kind = path.suffix.lower()
    if kind not in (".csv", ".parquet"):
        return []
    frame = _frame(path, kind, rows=0)
    return [*map(str, frame.columns), *frame.attrs.get("texts", ())]


def _frame(path, kind, rows=None):
    import pandas as pd

    regular(path, LogError)
    try:
        if kind == ".csv":
            return pd.read_csv(path, nrows=rows, **_exactly(), **_dialect(path))
        return _parquet(path)
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror or error}", path) from error
    except BAD as error:  # pandas' and pyarrow's parser errors are ValueErrors and the like
        raise log_error(f"cannot be read as {kind[1:]}: {error}", path) from error


def _table(path, kind, time, on_reset, part):
    import pandas as pd

    frame = _frame(path, kind)
    name = time or next((n for n in (*TIME_NAMES, frame.attrs.get("index")) if n in frame.columns), None)
    if name is None or name not in frame.columns:
        columns = ", ".join(map(str, frame.columns[:20]))
        raise LogError(
            f"no time column {name or ''}".rstrip(), place=str(path), allowed=f"one of its columns: {columns}"
        )
    t = _seconds(frame[name], name, path)
    numbers = frame.drop(columns=name).select_dtypes(["number", "bool"], exclude="timedelta").astype(np.float64)
    texts = [str(c) for c in frame.columns if c != name and c not in numbers.columns]
    numbers.attrs = {"texts": [*texts, *frame.attrs.get("texts", ())]}
    clock.finite(t, f"column {name!r}", path)
    as_read = t
    t, rows = clock.rising(as_read, path, on_reset, part)
    frame = numbers.iloc[rows].set_axis(pd.Index(t, name="t_s"))
    told = clock.restarts(as_read, on_reset, part) + clock.oddities(t, path.stem)
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


def _dialect(path):
    """Return the options with which read_csv takes what separates the columns, and a decimal comma."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = [file.readline(100_000) for _ in range(3)]
    separator = max(";\t,", key=lines[0].count)
    comma = separator != "," and any(re.search(r"\d,\d", line) for line in lines[1:])
    return {"sep": separator, "decimal": "," if comma else "."}


def _exactly():
    """Return the options with which read_csv reads doubles bit for bit, as pandas 3 does anyway, and whole columns."""
    import pandas as pd

    exact = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
    return {"low_memory": False, **exact}  # a column has one type, whatever its length


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
    unit = re.search(r"[\W_]([a-z]+)[)\]]?$", name)
    return t * _SCALES.get(unit[1] if unit else "", 1.0)
