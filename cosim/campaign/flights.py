"""Many flights: process-parallel or on a cluster, one row per run and detector lane, resumable after a kill.

    result = run_many(scenarios, workers=2, out="logs/mine")      # result.frame, result.parquet, result.failed

Columns of runs.parquet (and `result.frame`), one row per run x detector lane x fault that the lane could notice; a run
without a result has one row. What is of the lane, not of a fault, stands on the first of its rows:

    run, order              id (hash of the expanded scenario), position in the campaign
    <keys of the scenario>  of CORE, of faults, and every one that varies: flight.mass_t, faults.0.frequency_hz, ...
    label.<name>            names of grid points, where the campaign gives any
    FIELDS                  of cosim/judge/row.py, each with its unit and meaning, which the file carries as metadata

timing.parquet holds what a clock measured, and never repeats.

Seeds: EVALUATION_SEED in cosim/campaign/spec.py.
"""

import functools
import itertools
import json
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pandas as pd

from cosim.campaign.pool import outcomes
from cosim.campaign.store import Store, folder, load, write_manifest
from cosim.campaign.worker import FAILED, Packed, run_id
from cosim.errors import CampaignError, OutputError, told_at_call
from cosim.files import regular, replace_text
from cosim.scenario import Scenario
from cosim.scenario.user_parts import identified
from cosim.table import Table
from fdi import registry

CORE = (
    "seed", "duration_s", "flight.mass_t", "flight.cg_pct", "flight.altitude_ft", "flight.turbulence", "manoeuvre.kind",
)  # fmt: skip
FLUSH_S, FLUSH_RUNS = 2.0, 16  # finished runs are safe on disk after at most that


class CampaignResult:
    """What a campaign came to: all rows, timings, the Parquet file (None without a folder), and counts of runs.

    parquet     the file of the rows, None without a folder
    done        runs with a row
    failed      of these, without a flight: infeasible, error or crashed
    resumed     of these, found in the folder
    damaged     files of the folder that were no more whole: their runs were flown again
    notes       what is worth knowing and no error

    Rows in a folder are read when they are asked for.
    """

    def __init__(
        self, store: Store, status: Mapping[str, str], resumed: int = 0, parquet: Path | None = None,
        notes: tuple[str, ...] = (),
    ):  # fmt: skip
        """Take the `store` of the rows and {run: status}."""
        self.parquet, self.resumed, self.notes = parquet, resumed, notes
        self.done, self.damaged = len(status), tuple(store.damaged)
        self.failed = sum(s in FAILED for s in status.values())
        self._store = store

    @functools.cached_property
    def frame(self) -> pd.DataFrame:
        """A row per run, fault and detector lane; columns: cosim/campaign/README.md."""
        return load(self.parquet.parent)[0] if self.parquet else self._store.rows()

    @functools.cached_property
    def timing(self) -> pd.DataFrame:
        """A row per run, and per detector: how long it took [s], a step [us]."""
        return self._store.timing()

    def __repr__(self) -> str:
        counts = self.frame.drop_duplicates("run")["status"].value_counts()
        told = ", ".join(f"{n} {status}" for status, n in counts.items())
        names = ", ".join(self.frame["id"].dropna().unique())
        return f"CampaignResult: {self.done} runs ({told}), detectors {names or 'none'}, {self.parquet or 'no folder'}"

    def _repr_html_(self) -> str:
        lanes = self.frame[self.frame["id"].notna()]
        made = Table(repr(self), "detector", "level", "faults>", "detected>", "false alarms>", kind="")
        for (level, name), rows in lanes.groupby(["level", "id"]):
            mine = rows[rows["concerned"].astype(bool)]
            made.add(name, level, len(mine), int(mine["delay_s"].notna().sum()), int(rows["false_alarms"].sum()))
        return made._repr_html_()

    def to_dict(self) -> dict:
        """Return the JSON of `cosim campaign`."""
        counts = {"done": self.done, "failed": self.failed, "resumed": self.resumed}
        return {"parquet": str(self.parquet) if self.parquet else None, **counts}


@told_at_call
def run_many(
    scenarios: Iterable[Scenario], *, workers: int | None = None, out: str | Path | None = None, resume: bool = True,
    anew: bool = False, executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None, achieved: bool = True, labels: Iterable[dict] | None = None,
) -> CampaignResult:  # fmt: skip
    """Fly `scenarios` (Scenario objects; equal ones once) and return a CampaignResult.

    `workers` processes, by default one per core, 0 for this process; or any concurrent.futures `executor`. `out` is the
    folder of rows; with `resume` what it holds is not flown again, and a user's file that has changed since is refused,
    or with `anew` its runs are flown again. `progress(done, total)` counts runs. `achieved` flies a twin for every run
    with an elevator fault. `labels` is a list of dicts beside the scenarios, for columns label.<name>. Raises
    CampaignError, OutputError; an error of a flight is a row.
    """
    runs, packed, named, brought = _runs(scenarios, labels)
    with folder(out) if out else nullcontext():
        about = table(runs, packed, named)
        texts = (s.portable_toml(aircraft=False) for s in packed)
        store = Store(out, about, texts, resume=resume, anew=anew, files=brought)
        resumed = len(store.finished)
        _tell_guests(packed, store.out)
        todo = [(run, s) for run, s in zip(runs, packed.held) if run not in store.finished]
        if todo and executor is None:
            from cosim.flight.loop.compiling import prepare

            prepare(todo[0][1].scenario())  # here, with a word, and not in every worker at once
        _fly(todo, store, progress, len(runs), workers=workers, executor=executor, achieved=achieved)
        if store.out is None:
            frame = store.rows(("run", "status"))
            return CampaignResult(store, dict(zip(frame["run"], frame["status"])))
        status = store.consolidate(store.out)
        _manifest(store, brought)
    return CampaignResult(store, status, resumed, store.out / "runs.parquet", _left_out(store))


def _manifest(store, brought):
    import pyarrow.parquet as pq

    seeds, took = store.scenarios["seed"], store.timing()["core_s"].dropna()
    rows = pq.read_metadata(store.out / "runs.parquet").num_rows
    about = {
        "runs": len(seeds),
        "rows": rows,
        "seeds": [int(seeds.min()), int(seeds.max())],
        "flights_per_core_s": len(took) / float(took.sum()) if took.sum() > 0.0 else None,
    }
    write_manifest(store.out, about, brought)


def _left_out(store):
    """Return a line about rows of runs that the campaign no longer has, none without any."""
    n, runs = sum(store.others.values()), len(store.others)
    if not n:
        return ()
    what = f"{n} row{'s' * (n != 1)} of {runs} run{'s' * (runs != 1)} of an earlier version of this campaign"
    return (f"{what} left out of {store.out / 'runs.parquet'}; they stay in {store.out / 'parts'}",)


def _tell_guests(scenarios, out):
    """Write what is to be told of the guests that fly beside the rows, so that they are judged without their code."""
    from cosim import parts

    found = {name: s for s in scenarios for name in s.running if name not in registry.SHIPPED}
    entries = []
    for name, scenario in found.items():
        parts.use(scenario)
        own = registry.record(name)
        about = parts.about(registry.module(name))
        entries.append({"id": name, "level": own.level, "every": own.every, "guest": about})
    if entries and out:
        regular(out / "guests.json", OutputError)
        replace_text(out / "guests.json", json.dumps(entries, indent=1))


def _runs(scenarios, labels):
    """Return (runs, Packed scenarios, labels in the same order, {(key, UserFile)} that fly in them); equal scenarios
    once."""
    runs: dict[str, None] = {}  # in order
    packed, named, brought = Packed(), [], {}
    both = zip(scenarios, itertools.repeat({}) if labels is None else labels, strict=labels is not None)
    for scenario, label in ((identified(s), label) for s, label in both):
        run = run_id(scenario)
        if run not in runs:
            runs[run] = None
            packed.append(scenario)
            named.append(label)
            brought.update(dict.fromkeys(scenario.user_parts.items()))
    if not runs:
        raise CampaignError("has no run", place="campaign")
    return list(runs), packed, named, brought


def _fly(todo, store, progress, total, **how):
    """Fly `todo`; rows reach the store every FLUSH_RUNS runs or FLUSH_S seconds, and whatever happens at the end."""
    rows, timing, waiting, since, done = [], [], 0, time.monotonic(), total - len(todo)
    try:
        for _, new, measured in outcomes(todo, **how):
            rows += new
            timing += measured
            waiting, done = waiting + 1, done + 1
            if waiting >= FLUSH_RUNS or time.monotonic() - since > FLUSH_S:
                store.add(rows, timing)
                rows, timing, waiting, since = [], [], 0, time.monotonic()
            if progress:
                progress(done, total)
    finally:
        store.add(rows, timing)


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
