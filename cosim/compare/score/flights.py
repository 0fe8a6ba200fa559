"""The flights of the benchmark: which they are, and their thin recordings in the user's cache, flown where missing."""

import functools
import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from actuators.source_hash import private
from cosim.campaign.jobs import FILE, keep, own, stored, work
from cosim.campaign.spec import load_campaign
from cosim.campaign.store import about_the_code, source_digest, versions
from cosim.campaign.worker import core_s, run_id
from cosim.errors import CampaignError, CosimError, OutputError, TrimError
from cosim.files import regular, replace_text
from cosim.replay import benchmark_recording
from cosim.scenario import parse
from cosim.texts import from_json, read, toml

NAME = "benchmark-1"
QUICK = 40  # flights of a first look
MANIFEST = "manifest.json"


@dataclass(frozen=True)
class RecordedFlight:
    """One flight of the benchmark: its run, family ("no fault" without one), scenario, and recording when it is flown.

    `told` is what `cosim.replay.benchmark_recording.record` returned, or {status, reason} of a point without a steady
    flight.
    """

    run: str
    family: str
    toml: str
    path: Path
    told: dict


class _Told(BaseModel):
    """What a folder of recordings says of one."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    status: str
    reason: str
    sim_time_s: Annotated[float, Field(ge=0.0)] = 0.0
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] = ""
    content: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] = ""
    bytes: Annotated[int, Field(ge=0)] = 0
    core_s: Annotated[float, Field(ge=0.0)] = 0.0


def _told(value: dict) -> dict[str, Any]:
    """Return what a folder says of a recording; raises ValueError where it is not of `recorded`."""
    return _Told.model_validate(value).model_dump(exclude_unset=True)


@dataclass(frozen=True)
class Seeds:
    """Seeds of the draws and of the first flight; `sealed` where they are not those that everybody has."""

    draws: int
    first: int
    sealed: bool = False

    @property
    def digest(self) -> str:
        """Return 12 hex digits that tell sealed seeds from others without telling them."""
        return hashlib.sha256(f"{self.draws} {self.first}".encode()).hexdigest()[:12]


def seeds_of(path: str | Path | None = None) -> Seeds:
    """Return the public seeds of the benchmark, or those of a TOML file with `seed` and `first_seed`. Raises
    CampaignError."""
    made = load_campaign(NAME)
    if path is None:
        return Seeds(made.seed, made.first_seed)
    try:
        table = toml(read(path, error=CampaignError), place=str(path), error=CampaignError)
    except FileNotFoundError:
        raise CampaignError("no such file", place=str(path), allowed="a TOML file with seed and first_seed") from None
    given = {k: table.get(k) for k in ("seed", "first_seed")}
    if set(table) != set(given) or not all(type(v) is int and 0 <= v < 2**31 - 10**6 for v in given.values()):
        raise CampaignError("holds no seeds", place=str(path), allowed="seed and first_seed, whole numbers from 0 on")
    return Seeds(table["seed"], table["first_seed"], sealed=True)


@functools.lru_cache(maxsize=4)
def scenarios(seeds: Seeds) -> list[tuple[str, str, str]]:
    """Return [(run, family, TOML)] of every flight, in order."""
    made = replace(load_campaign(NAME), seed=seeds.draws, first_seed=seeds.first)
    return [(run_id(s), label["part"], s.expanded_toml()) for s, label in zip(*made.scenarios())]


def chosen(flights: list, limit: int | None) -> list:
    """Return `limit` of the flights, evenly over the whole list and so over the families; all without a limit."""
    if limit is None or limit >= len(flights):
        return flights
    if limit < 1:
        raise CampaignError(f"{limit} flights", place="--limit", allowed=f"1 to {len(flights)}")
    return [flights[(2 * i + 1) * len(flights) // (2 * limit)] for i in range(limit)]


@functools.cache
def code() -> str:
    """Return the digest of all that decides about a recording: sources of a flight, aircraft, libraries."""
    found = source_digest(("actuators", "aircraft"), Path(benchmark_recording.__file__))
    found.update(json.dumps(versions()).encode())
    return found.hexdigest()[:16]


def cache(seeds: Seeds) -> Path:
    """Return the folder of the recordings in the user's cache, to which nobody else may write. Raises OutputError."""
    name, roots = f"{NAME}-{seeds.digest}", [Path(d) for d in (os.environ.get("XDG_CACHE_HOME"),) if d]
    with suppress(RuntimeError):  # a user without a home
        roots.append(Path.home() / ".cache")
    for root in roots:
        folder = root / "cosim-recordings"
        if private(folder) and private(folder / name) and os.access(folder / name, os.W_OK):
            return folder / name
    raise OutputError("no cache folder is yours alone", place="cosim-recordings", remedy="Name one: --recordings DIR")


def flown(
    seeds: Seeds, *, limit: int | None = None, folder: str | Path | None = None, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[RecordedFlight]:  # fmt: skip
    """Return the flights, flown where `folder` (default: the user's cache) does not hold them yet.

    A killed run goes on where it was; recordings of other code are taken over where they repeat (`adopt`). Raises
    OutputError, CampaignError.
    """
    home = Path(folder) if folder else cache(seeds)
    _own(home)
    todo = chosen(scenarios(seeds), limit)
    adopt(home, todo)
    out = fly_into(home, todo, workers=workers, progress=progress)
    replace_text(home / MANIFEST, json.dumps(manifest(seeds, out), indent=1))
    return out


def _own(home):
    """Raise OutputError where a foreign file stands under one of our names."""
    own(home / FILE)
    path = home / MANIFEST
    regular(path, OutputError)
    told = None
    with suppress(CosimError, FileNotFoundError):
        told = from_json(read(path, error=OutputError), place=str(path))
    if path.exists() and not (isinstance(told, dict) and told.get("benchmark") == NAME):
        raise OutputError("holds something else", place=str(path), remedy="Choose another folder")


def adopt(home: Path, flights: Iterable[tuple[str, str, str]]) -> bool | None:
    """Take over the recordings in `home` that other code flew, where one flight of each family repeats to the bit.
    Returns whether they do, None where there is nothing to ask. Those that do not are flown again by `fly_into`."""
    flown_by, values = stored(home)
    if not values or flown_by == code():
        return None
    held = {}
    for key, told in values.items():
        with suppress(ValueError, TypeError, KeyError, IndexError):  # what is no recording's
            held[json.loads(key)[1]["toml_text"]] = _told(told).get("content")
    sample = {family: text for _, family, text in flights if held.get(text)}
    with tempfile.TemporaryDirectory() as aside:
        for text in sample.values():
            if recorded(text, "again.parquet", aside).get("content") != held[text]:
                return False
    if sample:
        keep(home, code(), values)
    return bool(sample)


def fly_into(home: Path, flights: Iterable[tuple[str, str, str]], **how: Any) -> list[RecordedFlight]:
    """Return the Flights (run, family, TOML), recorded in folder `home` where they are not yet. `how`: see
    `cosim.campaign.jobs.work`."""
    todo = list(flights)
    jobs = [(recorded, {"toml_text": text, "name": f"{run}.parquet", "folder": str(home.resolve())})
            for run, _, text in todo]  # fmt: skip
    told = work(jobs, **{**how, "folder": home, "code": code(), "read": _told})
    return [RecordedFlight(run, family, text, home / f"{run}.parquet", t) for (run, family, text), t in zip(todo, told)]


def recorded(toml_text: str, name: str, folder: str) -> dict:
    """Fly one scenario into `folder`/`name`; return what is told of the recording."""
    begin = core_s()
    try:
        told = benchmark_recording.record(parse(toml(toml_text, place=name)), Path(folder) / name)
    except TrimError as error:
        return {"status": "infeasible", "reason": str(error)}
    return {**told, "core_s": core_s() - begin}


def manifest(seeds: Seeds, flights: list[RecordedFlight]) -> dict:
    """Return what says which recordings these are: code, commit, seeds (a sealed set's digest), every file's SHA-256.
    `content` is one digest over the values of all flights, whatever the version of the library that wrote the files."""
    whole = hashlib.sha256("".join(f.told.get("content", "none") for f in flights).encode())
    given = {"digest": seeds.digest} if seeds.sealed else {"seed": seeds.draws, "first_seed": seeds.first}
    return {
        "benchmark": NAME, "flights": len(flights), "seeds": given, "content": whole.hexdigest()[:16],
        "bytes": sum(f.told.get("bytes", 0) for f in flights),
        "flown_core_s": sum(f.told.get("core_s", 0.0) for f in flights), "digest": code(), **about_the_code(),
        "sha256": {} if seeds.sealed else {f.path.name: f.told.get("sha256") for f in flights},
    }  # fmt: skip
