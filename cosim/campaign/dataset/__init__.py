"""A labelled data set of a campaign: a Parquet file per flight, labels per sample, splits, metadata, a datasheet.

    flights.parquet          a row per flight: run, status, file, SHA-256, family of fault, splits, its whole scenario
    flights/<run>.parquet    a row per sample: t_s, signals, labels; units stand in the columns' metadata
    croissant.json           what every column means, for programs (Croissant 1.0)
    README.md                the same for people: where it comes from, how to make it again, what it is not
    dataset.json             what it was made of; the folder of another one is not touched

The flights and their bytes follow from campaign, signals, rate and code alone. What a killed call has flown is kept.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from cosim.campaign import jobs
from cosim.campaign.dataset import flight
from cosim.campaign.dataset.flight import chosen, described
from cosim.campaign.dataset.metadata import croissant, datasheet, empty, provenance, splits
from cosim.campaign.flights import flatten
from cosim.campaign.parts import write
from cosim.campaign.spec import load_campaign
from cosim.campaign.store import user_files
from cosim.campaign.worker import run_id
from cosim.errors import OutputError
from cosim.files import replace_text
from cosim.scenario import Scenario
from cosim.scenario.flight import AIR
from cosim.scenario.user_parts import changed
from cosim.texts import from_json, read

ABOUT = "dataset.json"


def make(
    campaign: str | Path, out: str | Path, *, signals: Sequence[str] = (), rate_hz: float = 50.0,
    limit: int | None = None, anew: bool = False, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Fly `campaign` into the data set at `out`; return {folder, flights, failed, samples, bytes, bytes_per_flight,
    notes}: notes are lines about splits that are empty.

    `signals`: words of `cosim list signals`, one of an actuator for all segments, or `left_inner.rod` for one; by
    default all. `rate_hz` is the flights' rate or a whole part of it. `limit` takes the first flights only. A
    folder that was made with a user's file that has changed since is refused, or with `anew` flown again. Raises
    CampaignError (a word, a rate, no flight), OutputError (a folder of something else, a full disk).
    """
    made = load_campaign(campaign)
    scenarios, labels = made.scenarios()
    both = zip(scenarios, labels or [{}] * len(scenarios))
    pairs = list({run_id(s): (s, label) for s, label in both}.items())[:limit]
    flown = [s for _, (s, _) in pairs]
    words = chosen(flown, signals)
    runs = hashlib.sha256("".join(run for run, _ in pairs).encode()).hexdigest()[:16]
    about: dict[str, Any] = {"campaign": Path(str(campaign)).stem, "runs": runs, "signals": words, "rate_hz": rate_hz}
    about["user_files"] = [[key, *f] for key, f in dict.fromkeys(f for s in flown for f in s.user_parts.items())]
    every = [flight.every(s, rate_hz) for s in flown]
    folder = _open(Path(out), about, anew)
    home = str(folder.resolve())
    todo: list = [(flight.fly, {"folder": home, "run": run, "toml": s.expanded_toml(), "signals": words, "every": n})
                  for n, (run, (s, _)) in zip(every, pairs)]  # fmt: skip
    done = jobs.work(todo, folder=folder / ".work", workers=workers, progress=progress, read=flight.told)
    done = [d if flight.whole(folder, d) else work(**given) for d, (work, given) in zip(done, todo)]
    rows = [_row(run, s, label, d) for (run, (s, label)), d in zip(pairs, done)]
    rows = [{**row, **split} for row, split in zip(rows, splits(rows))]
    index = pa.Table.from_pylist(rows)
    write(folder / "flights.parquet", index)
    for path in set((folder / "flights").glob("*.parquet")) - {folder / d["file"] for d in done} if anew else ():
        path.unlink()
    more = [f"--signal {name}" for name in signals] + ([f"--limit {limit}"] if limit else [])
    command = " ".join(["cosim dataset", str(campaign), f"--rate {rate_hz:g}", *more, "-o DIR"])
    about |= {"command": command, **provenance()}
    columns = described(flown, words)
    replace_text(folder / "croissant.json", croissant(about, index, columns, folder / "flights.parquet"))
    replace_text(folder / "README.md", datasheet(about, rows, columns, made.title))
    replace_text(folder / ABOUT, json.dumps(about, indent=1) + "\n")
    size, number = sum(d["bytes"] for d in done), sum(d["file"] != "" for d in done)
    return {"folder": str(folder), "flights": number, "failed": len(done) - number, "bytes": size,
            "samples": sum(d["rows"] for d in done), "bytes_per_flight": size // max(1, number),
            "notes": empty(rows)}  # fmt: skip


def _open(folder: Path, wanted: dict[str, Any], anew: bool) -> Path:
    """Return the folder, made where it is not there. Raises OutputError when it holds anything else, or was made with a
    user's file that has changed, unless it is to be flown `anew`."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = {p.name for p in folder.iterdir()}
    except OSError as error:
        remedy = "Choose another place with -o"
        raise OutputError(f"cannot be written: {error.strerror}", place=str(folder), remedy=remedy) from None
    if ABOUT in held:
        found = from_json(read(folder / ABOUT, error=OutputError), place=str(folder / ABOUT), error=OutputError)
        found = found if isinstance(found, dict) else {}
        brought = (user_files(told.get("user_files", []), folder / ABOUT, OutputError) for told in (found, wanted))
        other = changed(*brought)
        if other and not anew:
            remedy = "Fly it again with --anew, or choose another place with -o"
            raise OutputError(other, place=str(folder), remedy=remedy)
        kept = wanted.keys() - ({"runs", "user_files"} if other else set())
        same = all(found.get(key, [] if key == "user_files" else None) == wanted[key] for key in kept)
        held -= {ABOUT} if same and other else set()
    else:
        same = not held - {".work", "flights"}
    if not same:
        raise OutputError("holds something else", place=str(folder), remedy="Choose another place with -o")
    if ABOUT not in held:
        replace_text(folder / ABOUT, json.dumps(wanted, indent=1) + "\n")
    return folder


def _row(run: str, scenario: Scenario, label: dict[str, Any], done: dict[str, Any]) -> dict[str, Any]:
    """Return the row of a flight in flights.parquet, without its splits."""
    faults = scenario.faults
    point = label.get("point") or json.dumps(flatten(scenario.flight.model_dump(exclude=set(AIR))))
    return {
        "run": run, **done, "seed": scenario.seed, "point": str(point),
        "family": "+".join(sorted({f.kind for f in faults})) or "none",
        "faults": "; ".join(f"{f.kind} on {f.target} from {f.start_s:g} s" for f in faults),
        "turbulence": scenario.flight.turbulence, "manoeuvre": scenario.manoeuvre.kind,
        "scenario": scenario.portable_toml(aircraft=False),
    }  # fmt: skip
