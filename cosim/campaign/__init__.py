"""Many flights: process-parallel or on a cluster, one row per run and detector lane, resumable after a kill.

    result = run_many(scenarios, workers=2, out="logs/mine")      # result.frame, result.parquet, result.failed

Columns of runs.parquet (and `result.frame`), one row per run x detector lane x fault that the lane could notice; a run
without a result has one row. What is of the lane, not of a fault, stands on the first of its rows:

    run, order              id (hash of the expanded scenario), position in the campaign
    <keys of the scenario>  of CORE, of faults, and every one that varies: flight.mass_t, faults.0.frequency_hz, ...
    label.<name>            names of grid points, where the campaign gives any
    FIELDS                  of cosim/judge/row.py, each with its unit and meaning, which the file carries as metadata
    kept                    rules by which the run's log was kept (logs/<run>.mcap), comma-separated, or empty

timing.parquet holds what a clock measured, and never repeats.

**Seeds.** Thresholds are trained on seeds below EVALUATION_SEED, everything that is reported flies on seeds from there
on: a campaign's seeds start there unless it says otherwise.
"""

import functools
import json
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cosim.campaign.pool import outcomes
from cosim.campaign.store import GO_ON, CampaignError, Store, folder
from cosim.campaign.worker import run_id
from cosim.errors import LogError, OutputError, told_at_call
from cosim.files import regular, replace, replace_text
from cosim.scenario import Scenario
from cosim.scenario.brought import identified
from cosim.table import Table
from fdi import registry

EVALUATION_SEED = 1_000_000
CORE = (
    "seed",
    "duration_s",
    "flight.mass_t",
    "flight.cg_pct",
    "flight.altitude_ft",
    "flight.turbulence",
    "manoeuvre.kind",
)
FLUSH_S, FLUSH_RUNS = 2.0, 16  # finished runs are safe on disk after at most that


@dataclass(frozen=True)
class CampaignResult:
    """What a campaign came to: all rows, timings, the Parquet file (None without a folder), and counts of runs."""

    frame: pd.DataFrame
    timing: pd.DataFrame
    parquet: Path | None
    done: int  # runs with a row
    failed: int  # of these, without a flight: infeasible, error or crashed
    resumed: int  # of these, found in the folder
    damaged: tuple[str, ...] = ()  # files of the folder that were no more whole: their runs were flown again
    notes: tuple[str, ...] = ()  # what is worth knowing and no error

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
    scenarios: Iterable[Scenario],
    *,
    workers: int | None = None,
    out: str | Path | None = None,
    resume: bool = True,
    anew: bool = False,
    keep: dict[str, int] | None = None,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
    achieved: bool = True,
    labels: Iterable[dict] | None = None,
) -> CampaignResult:
    """Fly `scenarios` (Scenario objects; equal ones once) and return a CampaignResult.

    `workers` processes, by default one per core, 0 for this process; or any concurrent.futures `executor`. `out` is the
    folder of rows; with `resume` what it holds is not flown again, and a user's file that has changed since is refused,
    or with `anew` its runs are flown again. `keep` maps rules of `log_selection` to how many logs each may keep per
    detector. `progress(done, total)` counts runs. `achieved` flies a twin for every run with an
    elevator fault. `labels` is a list of dicts beside the scenarios, for columns label.<name>. Raises CampaignError,
    OutputError; an error of a flight is a row.
    """
    runs, named = _runs(map(identified, scenarios), labels)
    brought = dict.fromkeys(f for s in runs.values() for f in s.brought.items())
    with folder(out) if out else nullcontext():
        store = Store(out, table(runs, named), resume=resume, anew=anew, files=brought)
        resumed = len(store.finished)
        _tell_guests(runs.values(), store.out)
        todo = [(run, scenario) for run, scenario in runs.items() if run not in store.finished]
        if todo and executor is None:
            from cosim.flight.loop.compiling import prepare

            prepare(todo[0][1])  # here, with a word, and not in every worker at once
        _fly(todo, store, progress, len(runs), workers=workers, executor=executor, achieved=achieved)
        frame = store.rows()
        frame["kept"] = _kept(frame, keep, runs, store.out)
        parquet = store.consolidate(frame)
        if store.out:
            from cosim.campaign import manifest

            manifest.write(store.out, frame, store.timing(), brought)
    by_run = frame.drop_duplicates("run")
    failed = int(by_run["status"].isin(("infeasible", "error", "crashed")).sum())
    timing, damaged = store.timing(), tuple(store.damaged)
    return CampaignResult(frame, timing, parquet, len(by_run), failed, resumed, damaged, _left_out(store))


def _left_out(store):
    """Return a line about rows of runs that the campaign no longer has, none without any."""
    n, runs = sum(store.others.values()), len(store.others)
    if not n:
        return ()
    what = f"{n} row{'s' * (n != 1)} of {runs} run{'s' * (runs != 1)} of an earlier version of this campaign"
    return (f"{what} left out of {store.out / 'runs.parquet'}; they stay in {store.out / 'parts'}",)


def _tell_guests(scenarios, out):
    """Write what is to be told of the guests that fly beside the rows, so that they are judged without their code."""
    from cosim.flight import plugins

    found = {name: s for s in scenarios for name in s.running if name not in registry.SHIPPED}
    entries = []
    for name, scenario in found.items():
        plugins.use(scenario)
        own = registry.record(name)
        about = plugins.about(registry.module(name))
        entries.append({"id": name, "level": own.level, "every": own.every, "guest": about})
    if entries and out:
        regular(out / "guests.json", OutputError)
        replace_text(out / "guests.json", json.dumps(entries, indent=1))


def _runs(scenarios, labels):
    """Return ({run: Scenario}, labels in the same order); equal scenarios once."""
    runs, named = {}, []
    scenarios = list(scenarios)
    for scenario, label in zip(scenarios, labels or [{}] * len(scenarios), strict=True):
        run = run_id(scenario)
        if run not in runs:
            runs[run] = scenario
            named.append(label)
    if not runs:
        raise CampaignError("has no run", place="campaign")
    return runs, named


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


def _kept(frame, keep, runs, out):
    """Choose runs by the rules `keep`, fly them again with a log in `out`/logs; return the column `kept`."""
    if not keep or out is None:
        return ""
    from cosim.campaign.log_selection import choose

    chosen = choose(frame, keep)
    (out / "logs").mkdir(exist_ok=True)
    for run in chosen:
        path = out / "logs" / f"{run}.mcap"
        if not path.exists():
            replace(path, functools.partial(_logged, runs[run], path))
    return frame["run"].map(lambda run: ",".join(chosen.get(run, ())))


def _logged(scenario, path, part):
    """Fly `scenario` with a log at `part`, which is to become `path`."""
    from cosim.flight.simulate import simulate

    try:
        done = simulate(scenario, log=part, timed=False)
    except LogError as error:
        raise OutputError(error.problem, place=str(path), remedy=GO_ON) from None
    if done.status == "interrupted":
        raise KeyboardInterrupt


def table(runs: Mapping[str, Scenario], labels: Iterable[dict] | None = None) -> pd.DataFrame:
    """Return the frame run, order, toml, label.*, and the keys of CORE and those that vary, of {run: Scenario}."""
    flat = [flatten(s.model_dump(mode="python", exclude_none=True, exclude={"title"})) for s in runs.values()]
    keys = dict.fromkeys(k for row in flat for k in row)
    varying = [k for k in keys if k in CORE or len({row.get(k) for row in flat}) > 1 or k.startswith("faults.")]
    out = pd.DataFrame(
        {"run": list(runs), "order": range(len(runs)), "toml": [s.portable_toml(aircraft=False) for s in runs.values()]}
    )
    for name in dict.fromkeys(k for row in labels or () for k in row):
        out[f"label.{name}"] = _typed([row.get(name) for row in labels or ()])
    columns = {k: [row.get(k) for row in flat] for k in varying}
    return pd.concat([out, pd.DataFrame({k: _typed(v) for k, v in columns.items()})], axis=1)


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
