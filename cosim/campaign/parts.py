"""Rows and timings of a campaign as they came: files of a few runs each, read and merged a row group at a time."""

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from cosim.errors import OutputError
from cosim.files import beside, regular
from cosim.judge.row import FIELDS, Field


def _schema(fields: Iterable[Field]) -> pa.Schema:
    """Return the schema of `fields`; unit and meaning are metadata of each."""
    told = ((f, {"unit": f.unit, "meaning": f.meaning}) for f in fields)
    return pa.schema([pa.field(f.name, pa.type_for_alias(f.type), metadata=about) for f, about in told])


ROWS = _schema(FIELDS)
TIMING = _schema([
    Field("run", "string", "", "run"),
    Field("id", "string", "", "detector; null for the whole run"),
    Field("wall_time_s", "double", "s", "time of the flight by the clock"),
    Field("startup_s", "double", "s", "time before its first tick"),
    Field("core_s", "double", "s", "processor time of the whole run, its twin and judgement"),
    Field("step_us", "double", "us", "time per step and lane"),
])  # fmt: skip
SCENARIOS = _schema([  # and what varies
    Field("run", "string", "", "run"), Field("order", "int64", "", "position in the campaign"),
    Field("toml", "string", "", "the expanded scenario"),
])  # fmt: skip
KINDS = {"rows": ROWS, "timing": TIMING}
KEYS = {"rows": ["run", "status"], "timing": ["run"]}  # without a value of these a part is damaged
DAMAGE = (pa.ArrowException, OSError, ValueError, KeyError)
BLOCK = 2000  # runs that are joined and written at a time


def names(folder: Path) -> list[str]:
    """Return the names of the parts in a campaign's folder, as they stand below it."""
    return [f"parts/{p.name}" for kind in ("rows", "timing") for p in paths(folder, kind)]


def paths(folder: Path, kind: str) -> list[Path]:
    """Return the files of a kind, "rows" or "timing", of a campaign's folder, sorted."""
    return sorted((folder / "parts").glob(f"{kind}-*.parquet"))


def add(folder: Path, kind: str, name: str, rows: list[dict]) -> None:
    """Write one more part of a kind."""
    write(folder / "parts" / f"{kind}-{name}.parquet", pa.Table.from_pylist(rows, KINDS[kind]))


def read(
    folder: Path, kind: str, columns: Sequence[str] | None = None, damaged: list[str] | None = None
) -> pd.DataFrame | None:
    """Return all whole parts of a kind as one frame, of `columns` alone where given; None without a part. `damaged`
    takes the names of the others."""
    found: list[pa.Table] = []
    for path in paths(folder, kind):
        groups = whole(path, kind, columns)
        if groups is not None:
            found += groups
        elif damaged is not None:
            damaged.append(str(path))
    return pa.concat_tables(found).to_pandas() if found else None


def whole(path: Path, kind: str, columns: Sequence[str] | None = None) -> list[pa.Table] | None:
    """Return the row groups of a part, of `columns` alone where given; None when one of them is damaged."""
    found = []
    for table in _groups(path, kind):
        if table is None:
            return None
        found.append(table if columns is None else table.select(columns))
    return found


def _groups(path, kind, first=0):
    """Yield each row group of a part as a table with the columns of its schema; None, and no more, where damaged."""
    with contextlib.suppress(*DAMAGE):
        with _opened(path) as file:
            inside = pq.ParquetFile(file)
            for i in range(first, inside.num_row_groups):
                yield checked(inside.read_row_group(i), KINDS[kind], KEYS[kind]).select(KINDS[kind].names)
            return
    yield None


def _opened(path):
    if not path.is_file():  # a pipe would wait for ever
        raise OSError
    return path.open("rb")


def ordered(folder: Path, kind: str, order: dict[str, int]) -> Iterator[pd.DataFrame]:
    """Yield the rows of a kind as frames of whole runs, in the `order` {run: position} of the runs, without others. A
    frame is of BLOCK positions, so that what is written does not depend on how the rows came; held are the row groups
    that have one of its runs."""
    groups: dict[int, dict] = {}  # block: its (path, number of the row group)
    last: dict[tuple, int] = {}  # the last block of a row group
    for path in paths(folder, kind):
        for i, table in enumerate(whole(path, kind, ["run"]) or ()):
            for block in {order[run] // BLOCK for run in table["run"].to_pylist() if run in order}:
                groups.setdefault(block, {})[path, i] = None
                last[path, i] = max(block, last.get((path, i), 0))
    held: dict[tuple, pa.Table] = {}
    for block in sorted(groups):
        for path, i in (key for key in groups[block] if key not in held):
            if (table := next(_groups(path, kind, i))) is None:
                raise OutputError("has changed while it was read", place=str(path), remedy="Go on with --resume")
            held[path, i] = table
        frame = pa.concat_tables([held[key] for key in groups[block]]).to_pandas()
        at = frame["run"].map(order)
        yield frame.loc[at[at // BLOCK == block].sort_values(kind="stable").index]
        held = {key: table for key, table in held.items() if last[key] > block}


def merge(folder: Path, kind: str) -> None:
    """Make one file of the parts of a kind, one row group after the other."""
    parts, damaged = paths(folder, kind), []
    if len(parts) < 2:
        return
    name = hashlib.sha256("".join(p.name for p in parts).encode()).hexdigest()[:16]
    merged = folder / "parts" / f"{kind}-{name}.parquet"
    regular(merged, OutputError)
    with beside(merged) as part, part.open("wb") as file:
        with pq.ParquetWriter(file, KINDS[kind], compression="zstd") as out:
            for p in parts:
                if any(table is None for table in _groups(p, kind)):
                    damaged.append(p)
                else:
                    for table in _groups(p, kind):
                        out.write_table(table)
    for p in parts:
        if p in damaged:  # stays for whoever wants to look at it, and is named once
            p.rename(p.with_suffix(".damaged"))
        elif p != merged:
            p.unlink()


def table_of(path: Path, schema: pa.Schema, keys: Sequence[str]) -> pa.Table | None:
    """Return a Parquet file as a table, the columns of `schema` with their types, null where it has none; None when it
    cannot be read, or lacks one of the columns `keys` or a value of them."""
    with contextlib.suppress(*DAMAGE), _opened(path) as file:
        return checked(pq.read_table(file), schema, keys)
    return None


def checked(table: pa.Table, schema: pa.Schema, keys: Sequence[str]) -> pa.Table:
    """Return a table with the columns of `schema` in their types. Raises one of DAMAGE where a column of `keys` is
    missing or has a null, where a name stands twice, or where a column cannot be cast to its type."""
    table.validate(full=True)
    held = table.column_names
    if len(set(held)) != len(held) or any(name not in held or table[name].null_count for name in keys):
        raise ValueError
    for f in schema:
        if f.name in held:
            table = table.set_column(held.index(f.name), f, table[f.name].cast(f.type))
        else:
            table = table.append_column(f, pa.nulls(table.num_rows, f.type))
    return table


def write(path: Path, table: pa.Table) -> None:
    """Write a Parquet file that is there completely or not at all."""
    write_blocks(path, [table])


def write_blocks(path: Path, blocks: Iterable[pa.Table]) -> None:
    """Write tables of one schema, that of the first, one after the other into one Parquet file."""
    regular(path, OutputError)
    with beside(path) as part, part.open("wb") as file:  # Arrow takes no name that is not UTF-8
        out = None
        for block in blocks:
            out = out or pq.ParquetWriter(file, block.schema, compression="zstd")
            out.write_table(block.cast(out.schema))
        if out:
            out.close()
