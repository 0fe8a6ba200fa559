"""The score of detectors on a fixed benchmark: recordings of its flights, every detector run on them, one table.

found = score(["iotsekf", "mine.py"])        # the recordings are flown where this machine does not have them
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from cosim.campaign.store import CampaignError
from cosim.compare import bound
from cosim.compare.paired import pair
from cosim.compare.score import flights as benchmark
from cosim.compare.score.rows import Scored, scored
from cosim.compare.score.table import detector
from cosim.errors import did_you_mean
from cosim.flight.guests import load
from cosim.judge.result import plain
from cosim.texts import from_json, read
from fdi import registry
from fdi.registry import SHIPPED

PAIRS = 6  # detectors, up to which every one is compared with every other


@dataclass
class Score:
    """What a score came to: `table` is its JSON, `found` the rows behind it."""

    table: dict
    found: Scored


def score(
    detectors: Sequence[str] = (),
    *,
    seeds: str | Path | None = None,
    limit: int | None = None,
    recordings: str | Path | None = None,
    workers: int | None = None,
    flying: Callable[[int, int], None] | None = None,
    running: Callable[[int, int], None] | None = None,
) -> Score:
    """Score `detectors`, ids of those that ship or files (cosim/flight/guests), by default every one that ships.

    `seeds` is a file of a sealed set, `limit` takes some flights only, `recordings` is their folder. `flying` and
    `running` are told (done, total) flights. Raises CampaignError, GuestError, LogError, OutputError.
    """
    ids, files = named(detectors)
    seed, begin = benchmark.seeds_of(seeds), time.perf_counter()
    flights = benchmark.flown(seed, limit=limit, folder=recordings, workers=workers, progress=flying)
    flown_s, begin = time.perf_counter() - begin, time.perf_counter()
    found = scored(flights, ids, files, workers=workers, progress=running)
    ran_s = time.perf_counter() - begin
    found.rows = bound.of(found.rows, {f.run: f.toml for f in flights})
    names = list(dict.fromkeys([*ids, *(load(f).DETECTOR.id for f in files)]))
    each = [detector(found, name, flights) for name in names]
    ends = found.lanes.drop_duplicates("run").set_index("run")
    onset = ends.filter(regex=r"^faults\.\d+\.start_s$").min(axis=1)
    pairs = [p for a, b in combinations(names, 2) for p in pair(found.rows, a, b, ends["sim_time_s"] - onset)]
    about = {k: v for k, v in benchmark.manifest(seed, flights).items() if k != "sha256"}
    lost = sum("sha256" not in f.told for f in flights)
    took = {"flying_s": flown_s, "scoring_s": ran_s}
    listed = [vars(p) for p in pairs] if len(names) <= PAIRS else []
    return Score(plain({**about, "infeasible": lost, **took, "detectors": each, "pairs": listed}), found)


@dataclass
class Stored:
    """A table to be repeated: its JSON, the detectors of it that can be run, and how many flights it took."""

    table: dict
    detectors: list[str]
    limit: int | None


def stored(path: str | Path, detectors: Sequence[str] = (), seeds: str | Path | None = None) -> Stored:
    """Return the table at `path` and its `detectors` (default: those that ship). Raises CampaignError where a row
    is not there, or was flown on a sealed set that is not at hand."""
    table = from_json(read(path, error=CampaignError), place=str(path), error=CampaignError)
    try:
        rows, flights = [d["id"] for d in table["detectors"]], table["flights"]
        sealed = "digest" in table["seeds"]
    except (KeyError, TypeError):
        raise CampaignError("is no table of `cosim score`", place=str(path)) from None
    if sealed and seeds is None:
        raise CampaignError("was made on a sealed set", place=str(path), remedy="Give its file: --seeds FILE")
    ids, files = named(detectors or [r for r in rows if r in SHIPPED])
    asked = [*ids, *(load(f).DETECTOR.id for f in files)]
    if lost := [name for name in asked if name not in rows]:
        raise CampaignError(f"has no row of {lost[0]}", place=str(path), allowed=", ".join(rows))
    if not asked:
        raise CampaignError("has guests only", place=str(path), remedy="Give their files")
    whole = len(benchmark.scenarios(benchmark.seeds_of(seeds)))
    return Stored(table, [*ids, *files], None if flights >= whole else flights)


def named(detectors: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return (ids of detectors that ship, files or entry points of others). Raises CampaignError, GuestError."""
    ids = [d for d in detectors if d in SHIPPED] if detectors else list(SHIPPED)
    files = [d for d in detectors if d not in SHIPPED]
    for file in files:
        if not Path(file).is_file() and "/" not in file and not file.endswith(".py") and not registry.known(file):
            near = did_you_mean(file, SHIPPED)
            if near:
                raise CampaignError("no detector of this name", place=file, remedy=near)
        load(file)
    return ids, files
