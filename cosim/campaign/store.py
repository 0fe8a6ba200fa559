"""The folder of a campaign: rows as they come, one consolidated Parquet file, safe against `kill -9` at any moment.

    user_files.json     name and digest of every file of a user's that flies in them
    scenarios.parquet   run, order, toml and every key that varies: written first
    campaign.json       versions and the digest of everything that flies: rows of two of them never mix
    parts/              rows and timing of a few finished runs per file, each appears by an atomic rename
    runs.parquet        one row per run and detector lane, sorted, with the scenario's columns: the result
    timing.parquet      what a clock measured; never the same twice, so it stands apart
    logs/<run>.mcap     logs of runs that were flown again
    manifest.json       what was flown, with which code and seeds, and the SHA-256 of the files of the result

Rows come in any order and may be there twice when a campaign was killed between two files; `rows()` drops the second.
"""

import contextlib
import functools
import hashlib
import itertools
import json
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
from pydantic import TypeAdapter

from actuators.source_hash import closure
from cosim.campaign import parts
from cosim.campaign.parts import ROWS, SCENARIOS, TIMING, table_of, write_blocks
from cosim.errors import CampaignError, CosimError, OutputError
from cosim.files import FULL, SPACE, held, regular, replace_text, sweep
from cosim.scenario.user_parts import UserPart, changed
from cosim.texts import from_json, read

MANIFEST = "manifest.json"
ROOT = Path(__file__).resolve().parents[2]
FLYING = ("actuators", "fdi", "aircraft")  # with what a worker imports of cosim: what decides about a row
USER_FILES = "user_files.json"
TABLES = ("scenarios.parquet", "runs.parquet", "timing.parquet")
FILES = ("campaign.json", *TABLES, MANIFEST, "guests.json", USER_FILES)
DECIDING = (".py", ".json", ".npz", ".toml", ".xml")
GO_ON = "Free space there, then go on with --resume"
KEYS = ("run", "lane", "fault", "status")  # of a row
TOLD = TypeAdapter(list[tuple[str, str, str]])  # key, name and digest of a user's files, in a folder
AGAIN = ("error", "crashed")  # statuses of runs that are flown again on resuming: a full disk or a kill may have passed


@functools.cache
def fingerprint() -> dict:
    """Return {digest, versions} of everything that decides about a row: sources, designs, aircraft, libraries."""
    own = ("worker.py", "flights.py")
    digest = source_digest(FLYING, *(Path(__file__).with_name(name) for name in own))
    return {"digest": digest.hexdigest()[:16], "versions": versions()}


def versions() -> dict[str, str]:
    """Return the versions of the libraries that decide about a row."""
    return {name: version(name) for name in ("jsbsim", "numpy", "scipy", "numba")}


def source_digest(folders: Iterable[str], *modules: Path) -> Any:
    """Return the SHA-256, to be continued, of what decides in `folders` of the repository and of all that `modules`
    import of it."""
    digest = hashlib.sha256()
    files = {p for name in folders for p in (ROOT / name).rglob("*") if p.suffix in DECIDING}
    for path in sorted(files.union(*map(closure, modules))):
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest


@contextlib.contextmanager
def folder(out: str | Path) -> Iterator[None]:
    """Make the folder of a campaign and keep other campaigns out of it; remove what killed ones have left half done.
    Raises OutputError, with what to do, when it cannot be written, now or later, another campaign has it, or it holds a
    foreign file that a campaign would overwrite."""
    out = Path(out)
    try:
        own = _ours(out)
        foreign = [] if own else [name for name in FILES if (out / name).is_file()] + parts.names(out)
        if foreign:
            said = f"holds a {foreign[0]} that no campaign wrote"
            raise OutputError(said, place=str(out), remedy="Choose another place with -o")
        out.mkdir(parents=True, exist_ok=True)
        with held(out):
            for part in (out, out / "parts", out / "logs") if own else ():
                sweep(part)
            yield
    except OutputError as error:
        error.remedy = GO_ON if error.remedy == SPACE else error.remedy
        raise
    except OSError as error:
        remedy = GO_ON if error.errno in FULL else "Choose another place with -o"
        raise OutputError(f"cannot be written: {error.strerror}", place=str(out), remedy=remedy) from None


def _ours(out):
    """Tell whether a folder is a campaign's: something in it can only be of one."""
    with contextlib.suppress(CosimError, FileNotFoundError):
        about = out / "campaign.json"
        told = from_json(read(about, error=CampaignError), place=str(about)) if about.is_file() else None
        if isinstance(told, dict) and set(told) == set(fingerprint()):
            return True
    scenarios = table_of(out / "scenarios.parquet", SCENARIOS, SCENARIOS.names)
    return scenarios is not None or any(parts.whole(out / name, "rows") for name in parts.names(out))


class Store:
    """Rows of a campaign in memory, and in a folder when there is one."""

    def __init__(
        self, out: str | Path | None, scenarios: pd.DataFrame, texts: Iterable[str] = (), *, resume: bool = True,
        anew: bool = False, files: Iterable[tuple[str, UserPart]] = (),
    ):  # fmt: skip
        """Open folder `out` (None for memory only) for `scenarios`, a frame with run, order, ..., of which `texts` are
        the expanded TOML, and in which `files` of a user's fly, (key, UserFile). Raises CampaignError when the folder
        holds rows and `resume` is false, rows of other code, or of a file that has changed, unless such runs are to fly
        `anew`; OutputError when it cannot be written."""
        self.out: Path | None = Path(out) if out else None
        self.scenarios = scenarios
        self._rows: list[dict] = []
        self._timing: list[dict] = []
        self.finished: set[str] = set()
        self.damaged: list[str] = []  # parts of the folder that are left out and flown again
        self.others: dict[str, int] = {}  # rows in the folder of each run that is not in `scenarios`: left out
        if self.out:
            self._open(self.out, iter(texts), resume, anew, list(files))

    def _open(self, out, texts, resume, anew, files):
        here = fingerprint()
        about = out / "campaign.json"
        regular(about, OutputError)
        (out / "parts").mkdir(parents=True, exist_ok=True)
        found = parts.read(out, "rows", KEYS, self.damaged)
        if found is not None and not resume:
            remedy = "Add --resume, or choose another place with -o"
            raise CampaignError(f"holds {found['run'].nunique()} runs already", place=str(out), remedy=remedy)
        if found is not None and about.is_file() and flown_with(out) != here:
            said = "its rows were flown with other code, designs or libraries"
            raise CampaignError(said, place=str(out), remedy="Choose another place with -o")
        told = out / USER_FILES
        regular(told, OutputError)
        if found is not None and not anew and (other := changed(brought_to(out), files)):
            remedy = "Fly its runs again with --anew, or choose another place with -o"
            raise CampaignError(other, place=str(out), remedy=remedy)
        if found is not None:
            wanted = set(self.scenarios["run"])
            self.finished = set(found.loc[~found["status"].isin(AGAIN), "run"]) & wanted
            others = found[~found["run"].isin(wanted)].drop_duplicates(["run", "lane", "fault"])
            self.others = others["run"].value_counts().to_dict()
        replace_text(about, json.dumps(here, indent=1))
        if files or told.exists():
            replace_text(told, json.dumps([[key, *file] for key, file in files], indent=1))
        write_blocks(out / "scenarios.parquet", self._told(texts))

    def _told(self, texts):
        """Yield the tables of scenarios.parquet; `texts` yields the TOML of each."""
        for i in range(0, len(self.scenarios), parts.BLOCK):
            block = self.scenarios.iloc[i : i + parts.BLOCK]
            block.insert(2, "toml", list(itertools.islice(texts, len(block))))
            yield pa.Table.from_pandas(block, preserve_index=False)

    def add(self, rows: list[dict], timing: list[dict]) -> None:
        """Take the rows and timings of some finished runs; they are safe when this returns."""
        if self.out and rows:
            name = hashlib.sha256("".join(sorted({r["run"] for r in rows})).encode()).hexdigest()[:16]
            parts.add(self.out, "timing", name, timing)
            parts.add(self.out, "rows", name, rows)
        else:
            self._rows += rows
            self._timing += timing

    def rows(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return every row as a frame, in the order of the scenarios, with the scenario's columns; of the rows' own,
        `columns` and KEYS alone where given."""
        if self.out is None:
            return _joined(self.scenarios, pa.Table.from_pylist(self._rows, ROWS).to_pandas())
        found = parts.read(self.out, "rows", columns and list(dict.fromkeys([*KEYS, *columns])))
        return _joined(self.scenarios, ROWS.empty_table().to_pandas() if found is None else found)

    def timing(self) -> pd.DataFrame:
        """Return what the clock measured: run, id (null for the whole run), wall_time_s, startup_s, core_s, step_us."""
        if self.out is None:
            return _timed(pa.Table.from_pylist(self._timing, TIMING).to_pandas())
        found = table_of(self.out / "timing.parquet", TIMING, ("run",))
        return (TIMING.empty_table() if found is None else found).to_pandas()

    def consolidate(self, out: Path) -> dict[str, str]:
        """Write runs.parquet in the folder `out` and timing.parquet, both in
        the order of the runs, a block of them at a time; merge the parts into one file each. Return {run: status} of
        every run that has a row."""
        order = dict(zip(self.scenarios["run"], self.scenarios["order"]))
        status: dict[str, str] = {}

        def joined():
            for found in parts.ordered(out, "rows", order):
                about = self.scenarios[self.scenarios["run"].isin(set(found["run"]))]
                frame = _joined(about, found)
                status.update(zip(frame["run"], frame["status"]))
                yield parts.checked(pa.Table.from_pandas(frame, preserve_index=False), ROWS, KEYS[:1])

        def timed():
            yield TIMING.empty_table()
            for found in parts.ordered(out, "timing", order):
                yield pa.Table.from_pandas(_timed(found), TIMING, preserve_index=False)

        write_blocks(out / "runs.parquet", joined())
        write_blocks(out / "timing.parquet", timed())
        for kind in parts.KINDS:
            parts.merge(out, kind)
        return status


def brought_to(folder: Path) -> list[tuple[str, UserPart]]:
    """Return the (key, UserFile) that fly in the runs of a folder, as it says. Raises CampaignError."""
    path = folder / USER_FILES
    if not path.is_file():
        return []
    told = from_json(read(path, error=CampaignError), place=str(path), error=CampaignError)
    return user_files(told, path, CampaignError)


def user_files(told: Any, place: Path, error: type[CosimError]) -> list[tuple[str, UserPart]]:
    """Return the (key, UserFile) of what the file at `place` tells of them, else raise `error`."""
    try:
        return [(key, UserPart(*file)) for key, *file in TOLD.validate_python(told)]
    except ValueError:
        raise error("is damaged: user_files", place=str(place), remedy="Choose another place with -o") from None


def flown_with(folder: Path) -> object:
    """Return what `campaign.json` of a folder says of the code that flew it. Raises CampaignError."""
    about = folder / "campaign.json"
    try:
        return from_json(read(about, error=CampaignError), place=str(about), error=CampaignError)
    except FileNotFoundError:
        raise CampaignError("is missing", place=str(about), remedy="`cosim campaign --resume` writes it anew") from None


def _joined(scenarios, found):
    lost = found["status"].isin(AGAIN)
    found = found[~lost | ~found["run"].isin(found.loc[~lost, "run"])]  # a run that was flown again
    merged = scenarios.merge(found.drop_duplicates(["run", "lane", "fault"]), on="run", how="inner")
    return merged.sort_values(["order", "lane", "fault"], kind="stable").reset_index(drop=True)


def _timed(found):
    return found.drop_duplicates(["run", "id"]).reset_index(drop=True)


def load(folder: str | Path) -> tuple[pd.DataFrame, pd.DataFrame | None]:
    """Return (rows, timing) of a campaign folder as frames: of one that was killed, what was finished by then. Raises
    CampaignError when the folder holds no finished run."""
    folder = Path(folder)
    damaged = []
    if (folder / "runs.parquet").exists():
        table = table_of(folder / "runs.parquet", ROWS, ("run", "order", "lane", "status"))
        told = table_of(folder / "scenarios.parquet", SCENARIOS, SCENARIOS.names)
        if table is not None and (told is None or not {*table["run"].to_pylist()} - {*told["run"].to_pylist()}):
            timing = table_of(folder / "timing.parquet", TIMING, ("run",))
            return table.to_pandas(), None if timing is None else timing.to_pandas()
        damaged.append(str(folder / "runs.parquet"))
    found = parts.read(folder, "rows", damaged=damaged)
    if found is None:
        named = f"; damaged: {', '.join(damaged)}" if damaged else ""
        remedy = "`cosim campaign` makes one, --resume flies again what is lost"
        raise CampaignError(f"holds no whole run of a campaign{named}", place=str(folder), remedy=remedy)
    frame = _joined(_scenarios(folder).drop(columns="toml"), found)
    frame.attrs["damaged"] = damaged
    timing = parts.read(folder, "timing")
    return frame, None if timing is None else _timed(timing)


def scenario_texts(folder: str | Path) -> dict[str, str]:
    """Return {run: TOML of its scenario} of a campaign's folder. Raises CampaignError."""
    found = _scenarios(Path(folder))
    return dict(zip(found["run"], found["toml"]))


def _scenarios(folder):
    found = table_of(folder / "scenarios.parquet", SCENARIOS, SCENARIOS.names)
    if found is None:
        remedy = "`cosim campaign --resume` writes it anew"
        raise CampaignError("is damaged or missing", place=str(folder / "scenarios.parquet"), remedy=remedy)
    return found.to_pandas()


def about_the_code() -> dict:
    """Return {software, commit, changed, versions}; commit is None outside a checkout, `changed` tells of a source that
    differs from it."""
    said = {"software": f"cosim {version('cosim-fdi')}", "versions": fingerprint()["versions"]}
    if not (ROOT / ".git").exists():
        return {**said, "commit": None, "changed": None}
    commit, changed = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no")
    return {**said, "commit": commit or None, "changed": None if changed is None else bool(changed)}


def _git(*words):
    try:
        told = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.strip()


def write_manifest(out: Path, about: dict, brought: Iterable[tuple[str, UserPart]] = ()) -> None:
    """Write the manifest of a finished campaign into its folder `out`: what it tells of itself (`about`: runs, rows,
    seeds, flights per second of a core), the code, and the user's files that flew, (key, UserFile)."""
    about = {
        **about,
        "digest": fingerprint()["digest"],
        **about_the_code(),
        "user_files": [{"key": key, **file._asdict()} for key, file in brought],
        "sha256": {name: sha256(out / name) for name in ("scenarios.parquet", "runs.parquet")},
    }
    regular(out / MANIFEST, OutputError)
    replace_text(out / MANIFEST, json.dumps(about, indent=1))


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
