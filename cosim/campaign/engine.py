"""Fly many scenarios, a row per run, fault and detector lane, into a folder that outlives any kill.

    result = run_many(scenarios, workers=2, out="logs/mine")      # result.frame, result.parquet, result.failed
    result = run_campaign("ema-faults")                           # a campaign file, by default into logs/<name>

The folder is described in `cosim.campaign.store`. A Dask cluster on one machine is two commands
(pip install 'cosim-fdi[cluster]'), then --scheduler tcp://127.0.0.1:8786:

    dask scheduler --host 127.0.0.1
    dask worker tcp://127.0.0.1:8786 --nworkers auto --nthreads 1

On several machines every worker needs the same version of this package and of its libraries; nothing is written there.
"""

import itertools
import json
import logging
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pandas as pd
import pyarrow as pa

from cosim import parts
from cosim.campaign import store
from cosim.campaign.pool import finished
from cosim.campaign.spec import load_campaign
from cosim.campaign.store import CampaignResult, fingerprint, table
from cosim.campaign.worker import Flown, Packed, Signals, failed, fly, fly_packed, run_id
from cosim.errors import CampaignError, did_you_mean, told_at_call
from cosim.files import beside, replace_text
from cosim.scenario import Scenario
from cosim.scenario.user_parts import identified

TOGETHER = 16  # runs with one seed fly in one process and share the flight without their fault
CONNECT_S = 20.0  # to a scheduler, and until it has a worker


@told_at_call
def run_many(
    scenarios: Iterable[Scenario], *, workers: int | None = None, out: str | Path | None = None, resume: bool = True,
    executor: Executor | None = None, progress: Callable[[int, int], None] | None = None,
    labels: Iterable[dict] | None = None, signals: Iterable[str] | None = None, rate_hz: float = 50.0, title: str = "",
) -> CampaignResult:  # fmt: skip
    """Fly `scenarios` (Scenario objects; equal ones once) and return a CampaignResult.

    `workers` processes, by default one per core, 0 for this process; or any concurrent.futures `executor`. `out` is the
    folder of rows; with `resume` what it holds is not flown again. `progress(done, total)` counts runs. `labels` are
    dicts beside the scenarios, for columns label.<name>. `signals` (words of `cosim list signals`, none for all) writes
    a Parquet file per flight at `rate_hz`, with labels, and a column `split`. Raises CampaignError, OutputError; an
    error of a flight is a row.
    """
    if executor is None and workers != 0:
        _guarded()
    if out is None:
        with tempfile.TemporaryDirectory() as scratch:
            flown = run_many(scenarios, workers=workers, out=scratch, executor=executor, progress=progress,
                             labels=labels)  # fmt: skip
        flown.parquet = None
        return flown
    runs, packed, named, user_parts = _runs(scenarios, labels)
    wanted, about = None, table(runs, packed, named)
    if signals is not None:
        from cosim.campaign.signals import chosen, splits

        wanted = Signals(chosen(packed, tuple(signals), rate_hz), rate_hz)
        about.insert(2, "split", splits(packed, named))
    out = Path(out)
    with store.opened(out):
        flies = {"title": title, **fingerprint(), "signals": wanted and [list(wanted.words), rate_hz],
                 "user_files": user_parts, "user_detectors": _told(packed)}  # fmt: skip
        found = store.flown_before(out, flies, runs, packed, resume)
        done = found[~found["status"].isin(store.AGAIN)].drop_duplicates("run")
        if wanted:
            done = done.loc[[s == "infeasible" or _signals_of(out, run).is_file() for run, s in done.to_numpy()]]
        replace_text(out / store.ABOUT, json.dumps(flies, indent=1))
        texts = pa.array((s.portable_toml(aircraft=False) for s in packed), pa.string())
        keys = pa.Table.from_pandas(about, preserve_index=False)
        store.write(out / "scenarios.parquet", keys.add_column(2, "toml", texts))
        with store.saved_in_parts(out) as add:
            for flown in _flights(runs, packed, set(done["run"]), progress, workers, executor, wanted):
                if flown.signals:
                    with beside(_signals_of(out, flown.run)) as part:
                        part.write_bytes(flown.signals)
                add(flown)
        return store.consolidated(out, about, flies, len(done))


@told_at_call
def run_campaign(
    campaign: str | Path, *, workers: int | None = None, scheduler: str | None = None, out: str | Path | None = None,
    resume: bool = False, progress: Callable[[int, int], None] | None = None, user_detectors: Iterable[str | Path] = (),
    signals: Iterable[str] | None = None, rate_hz: float = 50.0,
) -> CampaignResult:  # fmt: skip
    """Fly the campaign of a built-in name or file and return a CampaignResult; `out` defaults to logs/<name>.

    `scheduler` is the address of a Dask scheduler ("tcp://127.0.0.1:8786"). `user_detectors` are files of further
    detectors (cosim/parts), which every worker finds under the same name. With `resume` it goes on in its folder. The
    rest as in `run_many`. Raises CampaignError, ScenarioError.
    """
    parts.loaded(user_detectors)  # the campaign may set their parameters
    made = load_campaign(campaign)
    scenarios, labels = made.scenarios()
    with nullcontext((None, workers)) if scheduler is None else cluster(scheduler) as (executor, threads):
        return run_many(
            _with(scenarios, user_detectors), workers=threads if workers is None else workers, executor=executor,
            out=out or folder(campaign), resume=resume, progress=progress, labels=labels, signals=signals,
            rate_hz=rate_hz, title=made.title,
        )  # fmt: skip


def rerun(
    campaign: str | Path, run: str, *, out: str | Path | None = None, user_detectors: Iterable[str | Path] = ()
) -> tuple:  # fmt: skip
    """Fly run `run` of a campaign again with a log; return (scenario, Result, repeats, same_code).

    `repeats` tells whether every detector's row in the campaign's folder is the same again, `same_code` whether the
    folder was flown with this code, these designs and libraries; both are None when the folder has no row of it. Raises
    CampaignError when no run has this id.
    """
    from cosim.flight.simulate import simulate

    parts.loaded(user_detectors)
    runs = {run_id(s): s for s in _with(load_campaign(campaign).scenarios()[0], user_detectors)}
    if run not in runs:
        raise CampaignError("no run of this campaign has this id", place=f"--rerun {run}",
                            remedy=did_you_mean(run, runs))  # fmt: skip
    home, scenario = Path(out or folder(campaign)), runs[run]
    log = home / "logs" / f"{run}.mcap"
    log.parent.mkdir(parents=True, exist_ok=True)
    result = simulate(scenario, log=log)
    stored = store.rows_of(home, "runs").to_pandas()
    stored = stored[stored["run"] == run].sort_values("lane").to_dict("records")
    if not stored:
        return scenario, result, None, None
    rows = fly(run, scenario).rows
    pairs = [(a[k], b[k]) for a, b in zip(rows, stored) for k in a]
    same = len(rows) == len(stored) and all((pd.isna(a) and pd.isna(b)) or a == b for a, b in pairs)
    return scenario, result, same, store.manifest(home).items() >= fingerprint().items()


def folder(campaign: str | Path) -> Path:
    """Return the default folder of a campaign: logs/<name>."""
    return Path("logs") / Path(str(campaign)).stem


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


def _with(scenarios, user_detectors):
    """Return the scenarios with user detectors, by files that every process finds."""
    files = [Path(g).resolve() if os.path.isfile(g) else g for g in user_detectors]
    return (identified(parts.with_detectors(s, files)) for s in scenarios)


def _told(scenarios):
    """Return what is to be told of a user's detectors, so that they are judged without their code."""
    from fdi import registry

    told: dict[str, dict] = {}
    for scenario in scenarios:
        for name in set(scenario.running) - set(registry.SHIPPED) - set(told):
            parts.use(scenario)
            own = registry.record(name)
            part = parts.about(registry.module(name))
            told[name] = {"id": name, "level": own.level, "every": own.every, "user_detector": part}
    return list(told.values())


def _flights(runs, packed, done, progress, workers, executor, signals):
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
        calls = ((n, fly_packed, (group, signals)) for n, group in enumerate(same))
        for _, group in finished(calls, workers=workers, executor=executor, died=lambda c, _: again.extend(c[2][0])):
            yield from group
        if again:
            calls = ((run, fly_packed, ([(run, data)], signals)) for run, data in again)
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


def _signals_of(out, run):
    return out / "signals" / f"{run}.parquet"
