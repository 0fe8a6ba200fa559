"""What a data set says of itself: Croissant for programs, a datasheet for people, splits that do not leak."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa

from cosim.campaign.dataset.flight import Column
from cosim.campaign.store import about_the_code, fingerprint, sha256

PARQUET = "application/x-parquet"
TEMPLATES = resources.files("cosim") / "templates"


def provenance() -> dict[str, Any]:
    """Return {version, commit, digest, versions} of the code that flies."""
    commit = about_the_code()["commit"] or "unknown, an installed package"
    return {"version": version("cosim-fdi"), "commit": commit, **fingerprint()}


def croissant(about: Mapping[str, Any], index: pa.Table, columns: Mapping[str, Column], path: Path) -> str:
    """Return croissant.json: the files and the columns of both kinds, with the digest of flights.parquet at `path`."""
    kinds = {"string": "sc:Text", "int64": "sc:Integer"}
    rows: dict[str, Column] = {
        f.name: (kinds.get(str(f.type), "sc:Float"), "-", INDEX.get(f.name, f.name)) for f in index.schema
    }
    base = json.loads((TEMPLATES / "croissant.json").read_text(encoding="utf-8"))
    made = {
        **base,
        "name": about["campaign"],
        "description": f"Labelled flights of the campaign {about['campaign']}: actuator, sensor and engine faults of a "
        "transport aircraft in closed loop, simulated, with the truth beside every sample.",
        "license": "https://spdx.org/licenses/MIT.html",
        "version": about["version"],
        "distribution": [
            {"@type": "cr:FileObject", "@id": "index", "name": "index", "contentUrl": path.name,
             "encodingFormat": PARQUET, "sha256": sha256(path)},
            {"@type": "cr:FileSet", "@id": "files", "name": "files", "encodingFormat": PARQUET,
             "includes": "flights/*.parquet"},
        ],
        "recordSet": [
            _records("flights", rows, "fileObject", "index"),
            _records("samples", columns, "fileSet", "files"),
        ],
    }  # fmt: skip
    return json.dumps(made, indent=1) + "\n"


def _records(name, columns, kind, source):
    fields = [
        {"@type": "cr:Field", "@id": f"{name}/{column}", "name": column, "description": f"{meaning} [{unit}]",
         "dataType": of, "source": {kind: {"@id": source}, "extract": {"column": column}}}
        for column, (of, unit, meaning) in columns.items()
    ]  # fmt: skip
    return {"@type": "cr:RecordSet", "@id": name, "name": name, "field": fields}


INDEX = {
    "run": "id of the flight: digest of its scenario",
    "file": "its file, empty where its point has no steady flight",
    "status": "completed, departed, diverged or infeasible",
    "reason": "why it did not complete",
    "rows": "samples",
    "bytes": "size of the file",
    "sha256": "digest of the file",
    "seed": "seed of its noise and gusts",
    "point": "flight point",
    "family": "kinds of its faults, none without one",
    "faults": "its faults in words",
    "scenario": "the whole scenario, TOML",
    "split_point": "train, validation or test; a flight point is in one of them",
    "fold_family": "0 to 4; a family of faults is in one of them",
}


def datasheet(
    about: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], columns: Mapping[str, Column], title: str
) -> str:
    """Return README.md."""
    import jinja2

    families: dict[str, dict[str, int]] = {}
    for row in rows:
        own = families.setdefault(row["family"], {"train": 0, "validation": 0, "test": 0})
        own[row["split_point"]] += 1
    flown = [r for r in rows if r["file"]]
    environment = jinja2.Environment(keep_trailing_newline=True, undefined=jinja2.StrictUndefined)
    return environment.from_string((TEMPLATES / "datasheet.md").read_text(encoding="utf-8")).render(
        about=about, title=title, columns=columns, families=dict(sorted(families.items())), empty=empty(rows),
        flights=len(flown), failed=len(rows) - len(flown), samples=sum(r["rows"] for r in rows),
        bytes=sum(r["bytes"] for r in rows), seeds=(min(r["seed"] for r in rows), max(r["seed"] for r in rows)),
    )  # fmt: skip


SHARES = ("train", "test", "train", "validation", "train")  # of every five points, in the order of their digests
NEEDED = 4  # points, from which on no share is empty
FOLDS = 5


def splits(rows: Sequence[Mapping[str, str]]) -> list[dict[str, object]]:
    """Return {split_point, fold_family} of flights that have a `point`, a `family` and a `run`.

    split_point: all flights of a point are in one of train, validation, test. fold_family, 0 to 4: a family stands in
    one fold, so that a model may be asked for faults that it never saw; flights without a fault are dealt out.
    """
    share = _dealt({r["point"] for r in rows}, len(SHARES))
    fold = _dealt({r["family"] for r in rows} - {"none"}, FOLDS)
    quiet = _dealt({r["run"] for r in rows if r["family"] == "none"}, FOLDS)
    return [
        {"split_point": SHARES[share[r["point"]]], "fold_family": quiet.get(r["run"], fold.get(r["family"], 0))}
        for r in rows
    ]


def empty(rows: Sequence[Mapping[str, object]]) -> list[str]:
    """Return a line for each kind of split that leaves a part of it without a flight: why, and what to do. `rows` have
    `point`, `family`, `split_point` and `fold_family`."""
    told = []
    shares = [name for name in dict.fromkeys(SHARES) if name not in {r["split_point"] for r in rows}]
    if shares:
        points = len({r["point"] for r in rows})
        told.append(
            f"split_point: no flight in {' and '.join(shares)}, as all flights of a point are in one split and the "
            f"campaign has {points} of {NEEDED} points. Vary flight.altitude_ft, flight.cas_kt or flight.mass_t in "
            "[grid] or [draw], or split by fold_family"
        )
    folds = [str(k) for k in range(FOLDS) if k not in {r["fold_family"] for r in rows}]
    if folds:
        families = len({r["family"] for r in rows} - {"none"})
        told.append(
            f"fold_family: no flight in fold {', '.join(folds)}, as a family of faults is in one fold and the campaign "
            f"has {families} of {FOLDS} families. Vary faults in [grid], or use the other folds alone"
        )
    return told


def _dealt(names: Iterable[str], hands: int) -> dict[str, int]:
    """Return {name: number below `hands`}, dealt in the order of the names' digests."""
    order = sorted(names, key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    return {name: i % hands for i, name in enumerate(order)}
