"""The folder of a campaign: its rows outlive any kill.

    campaign.json       what flies: digest of code, designs and libraries, the user's parts; once done what was flown
    scenarios.parquet   run, order, toml and every key that varies
    parts/              rows and timing of a few finished runs per file, each appears by an atomic rename
    runs.parquet        a row per run, fault and lane, sorted, with the scenario's columns: the result
    timing.parquet      what a clock measured; never the same twice, so it stands apart
    signals/<run>.parquet   with `signals`: what detectors may read of the flight, and labels
    logs/<run>.mcap     logs of runs that were flown again

A run is done when runs.parquet or a part holds it.
"""

import functools
import hashlib
import json
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from actuators.kernels import FLYING
from cosim.campaign.worker import FAILED, Flown, Packed
from cosim.errors import CampaignError, OutputError, few
from cosim.files import FULL, SPACE, beside, replace_text
from cosim.judge.row import FIELDS, Field
from cosim.scenario import Scenario
from cosim.texts import from_json, read, toml

ROOT = Path(__file__).resolve().parents[2]
ABOUT = "campaign.json"
FOLDERS = (*FLYING, "cosim/campaign", "aircraft")  # what decides about a row
DECIDING = (".py", ".json", ".npz", ".toml", ".xml")
CORE = (
    "seed", "duration_s", "flight.mass_t", "flight.cg_pct", "flight.altitude_ft", "flight.turbulence", "manoeuvre.kind",
)  # fmt: skip
FLUSH_S, FLUSH_RUNS = 2.0, 16  # finished runs are safe on disk after at most that
AGAIN = ("error", "crashed")  # runs that are flown again on resuming: a full disk or a kill may have passed
GO_ON = "Free space there, then go on with --resume"
KEY = ["run", "lane", "fault"]


def _schema(fields):
    """Return the schema of `fields`; unit and meaning are metadata of each."""
    told = ((f, {"unit": f.unit, "meaning": f.meaning}) for f in fields)
    return pa.schema([pa.field(f.name, pa.type_for_alias(f.type), metadata=about) for f, about in told])


ROWS = _schema(FIELDS)
TIMING = _schema([
    Field("run", "string", "", "run"),
    Field("id", "string", "", "detector; null for the whole run"),
    Field("wall_time_s", "double", "s", "time of the flight by the clock"),
    Field("startup_s", "double", "s", "time before its first tick"),
    Field("core_s", "double", "s", "processor time of the whole run, its fault-free run and judgement"),
    Field("step_us", "double", "us", "time per step and lane"),
])  # fmt: skip
KINDS = {"runs": ROWS, "timing": TIMING}


class CampaignResult:
    """Outcome of a campaign.

    frame       a row per run, fault and detector lane (cosim/judge/row.py), with the keys of the scenario
    timing      a row per run, and per detector: how long it took [s], a step [us]
    parquet     the file of the rows, None without a folder
    done        runs with a row; `failed` of these without a flight; `resumed` of these found in the folder
    """

    def __init__(self, frame: pd.DataFrame, timing: pd.DataFrame, resumed: int = 0, parquet: Path | None = None):
        """Count the runs of `frame`."""
        self.frame, self.timing, self.resumed, self.parquet = frame, timing, resumed, parquet
        self._status = frame.drop_duplicates("run")["status"]
        self.done, self.failed = len(self._status), int(self._status.isin(FAILED).sum())

    def __repr__(self) -> str:
        told = ", ".join(f"{n} {status}" for status, n in self._status.value_counts().items())
        names = ", ".join(self.frame["id"].dropna().unique())
        return f"CampaignResult: {self.done} runs ({told}), detectors {names or 'none'}, {self.parquet or 'no folder'}"

    def to_dict(self) -> dict:
        """Return the JSON of `cosim campaign`."""
        counts = {"done": self.done, "failed": self.failed, "resumed": self.resumed}
        return {"parquet": str(self.parquet) if self.parquet else None, **counts}


def load(folder: str | Path) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, str], dict]:
    """Return (rows, timing, {run: TOML of its scenario}, campaign.json) of a campaign's folder; of one that was killed,
    what was finished by then. Raises CampaignError when the folder holds no finished run."""
    folder = Path(folder)
    rows = rows_of(folder, "runs").to_pandas()
    if rows.empty:
        remedy = "`cosim campaign` flies one"
        raise CampaignError("holds no finished run of a campaign", place=str(folder), remedy=remedy)
    told = _read([folder / "scenarios.parquet"]).to_pandas()
    timing = _once(rows_of(folder, "timing").to_pandas(), ["run", "id"])
    return joined(told.drop(columns="toml"), rows), timing, dict(zip(told["run"], told["toml"])), manifest(folder)


@functools.cache
def fingerprint() -> dict:
    """Return {digest, versions} of everything that decides about a row: sources, designs, aircraft, libraries."""
    digest = hashlib.sha256()
    for path in sorted(p for name in FOLDERS for p in (ROOT / name).rglob("*") if p.suffix in DECIDING):
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    versions = {name: version(name) for name in ("jsbsim", "numpy", "scipy", "numba")}
    return {"digest": digest.hexdigest()[:16], "versions": versions}


def table(runs: Iterable[str], scenarios: Iterable[Scenario], labels: Iterable[dict] = ()) -> pd.DataFrame:
    """Return the frame run, order, label.*, and the keys of CORE and those that vary, of `runs` and their scenarios."""
    runs, labels = list(runs), list(labels)
    columns: dict[str, list] = {}
    for n, scenario in enumerate(scenarios):
        row = flatten(scenario.model_dump(mode="python", exclude_none=True, exclude={"title"}))
        columns.update({key: [None] * n for key in row if key not in columns})
        for key, column in columns.items():
            value, last = row.get(key), column[-1] if n else None
            column.append(last if type(last) is type(value) and last == value else value)  # equal values are held once
    out = pd.DataFrame({"run": runs, "order": range(len(runs))})
    for name in dict.fromkeys(k for row in labels for k in row):
        out[f"label.{name}"] = _typed([row.get(name) for row in labels])
    varying = {k: v for k, v in columns.items() if k in CORE or k.startswith("faults.") or len(set(v)) > 1}
    return pd.concat([out, pd.DataFrame({k: _typed(v) for k, v in varying.items()})], axis=1)


def flatten(node: Any, path: str = "") -> dict:
    """Return {"flight.mass_t": 200.0, "faults.0.kind": ...} of nested dicts and lists; a list of words is one text."""
    if isinstance(node, dict):
        items = list(node.items())
    elif isinstance(node, list | tuple) and node and isinstance(node[0], dict):
        items = [(str(i), v) for i, v in enumerate(node)]
    elif isinstance(node, list | tuple):
        return {path: ",".join(map(str, node))} if node else {}
    else:
        return {path: node}
    return {k: v for key, value in items for k, v in flatten(value, f"{path}.{key}" if path else key).items()}


def _typed(values):
    """Return a column of one type: numbers (null is NaN), or text."""
    given = [v for v in values if v is not None]
    if all(isinstance(v, bool) for v in given):
        return pd.array(values, dtype="boolean")
    if all(isinstance(v, int) for v in given) and len(given) == len(values):
        return pd.array(values, dtype="int64")
    if all(isinstance(v, int | float) for v in given):
        return pd.array([float("nan") if v is None else float(v) for v in values], dtype="float64")
    return pd.array([None if v is None else str(v) for v in values], dtype="str")


@contextmanager
def opened(out: Path) -> Iterator[None]:
    """Make the folder of a campaign. Raises OutputError, with what to do, when it cannot be written, now or later, or
    holds files that no campaign wrote."""
    if foreign := [] if manifest(out) else [p for name in (ABOUT, "*.parquet", "parts/*") for p in out.glob(name)]:
        said = f"holds a {foreign[0].relative_to(out)} that no campaign wrote"
        raise OutputError(said, place=str(out), remedy="Choose another place with -o")
    try:
        (out / "parts").mkdir(parents=True, exist_ok=True)
        yield
    except OutputError as error:
        error.remedy = GO_ON if error.remedy == SPACE else error.remedy
        raise
    except OSError as error:
        remedy = GO_ON if error.errno in FULL else "Choose another place with -o"
        raise OutputError(f"cannot be written: {error.strerror}", place=str(out), remedy=remedy) from None


def manifest(out: Path) -> dict:
    """Return what campaign.json of a folder says, {} without one that a campaign wrote."""
    path = out / ABOUT
    told = from_json(read(path, error=CampaignError), place=str(path), error=CampaignError) if path.is_file() else {}
    return told if isinstance(told, dict) and "digest" in told else {}


def flown_before(out: Path, flies: dict, runs: Sequence[str], scenarios: Packed, resume: bool) -> pd.DataFrame:
    """Return run and status of every row in a folder. Raises CampaignError where they do not belong to what `flies`,
    which are `runs` of `scenarios`."""
    told, found = manifest(out), rows_of(out, "runs").select(["run", "status"]).to_pandas()
    if found.empty:
        return found
    if not resume:
        remedy = "Add --resume, or choose another place with -o"
        raise CampaignError(f"holds {found['run'].nunique()} runs already", place=str(out), remedy=remedy)
    gone = set(found["run"]) - set(runs)
    differ = {
        "other code, designs or libraries": any(told.get(k) != v for k, v in fingerprint().items()),
        "other --signals or --rate": told.get("signals") not in (None, flies["signals"]),
        "another campaign, or an earlier version of it" + (_edited(out, gone, scenarios) if gone else ""): gone,
    }
    for word in (word for word, differs in differ.items() if differs):
        raise CampaignError(f"its rows are of {word}", place=str(out), remedy="Choose another place with -o")
    return found


def _edited(out, gone, scenarios):
    """Return in which keys the first of the runs of a folder that are `gone` differs from that of its number in
    `scenarios`, or the last."""
    told = _read([out / "scenarios.parquet"]).to_pandas()
    run = told[told["run"].isin(gone)].iloc[0]
    now = scenarios[min(run["order"], len(scenarios) - 1)].portable_toml(aircraft=False)
    was, now = (flatten(toml(text, place=str(out))) for text in (run["toml"], now))
    return f": run {run['order']} had another {few(', '.join(k for k in was | now if was.get(k) != now.get(k)))}"


@contextmanager
def saved_in_parts(out: Path) -> Iterator[Callable[[Flown], None]]:
    """Give a function that takes what was flown; it is safe on disk after FLUSH_RUNS runs or FLUSH_S seconds, and
    whatever happens at the end."""
    waiting: list = []
    since = time.monotonic()

    def flush():
        nonlocal since
        name = uuid.uuid4().hex
        new = {"timing": [t for f in waiting for t in f.timing], "runs": [r for f in waiting for r in f.rows]}
        for kind, rows in new.items():
            if rows:
                write(out / "parts" / f"{kind}-{name}.parquet", pa.Table.from_pylist(rows, KINDS[kind]))
        waiting.clear()
        since = time.monotonic()

    def add(flown):
        waiting.append(flown)
        if len(waiting) >= FLUSH_RUNS or time.monotonic() - since > FLUSH_S:
            flush()

    try:
        yield add
    finally:
        flush()


def consolidated(out: Path, about: pd.DataFrame, flies: dict, resumed: int) -> CampaignResult:
    """Make of all that lies in a folder runs.parquet and timing.parquet, then remove the parts; return the result."""
    before = [p for kind in KINDS for p in (out / "parts").glob(f"{kind}-*.parquet")]
    rows, timing = (rows_of(out, kind).to_pandas() for kind in KINDS)
    frame, timing = joined(about, rows), _once(timing, ["run", "id"])
    made = pa.Table.from_pandas(frame, preserve_index=False)
    typed = [ROWS.field(f.name) if f.name in ROWS.names else f for f in made.schema]
    made = made.cast(pa.schema(typed, made.schema.metadata))
    write(out / "runs.parquet", made)
    write(out / "timing.parquet", pa.Table.from_pandas(timing, TIMING, preserve_index=False))
    for path in before:
        path.unlink()
    seeds, took = about["seed"], timing["core_s"].dropna()
    told = {"runs": len(seeds), "rows": len(frame), "seeds": [int(seeds.min()), int(seeds.max())],
            "flights_per_core_s": len(took) / float(took.sum()) if took.sum() > 0.0 else None,
            "software": f"cosim {version('cosim-fdi')}",
            "sha256": {name: _sha256(out / name) for name in ("scenarios.parquet", "runs.parquet")}}  # fmt: skip
    replace_text(out / ABOUT, json.dumps({**flies, **told}, indent=1))
    return CampaignResult(pd.read_parquet(out / "runs.parquet"), timing, resumed, out / "runs.parquet")


def joined(scenarios: pd.DataFrame, found: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with the scenario's columns, in the order of the scenarios, each once."""
    lost = found["status"].isin(AGAIN)
    found = found[~lost | ~found["run"].isin(found.loc[~lost, "run"])]  # a run that was flown again
    merged = scenarios.merge(_once(found, KEY), on="run", how="inner")
    return merged.sort_values(["order", "lane", "fault"], kind="stable").reset_index(drop=True)


def _once(found, keys):
    return found.drop_duplicates(keys).reset_index(drop=True)


def rows_of(out: Path, kind: str) -> pa.Table:
    """Return the rows of a kind, "runs" or "timing", of a folder: those of its table and of all parts."""
    whole = out / f"{kind}.parquet"
    paths = [*([whole] if whole.is_file() else []), *sorted((out / "parts").glob(f"{kind}-*.parquet"))]
    return _read(paths, KINDS[kind]) if paths else KINDS[kind].empty_table()


def _read(paths, schema=None):
    """Return Parquet files as one table, of the columns of `schema`. Raises CampaignError that names a damaged one."""
    made = []
    for path in paths:
        try:
            made.append(ds.dataset(path, schema=schema, format="parquet").to_table())
        except (pa.ArrowException, OSError, ValueError) as error:
            said = f"is damaged: {' '.join(str(error).split())[:80]}"
            remedy = "Remove it; `cosim campaign --resume` flies again what is lost"
            raise CampaignError(said, place=str(path), remedy=remedy) from None
    return pa.concat_tables(made)


def write(path: Path, made: pa.Table) -> None:
    """Write a table as a Parquet file, which appears when it is whole."""
    with beside(path) as part:
        pq.write_table(made, part, compression="zstd")


def _sha256(path):
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
