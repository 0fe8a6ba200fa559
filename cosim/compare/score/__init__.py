"""The score of detectors on a fixed benchmark: recordings of its flights, every detector run on them, one table.

found = score(["iotsekf", "mine.py"])        # the recordings are flown where this machine does not have them
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import util
from itertools import combinations
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from cosim.compare import bound
from cosim.compare.paired import pair
from cosim.compare.score import flights as benchmark
from cosim.compare.score.rows import Scored, detector, scored
from cosim.errors import CampaignError, did_you_mean
from cosim.flight.plugins import GuestError, load, loaded
from cosim.flight.plugins.check import trial
from cosim.judge.result import plain
from cosim.texts import from_json, read
from fdi import registry
from fdi.registry import DEFAULT, SHIPPED

LEARNED = Path(__file__).resolve().parents[2] / "learned"
BOARD = Path(__file__).with_name(f"{benchmark.NAME}.json")  # the table of all that ship, as it was last made
PAIRS = 6  # detectors, up to which every one is compared with every other; of more those of the same level


@dataclass
class Score:
    """What a score came to: `table` is its JSON, `found` the rows behind it."""

    table: dict
    found: Scored


def score(
    detectors: Sequence[str] = (), *, seeds: str | Path | None = None, limit: int | None = None,
    recordings: str | Path | None = None, workers: int | None = None, flying: Callable[[int, int], None] | None = None,
    running: Callable[[int, int], None] | None = None,
) -> Score:  # fmt: skip
    """Score `detectors`, ids of those that ship or files (cosim/flight/plugins), by default all that ship and the
    learned ones.

    `seeds` is a file of a sealed set, `limit` takes some flights only, `recordings` is their folder. `flying` and
    `running` are told (done, total) flights. Raises CampaignError, GuestError, LogError, OutputError.
    """
    detectors, lost = _sound(detectors)
    ids, files = named(detectors)
    seed, begin = benchmark.seeds_of(seeds), time.perf_counter()
    flights = benchmark.flown(seed, limit=limit, folder=recordings, workers=workers, progress=flying)
    flown_s, begin = time.perf_counter() - begin, time.perf_counter()
    found = scored(flights, ids, files, workers=workers, progress=running)
    ran_s = time.perf_counter() - begin
    lost |= {str(f): found.lost[str(Path(f).resolve())] for f in files if str(Path(f).resolve()) in found.lost}
    files = [f for f in files if str(f) not in lost]
    found.rows = bound.of(found.rows, {f.run: f.toml for f in flights})
    names = list(dict.fromkeys([*ids, *(g.DETECTOR.id for g in loaded(files))]))
    each = [detector(found, name, flights) for name in names]
    ends = found.lanes.drop_duplicates("run").set_index("run")
    onset = ends.filter(regex=r"^faults\.\d+\.start_s$").min(axis=1)
    level = {d["id"]: d["level"] for d in each}
    matched = [(a, b) for a, b in combinations(names, 2) if len(names) <= PAIRS or level[a] == level[b]]
    pairs = [p for a, b in matched for p in pair(found.rows, a, b, ends["sim_time_s"] - onset)]
    about = {k: v for k, v in benchmark.manifest(seed, flights).items() if k != "sha256"}
    gone = sum("sha256" not in f.told for f in flights)
    took = {"of": len(benchmark.scenarios(seed)), "flying_s": flown_s, "scoring_s": ran_s}
    listed = [vars(p) for p in pairs]
    marked = {"lost": [{"file": f, "why": why} for f, why in lost.items()]} if lost else {}
    return Score(plain({**about, "infeasible": gone, **took, "detectors": each, "pairs": listed, **marked}), found)


def _sound(detectors):
    """Return (detectors, {file: why}) without those files whose detector does not leave a process alive."""
    lost = {}
    for name in detectors:
        if Path(name).suffix == ".py" and Path(name).is_file() and str(name) not in learned().values():
            try:
                trial(name)
            except GuestError as error:
                if not error.fatal or len(detectors) == 1:
                    raise
                lost[str(name)] = error.problem
    if lost and len(lost) == len(detectors):
        raise GuestError("; ".join(f"{file} {why}" for file, why in lost.items()))
    return [d for d in detectors if str(d) not in lost], lost


@dataclass
class Stored:
    """A table to be repeated: its JSON, the detectors of it that can be run, and how many flights it took."""

    table: dict
    detectors: list[str]
    limit: int | None


class _Row(BaseModel):
    id: str


class _Table(BaseModel):
    """What must be in a table that is to be repeated."""

    model_config = ConfigDict(strict=True)

    detectors: list[_Row]
    flights: Annotated[int, Field(ge=1)]
    seeds: dict[str, str | int]


def stored(path: str | Path, detectors: Sequence[str] = (), seeds: str | Path | None = None) -> Stored:
    """Return the table at `path` ("benchmark-1": the one that ships) and its `detectors` (default: those that ship).
    Raises CampaignError where a row is not there, or was flown on a sealed set that is not at hand."""
    path = BOARD if str(path) == benchmark.NAME else path
    table = from_json(read(path, error=CampaignError), place=str(path), error=CampaignError)
    try:
        told = _Table.model_validate(table)
    except ValueError:
        raise CampaignError("is no table of `cosim score`", place=str(path)) from None
    rows, flights = [d.id for d in told.detectors], told.flights
    if "digest" in told.seeds and seeds is None:
        raise CampaignError("was made on a sealed set", place=str(path), remedy="Give its file: --seeds FILE")
    ids, files = named(detectors or [r for r in rows if r in SHIPPED or r in learned()])
    asked = [*ids, *(g.DETECTOR.id for g in loaded(files))]
    if lost := [name for name in asked if name not in rows]:
        raise CampaignError(f"has no row of {lost[0]}", place=str(path), allowed=", ".join(rows))
    if not asked:
        raise CampaignError("has guests only", place=str(path), remedy="Give their files")
    whole = len(benchmark.scenarios(benchmark.seeds_of(seeds)))
    return Stored(table, [*ids, *files], None if flights >= whole else flights)


def learned() -> dict[str, str]:
    """Return {id: file} of the learned detectors, {} where what runs them is not installed (cosim-fdi[learn])."""
    found = {p.stem: str(p) for p in sorted(LEARNED.glob("learned_*.py")) if p.with_suffix(".onnx").is_file()}
    return found if util.find_spec("onnxruntime") else {}


def board(made: dict) -> list[dict]:
    """Return the rows of the stored table of all detectors where the same code flew for the table `made`, else []."""
    if not BOARD.is_file():
        return []
    table = from_json(BOARD.read_bytes(), place=str(BOARD))
    same = table["content"] == made["content"] or table["digest"] == made["digest"]  # bits may depend on the machine
    return table["detectors"] if same and table["flights"] == made["flights"] else []


def named(detectors: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return (ids of detectors that ship, files or entry points of others). Raises CampaignError, GuestError."""
    ids = [d for d in detectors if d in SHIPPED] if detectors else list(DEFAULT)
    own = learned()
    files = [own.get(d, d) for d in detectors or own if d not in SHIPPED]
    for file in files:
        if not Path(file).is_file() and "/" not in file and not file.endswith(".py") and not registry.known(file):
            near = did_you_mean(file, [*SHIPPED, *own])
            if near:
                raise CampaignError("no detector of this name", place=file, remedy=near)
        load(file)
    loaded(files)
    return ids, files
