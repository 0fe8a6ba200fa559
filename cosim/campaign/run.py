"""Fly a campaign file: its scenarios, where the workers are, a single run again.

A Dask cluster on one laptop is two commands (pip install 'cosim-fdi[cluster]'), then --scheduler tcp://127.0.0.1:8786:

    dask scheduler --host 127.0.0.1
    dask worker tcp://127.0.0.1:8786 --nworkers auto --nthreads 1

On several machines every worker needs the same version of this package and of its libraries: rows are only comparable
when the code is. Rows go through the machine that flies the campaign; nothing is written by a worker.
"""

import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pandas as pd

from cosim.campaign.flights import CampaignResult, run_many
from cosim.campaign.spec import load_campaign
from cosim.campaign.store import MANIFEST, fingerprint, flown_with, load
from cosim.campaign.worker import fly, run_id
from cosim.errors import CampaignError, did_you_mean, told_at_call
from cosim.files import replace_text
from cosim.parts import with_detectors
from cosim.scenario.user_parts import identified
from cosim.texts import from_json, read

CONNECT_S = 20.0  # to a scheduler, and until it has a worker


@told_at_call
def run_campaign(
    campaign: str | Path, *, workers: int | None = None, scheduler: str | None = None, out: str | Path | None = None,
    resume: bool = False, anew: bool = False, progress: Callable[[int, int], None] | None = None,
    guests: Iterable[str | Path] = (),
) -> CampaignResult:  # fmt: skip
    """Fly the campaign of a built-in name or file and return a CampaignResult; `out` defaults to logs/<name>.

    `scheduler` is the address of a Dask scheduler ("tcp://127.0.0.1:8786"). `guests` are files of further detectors
    (cosim/parts), which every worker finds under the same name. With `resume` it goes on in its folder; `anew`
    flies again what a file of a user's has flown that has changed since. Raises CampaignError, ScenarioError.
    """
    made = load_campaign(campaign)
    scenarios, labels = made.scenarios()
    scenarios = _with(scenarios, guests)
    with nullcontext((None, None)) if scheduler is None else cluster(scheduler) as (executor, threads):
        result = run_many(
            scenarios, workers=threads if workers is None else workers, executor=executor, out=out or folder(campaign),
            resume=resume or anew, anew=anew, progress=progress, labels=labels,
        )  # fmt: skip
    path = Path(out or folder(campaign)) / MANIFEST  # the campaign's title stands in the manifest, for pages of it
    told = from_json(read(path, error=CampaignError), place=str(path), error=CampaignError)
    replace_text(path, json.dumps(told | {"title": made.title}, indent=1))
    return result


def _with(scenarios, guests):
    """Return the scenarios with guests, by files that every process finds."""
    files = [Path(g).resolve() if os.path.isfile(g) else g for g in guests]
    return (identified(with_detectors(s, files)) for s in scenarios)


def folder(campaign: str | Path) -> Path:
    """Return the default folder of a campaign: logs/<name>."""
    return Path("logs") / Path(str(campaign)).stem


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
    except (OSError, TimeoutError, ValueError) as error:
        said = f"no scheduler answers there: {error}" if str(error) else "no scheduler answers there"
        raise CampaignError(said, place=f"--scheduler {address}", remedy=remedy) from None
    for name in [n for n in logging.root.manager.loggerDict if n.startswith(("distributed", "tornado", "asyncio"))]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # they print tracebacks of every worker that goes
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            remedy = f"Start some: `dask worker {address} --nworkers auto --nthreads 1`"
            raise CampaignError("the scheduler has no worker", place=f"--scheduler {address}", remedy=remedy) from None
        yield client.get_executor(pure=False), sum(client.nthreads().values())


def rerun(campaign: str | Path, run: str, *, out: str | Path | None = None, guests: Iterable[str | Path] = ()) -> tuple:
    """Fly run `run` of a campaign again with a log; return (scenario, Result, repeats, same_code).

    `repeats` tells whether every detector's row in the campaign's folder is the same again, `same_code` whether the
    folder was flown with this code, these designs and libraries; both are None when the folder has no row of it. Raises
    CampaignError when no run has this id.
    """
    from cosim.flight.simulate import simulate

    scenarios = _with(load_campaign(campaign).scenarios()[0], guests)
    runs = {run_id(s): s for s in scenarios}
    if run not in runs:
        near = did_you_mean(run, runs)
        raise CampaignError("no run of this campaign has this id", place=f"--rerun {run}", remedy=near)
    home, scenario = Path(out or folder(campaign)), runs[run]
    log = home / "logs" / f"{run}.mcap"
    log.parent.mkdir(parents=True, exist_ok=True)
    result = simulate(scenario, log=log)
    stored = load(home)[0] if (home / "runs.parquet").is_file() else pd.DataFrame({"run": [], "lane": []})
    held = stored[stored["run"] == run].sort_values("lane").to_dict("records")
    if not held:
        return scenario, result, None, None
    rows, _ = fly(run, scenario, bool(held[0]["rod_mm"] == held[0]["rod_mm"]))
    pairs = [(a[k], b[k]) for a, b in zip(rows, held) for k in a]
    same = len(rows) == len(held) and all((pd.isna(a) and pd.isna(b)) or a == b for a, b in pairs)
    return scenario, result, same, flown_with(home) == fingerprint()
