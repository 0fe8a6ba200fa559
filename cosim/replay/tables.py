"""Tables of numbers as others write them: text with or without a header, MATLAB 5, a folder of one file per channel."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import LogError
from cosim.files import regular
from cosim.log.format import log_error
from cosim.log.validate import BAD
from cosim.replay.units import is_unit, known

TEXT = (".csv", ".tsv", ".txt", ".asc", ".dat")
KINDS = (*TEXT, ".parquet", ".mat")
LOOKED_AT = 60  # lines in which the numbers of a text begin
MOST_VALUES = 50_000_000  # of a file: 400 MB in memory
MOST_BYTES = 20 * MOST_VALUES  # of a text, whose numbers take some twenty characters
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|[-+]?nan|[-+]?inf", re.IGNORECASE)


def read_table(path: Path, columns: tuple[str, ...] = (), rows: int | None = None, time: str | None = None) -> Any:
    """Return the table in a text or MATLAB file as a DataFrame; `columns` name those of a file without names, `time`
    chooses among the structures of a MATLAB file the one of its time column.

    Columns that are no numbers stay as they are. Raises LogError where the file cannot be read, is too large or does
    not have as many columns as are named.
    """
    regular(path, LogError)
    most = 8 * MOST_VALUES if path.suffix.lower() == ".mat" else MOST_BYTES
    if path.is_file() and path.stat().st_size > most:
        raise LogError(
            f"has {path.stat().st_size / 1e9:.3g} GB", place=str(path), allowed=f"{most / 1e9:g} GB",
            remedy="Cut it, or keep the columns that are needed as Parquet",
        )  # fmt: skip
    try:
        frame = _mat(path, columns, time) if path.suffix.lower() == ".mat" else _text(path, columns, rows)
    except OSError as error:
        raise log_error(f"cannot read the file: {error.strerror or error}", path) from error
    except NotImplementedError:
        raise LogError(
            "is a MATLAB file of version 7.3", place=str(path), allowed="versions 4 to 7", remedy="save -v7 in MATLAB"
        ) from None
    except BAD as error:  # parser errors are ValueErrors and the like
        raise log_error(f"cannot be read as {path.suffix[1:]}: {error}", path) from error
    return frame


# -- text
def _text(path, columns, rows):
    import pandas as pd

    begin, names, separator, decimal = _layout(path)
    how: dict[str, Any] = {"sep": separator, "decimal": decimal, "nrows": rows, "encoding_errors": "replace"}
    if begin is None:  # an ordinary header, and anything below it
        frame = pd.read_csv(path, **_exactly(), **how)
    else:
        frame = pd.read_csv(path, header=None, skiprows=begin, **_exactly(), **how)
        frame.columns = pd.Index(_named(path, frame.shape[1], columns or names))
    return frame


def _layout(path):
    """Return (first line of numbers, names, separator, decimal point); line None for a header of one line."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = [file.readline(100_000) for _ in range(LOOKED_AT)]
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
        raise LogError(
            f"has {width} columns, and {len(names)} are named", place=str(path), remedy="columns = [...] in the map"
        )
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
    tables: dict[tuple[str, int], int] = {}
    for name, v in numbers.items():
        if len(v) > 2:
            tables[_table(name, v)] = tables.get(_table(name, v), 0) + v.size
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
        if len(columns) == v.shape[1]:
            own = columns
        elif labels is not None:
            own = tuple(re.sub(r"\s+", " ", str(x)).strip() for x in labels)
        else:
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


# -- folder
def folder(path: Path) -> list[Path]:
    """Return the files of a folder that may be tables. Raises LogError where there is no such file."""
    found = sorted(f for f in path.iterdir() if f.suffix.lower() in KINDS and f.is_file() and f.name[0] != ".")
    if not found:
        raise LogError("holds no table", place=str(path), allowed=", ".join(KINDS))
    return found


def together(path: Path, columns: tuple[str, ...] = ()) -> tuple[dict[str, Any], list[str]]:
    """Return ({name: DataFrame} of the tables in a folder, sentences): files of one column each and of the same length
    are one table, named by the folder, with a column per file."""
    import pandas as pd

    read = {f.stem: read_table(f, columns) for f in folder(path) if f.suffix.lower() != ".parquet"}
    single = {stem: frame.iloc[:, 0] for stem, frame in read.items() if frame.shape[1] == 1}
    if len(single) < 2:
        return read, []
    lengths = [len(column) for column in single.values()]
    n = max(set(lengths), key=lengths.count)
    joined = pd.DataFrame({stem: column.to_numpy() for stem, column in single.items() if len(column) == n})
    left = [f"{stem} ({len(c)} rows)" for stem, c in single.items() if len(c) != n]
    told = [f"left out, other than {n} rows: {', '.join(left)}"] if left else []
    return {path.name: joined, **{stem: frame for stem, frame in read.items() if stem not in single}}, told
