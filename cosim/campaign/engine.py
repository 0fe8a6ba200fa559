"""Fly many scenarios, a row per run, fault and detector lane, into a folder that outlives any kill.

    result = run_many(scenarios, workers=2, out="logs/mine")      # result.frame, result.parquet, result.failed
    result = run_campaign("ema-faults")                           # a campaign file, by default into logs/<name>

    campaign.json       what flies: digest of code, designs and libraries, the user's parts; once done what was flown
    scenarios.parquet   run, order, toml and every key that varies
    parts/              rows and timing of a few finished runs per file, each appears by an atomic rename
    runs.parquet        a row per run, fault and lane, sorted, with the scenario's columns: the result
    timing.parquet      what a clock measured; never the same twice, so it stands apart
    signals/<run>.parquet   with `signals`: what detectors may read of the flight, and labels
    logs/<run>.mcap     logs of runs that were flown again

A run is done when runs.parquet or a part holds it. A Dask cluster on one machine is two commands
(pip install 'cosim-fdi[cluster]'), then --scheduler tcp://127.0.0.1:8786:

    dask scheduler --host 127.0.0.1
    dask worker tcp://127.0.0.1:8786 --nworkers auto --nthreads 1

On several machines every worker needs the same version of this package and of its libraries; nothing is written there.
"""

import functools
import hashlib
import itertools
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from actuators.source_hash import FLYING
from cosim.campaign.pool import finished
from cosim.campaign.spec import load_campaign
from cosim.campaign.worker import FAILED, Flown, Packed, Signals, failed, fly, fly_packed, run_id
from cosim.errors import CampaignError, OutputError, did_you_mean, told_at_call
from cosim.files import FULL, SPACE, beside, replace_text
from cosim.judge.row import FIELDS, Field
from cosim.parts import with_detectors
from cosim.scenario import Scenario
from cosim.scenario.user_parts import identified
from cosim.texts import from_json, read

ROOT = Path(__file__).resolve().parents[2]
ABOUT = "campaign.json"
FILES = (ABOUT, "scenarios.parquet", "runs.parquet", "timing.parquet")
FOLDERS = (*FLYING, "cosim/campaign", "aircraft")  # what decides about a row
DECIDING = (".py", ".json", ".npz", ".toml", ".xml")
CORE = (
    "seed", "duration_s", "flight.mass_t", "flight.cg_pct", "flight.altitude_ft", "flight.turbulence", "manoeuvre.kind",
)  # fmt: skip
FLUSH_S, FLUSH_RUNS = 2.0, 16  # finished runs are safe on disk after at most that
TOGETHER = 16  # runs with one seed fly in one process and share the flight without their fault
AGAIN = ("error", "crashed")  # runs that are flown again on resuming: a full disk or a kill may have passed
GO_ON = "Free space there, then go on with --resume"
KEY = ["run", "lane", "fault"]
CONNECT_S = 20.0  # to a scheduler, and until it has a worker


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
    notes       what is worth knowing and no error
    """

    def __init__(
        self, frame: pd.DataFrame, timing: pd.DataFrame, resumed: int = 0, parquet: Path | None = None,
        notes: tuple[str, ...] = (),
    ):  # fmt: skip
        """Count the runs of `frame`."""
        self.frame, self.timing, self.resumed, self.parquet, self.notes = frame, timing, resumed, parquet, notes
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


@told_at_call
def run_many(
    scenarios: Iterable[Scenario], *, workers: int | None = None, out: str | Path | None = None, resume: bool = True,
    executor: Executor | None = None, progress: Callable[[int, int], None] | None = None, achieved: bool = True,
    labels: Iterable[dict] | None = None, signals: Iterable[str] | None = None, rate_hz: float = 50.0, title: str = "",
) -> CampaignResult:  # fmt: skip
    """Fly `scenarios` (Scenario objects; equal ones once) and return a CampaignResult.

    `workers` processes, by default one per core, 0 for this process; or any concurrent.futures `executor`. `out` is the
    folder of rows; with `resume` what it holds is not flown again. `progress(done, total)` counts runs. `achieved`
    flies every run with an elevator fault without it, too. `labels` are dicts beside the scenarios, for columns
    label.<name>. `signals` (words of `cosim list signals`, none for all) writes a Parquet file per flight at `rate_hz`,
    with labels, and a column `split`. Raises CampaignError, OutputError; an error of a flight is a row.
    """
    if executor is None and workers != 0:
        _guarded()
    if out is None:
        with tempfile.TemporaryDirectory() as scratch:
            flown = run_many(scenarios, workers=workers, out=scratch, executor=executor, progress=progress,
                             achieved=achieved, labels=labels)  # fmt: skip
        flown.parquet = None
        return flown
    runs, packed, named, user_parts = _runs(scenarios, labels)
    wanted, about = None, table(runs, packed, named)
    if signals is not None:
        from cosim.campaign.signals import chosen, splits

        wanted = Signals(chosen(packed, tuple(signals), rate_hz), rate_hz)
        about.insert(2, "split", splits(packed, named))
    out = Path(out)
    with _opened(out):
        flies = {"title": title, **fingerprint(), "signals": wanted and [list(wanted.words), rate_hz],
                 "user_files": user_parts, "guests": _guests(packed)}  # fmt: skip
        found = _found(out, flies, resume)
        done = found[~found["status"].isin(AGAIN) & found["run"].isin(runs)].drop_duplicates("run")
        if wanted:
            done = done.loc[[s == "infeasible" or _signals_of(out, run).is_file() for run, s in done.to_numpy()]]
        replace_text(out / ABOUT, json.dumps(flies, indent=1))
        texts = pa.array((s.portable_toml(aircraft=False) for s in packed), pa.string())
        keys = pa.Table.from_pandas(about, preserve_index=False)
        _write(out / "scenarios.parquet", keys.add_column(2, "toml", texts))
        with _parts(out) as add:
            how = {"workers": workers, "executor": executor, "achieved": achieved, "signals": wanted}
            for flown in _flights(runs, packed, set(done["run"]), progress, **how):
                if flown.signals:
                    with beside(_signals_of(out, flown.run)) as part:
                        part.write_bytes(flown.signals)
                add(flown)
        return _consolidated(out, about, flies, len(done))


@told_at_call
def run_campaign(
    campaign: str | Path, *, workers: int | None = None, scheduler: str | None = None, out: str | Path | None = None,
    resume: bool = False, progress: Callable[[int, int], None] | None = None, guests: Iterable[str | Path] = (),
    signals: Iterable[str] | None = None, rate_hz: float = 50.0,
) -> CampaignResult:  # fmt: skip
    """Fly the campaign of a built-in name or file and return a CampaignResult; `out` defaults to logs/<name>.

    `scheduler` is the address of a Dask scheduler ("tcp://127.0.0.1:8786"). `guests` are files of further detectors
    (cosim/parts), which every worker finds under the same name. With `resume` it goes on in its folder. The
    rest as in `run_many`. Raises CampaignError, ScenarioError.
    """
    made = load_campaign(campaign)
    scenarios, labels = made.scenarios()
    with nullcontext((None, workers)) if scheduler is None else cluster(scheduler) as (executor, threads):
        return run_many(
            _with(scenarios, guests), workers=threads if workers is None else workers, executor=executor,
            out=out or folder(campaign), resume=resume, progress=progress, labels=labels, signals=signals,
            rate_hz=rate_hz, title=made.title,
        )  # fmt: skip


def rerun(campaign: str | Path, run: str, *, out: str | Path | None = None, guests: Iterable[str | Path] = ()) -> tuple:
    """Fly run `run` of a campaign again with a log; return (scenario, Result, repeats, same_code).

    `repeats` tells whether every detector's row in the campaign's folder is the same again, `same_code` whether the
    folder was flown with this code, these designs and libraries; both are None when the folder has no row of it. Raises
    CampaignError when no run has this id.
    """
    from cosim.flight.simulate import simulate

    runs = {run_id(s): s for s in _with(load_campaign(campaign).scenarios()[0], guests)}
    if run not in runs:
        near = did_you_mean(run, runs)
        raise CampaignError("no run of this campaign has this id", place=f"--rerun {run}", remedy=near)
    home, scenario = Path(out or folder(campaign)), runs[run]
    log = home / "logs" / f"{run}.mcap"
    log.parent.mkdir(parents=True, exist_ok=True)
    result = simulate(scenario, log=log)
    stored = _rows(home, "runs").to_pandas()
    stored = stored[stored["run"] == run].sort_values("lane").to_dict("records")
    if not stored:
        return scenario, result, None, None
    rows = fly(run, scenario, not pd.isna(stored[0]["rod_mm"])).rows
    pairs = [(a[k], b[k]) for a, b in zip(rows, stored) for k in a]
    same = len(rows) == len(stored) and all((pd.isna(a) and pd.isna(b)) or a == b for a, b in pairs)
    return scenario, result, same, _about(home).items() >= fingerprint().items()


def load(folder: str | Path) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, str], dict]:
    """Return (rows, timing, {run: TOML of its scenario}, campaign.json) of a campaign's folder; of one that was killed,
    what was finished by then. Raises CampaignError when the folder holds no finished run."""
    folder = Path(folder)
    rows = _rows(folder, "runs").to_pandas()
    if rows.empty:
        remedy = "`cosim campaign` flies one"
        raise CampaignError("holds no finished run of a campaign", place=str(folder), remedy=remedy)
    told = _read([folder / "scenarios.parquet"]).to_pandas()
    timing = _once(_rows(folder, "timing").to_pandas(), ["run", "id"])
    return _joined(told.drop(columns="toml"), rows), timing, dict(zip(told["run"], told["toml"])), _about(folder)


def folder(campaign: str | Path) -> Path:
    """Return the default folder of a campaign: logs/<name>."""
    return Path("logs") / Path(str(campaign)).stem


# -- what flies


@functools.cache
def fingerprint() -> dict:
    """Return {digest, versions} of everything that decides about a row: sources, designs, aircraft, libraries."""
    digest = hashlib.sha256()
    for path in sorted(p for name in FOLDERS for p in (ROOT / name).rglob("*") if p.suffix in DECIDING):
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    versions = {name: version(name) for name in ("jsbsim", "numpy", "scipy", "numba")}
    return {"digest": digest.hexdigest()[:16], "versions": versions}


def _provenance():
    """Return {software, commit, changed}; commit is None outside a checkout, `changed` tells of a source that differs
    from it."""

    def git(*words):
        try:
            told = subprocess.run(["git", "-C", ROOT, *words], capture_output=True, text=True, timeout=20, check=True)
        except (OSError, subprocess.SubprocessError):
            return None
        return told.stdout.strip()

    here = (ROOT / ".git").exists()
    commit, changed = (git("rev-parse", "HEAD"), git("status", "--porcelain", "-uno")) if here else (None, None)
    return {"software": f"cosim {version('cosim-fdi')}", "commit": commit, "changed": changed and bool(changed)}


def _runs(scenarios, labels):
    """Return (runs, Packed scenarios, labels in the same order, user parts that fly in them); equal scenarios once."""
    runs: dict[str, None] = {}  # in order
    packed, named = Packed(), []
    user_parts: dict[tuple, None] = {}
    both = zip(scenarios, itertools.repeat({}) if labels is None else labels, strict=labels is not None)
    for scenario, label in ((identified(s), label) for s, label in both):
        run = run_id(scenario)
        if run not in runs:
            runs[run] = None
            packed.append(scenario)
            named.append(label)
            user_parts |= {(key, *part): None for key, part in scenario.user_parts.items()}
    if not runs:
        raise CampaignError("has no run", place="campaign")
    return list(runs), packed, named, [list(part) for part in user_parts]


def _with(scenarios, guests):
    """Return the scenarios with guests, by files that every process finds."""
    files = [Path(g).resolve() if os.path.isfile(g) else g for g in guests]
    return (identified(with_detectors(s, files)) for s in scenarios)


def _guests(scenarios):
    """Return what is to be told of a user's detectors, so that they are judged without their code."""
    from cosim import parts
    from fdi import registry

    told: dict[str, dict] = {}
    for scenario in scenarios:
        for name in set(scenario.running) - set(registry.SHIPPED) - set(told):
            parts.use(scenario)
            own = registry.record(name)
            guest = parts.about(registry.module(name))
            told[name] = {"id": name, "level": own.level, "every": own.every, "guest": guest}
    return list(told.values())


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


# -- where it flies


def _flights(runs, packed, done, progress, *, workers, executor, achieved, signals):
    """Yield the Flown of each of `runs` that is not `done`. A run whose process dies under it, and again when it is
    flown alone, is a row "crashed"."""
    groups: dict = {}
    for run, seed, data in zip(runs, packed.seeds, packed.packed):
        if run not in done:
            groups.setdefault(seed, []).append((run, data))
    same = [group[i : i + TOGETHER] for group in groups.values() for i in range(0, len(group), TOGETHER)]
    if same and executor is None:
        from cosim.flight.loop.compiling import prepare

        prepare(packed[0])  # here, with a word, and not in every worker at once
    again: list = []
    crashed: list = []

    def died_alone(call, error):
        crashed.append(Flown(call[0], [failed(call[0], "crashed", f"its process died: {error}")], []))

    def flown() -> Iterator[Flown]:
        calls = ((n, fly_packed, (group, achieved, signals)) for n, group in enumerate(same))
        for _, group in finished(calls, workers=workers, executor=executor, died=lambda c, _: again.extend(c[2][0])):
            yield from group
        if again:
            calls = ((run, fly_packed, ([(run, data)], achieved, signals)) for run, data in again)
            for _, group in finished(calls, workers=1, executor=executor, ahead=1, died=died_alone):
                yield from group
        yield from crashed

    for n, one in enumerate(flown(), len(runs) - sum(map(len, same)) + 1):
        yield one
        if progress:
            progress(n, len(runs))


def _guarded():
    """Raise CampaignError where a script flies at its top level: its worker processes import it, and would fly, too."""
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path and os.path.isfile(path) and not main.__spec__ and b"__name__" not in Path(path).read_bytes():
        said = "flies a campaign at its top level, and its worker processes import this file"
        remedy = 'Put the call below `if __name__ == "__main__":`, or fly with workers=0'
        raise CampaignError(said, place=path, remedy=remedy)


@contextmanager
def cluster(address: str) -> Iterator[tuple]:
    """Open (executor, number of threads) of the Dask scheduler at `address`; CampaignError when it does not answer."""
    try:
        from distributed import Client
        from distributed.comm.addressing import parse_host_port
    except ImportError:
        remedy = "Install the extra: pip install 'cosim-fdi[cluster]'"
        raise CampaignError("Dask is not installed", place="--scheduler", remedy=remedy) from None
    remedy = "Start one: `dask scheduler` and `dask worker tcp://127.0.0.1:8786 --nworkers auto --nthreads 1`"
    try:
        parse_host_port(address.rpartition("://")[2])  # or a Client that is half made waits for 40 s at its end
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError):
        raise CampaignError("no scheduler answers there", place=f"--scheduler {address}", remedy=remedy) from None
    for name in [n for n in logging.root.manager.loggerDict if n.startswith(("distributed", "tornado", "asyncio"))]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # they print tracebacks of every worker that goes
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            remedy = f"Start some: `dask worker {address} --nworkers auto --nthreads 1`"
            raise CampaignError("the scheduler has no worker", place=f"--scheduler {address}", remedy=remedy) from None
        yield client.get_executor(pure=False), sum(client.nthreads().values())


# -- the folder


@contextmanager
def _opened(out):
    """Make the folder of a campaign. Raises OutputError, with what to do, when it cannot be written, now or later, or
    holds a foreign file that would be overwritten."""
    try:
        foreign = [] if _about(out) else [name for name in FILES if (out / name).exists()]
        foreign = foreign or [f"parts/{p.name}" for p in (out / "parts").glob("*") if not _about(out)]
        if foreign:
            said = f"holds a {foreign[0]} that no campaign wrote"
            raise OutputError(said, place=str(out), remedy="Choose another place with -o")
        (out / "parts").mkdir(parents=True, exist_ok=True)
        yield
    except OutputError as error:
        error.remedy = GO_ON if error.remedy == SPACE else error.remedy
        raise
    except OSError as error:
        remedy = GO_ON if error.errno in FULL else "Choose another place with -o"
        raise OutputError(f"cannot be written: {error.strerror}", place=str(out), remedy=remedy) from None


def _about(out):
    """Return what campaign.json of a folder says, {} without one of ours."""
    path = out / ABOUT
    told = from_json(read(path, error=CampaignError), place=str(path), error=CampaignError) if path.is_file() else {}
    return told if isinstance(told, dict) and "digest" in told else {}


def _found(out, flies, resume):
    """Return run and status of every row in a folder. Raises CampaignError where they do not belong to what `flies`."""
    told, found = _about(out), _rows(out, "runs").select(["run", "status"]).to_pandas()
    if found.empty:
        return found
    if not resume:
        remedy = "Add --resume, or choose another place with -o"
        raise CampaignError(f"holds {found['run'].nunique()} runs already", place=str(out), remedy=remedy)
    other = "code, designs or libraries" if any(told.get(k) != v for k, v in fingerprint().items()) else ""
    if not other and told["signals"] and told["signals"] != flies["signals"]:
        other = "--signals and --rate"
    if other:
        remedy = "Choose another place with -o"
        raise CampaignError(f"its rows were flown with other {other}", place=str(out), remedy=remedy)
    return found


@contextmanager
def _parts(out):
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
                _write(out / "parts" / f"{kind}-{name}.parquet", pa.Table.from_pylist(rows, KINDS[kind]))
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


def _consolidated(out, about, flies, resumed):
    """Make of all that lies in a folder runs.parquet and timing.parquet, then remove the parts; return the result."""
    before = [p for kind in KINDS for p in (out / "parts").glob(f"{kind}-*.parquet")]
    rows, timing = (_rows(out, kind).to_pandas() for kind in KINDS)
    others = rows[~rows["run"].isin(about["run"])].drop_duplicates(KEY)
    frame, timing = _joined(about, rows), _once(timing[timing["run"].isin(about["run"])], ["run", "id"])
    if len(others):  # of another version of the campaign
        kept = pa.Table.from_pandas(others, ROWS, preserve_index=False)
        _write(out / "parts" / f"runs-{uuid.uuid4().hex}.parquet", kept)
    made = pa.Table.from_pandas(frame, preserve_index=False)
    typed = [ROWS.field(f.name) if f.name in ROWS.names else f for f in made.schema]
    made = made.cast(pa.schema(typed, made.schema.metadata))
    _write(out / "runs.parquet", made)
    _write(out / "timing.parquet", pa.Table.from_pandas(timing, TIMING, preserve_index=False))
    for path in before:
        path.unlink()
    seeds, took = about["seed"], timing["core_s"].dropna()
    told = {"runs": len(seeds), "rows": len(frame), "seeds": [int(seeds.min()), int(seeds.max())],
            "flights_per_core_s": len(took) / float(took.sum()) if took.sum() > 0.0 else None, **_provenance(),
            "sha256": {name: _sha256(out / name) for name in ("scenarios.parquet", "runs.parquet")}}  # fmt: skip
    replace_text(out / ABOUT, json.dumps({**flies, **told}, indent=1))
    notes: tuple[str, ...] = ()
    if n := others["run"].nunique():
        notes = (f"{n} runs of an earlier version of this campaign left out; they stay in {out / 'parts'}",)
    return CampaignResult(pd.read_parquet(out / "runs.parquet"), timing, resumed, out / "runs.parquet", notes)


def _joined(scenarios, found):
    """Return the rows with the scenario's columns, in the order of the scenarios, each once."""
    lost = found["status"].isin(AGAIN)
    found = found[~lost | ~found["run"].isin(found.loc[~lost, "run"])]  # a run that was flown again
    merged = scenarios.merge(_once(found, KEY), on="run", how="inner")
    return merged.sort_values(["order", "lane", "fault"], kind="stable").reset_index(drop=True)


def _once(found, keys):
    return found.drop_duplicates(keys).reset_index(drop=True)


def _rows(out, kind):
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


def _write(path, made):
    with beside(path) as part:
        pq.write_table(made, part, compression="zstd")


def _signals_of(out, run):
    return out / "signals" / f"{run}.parquet"


def _sha256(path):
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
