"""Replay recordings of real flights: `python -m cosim.replay.real DIR` writes REAL.md here from the sets below DIR.

The data belong to others and are not part of this project: `SETS` says where each set is and which files are needed.
"""

import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.errors import CosimError
from cosim.replay.map import Diagnosis, diagnose
from cosim.replay.map_file import load_map

PAGE = Path(__file__).with_name("REAL.md")
MAPS = Path(__file__).with_name("maps")
LEVEL = 0.95  # of the intervals of alarms per hour
HEAD = "| set | recording | detector | hours | valid % | in alarm % | alarms | per hour, 95 % | largest r | not valid |"


@dataclass(frozen=True)
class Recordings:
    """One set: its map, the names of its files, what marks a folder that is one, and where to get it."""

    title: str
    map: str
    files: tuple[str, ...] = ()
    marks: str = ""
    recipe: str = ""


SETS = (
    Recordings(
        "ATTAS", "attas",
        tuple(f"fAttas{run}.mat" for run in ("Elv1", "Elv2", "Ail1", "Rud1", "AilRud1", "AilRud2")),
        recipe="github.com/josemiguelbento/UAV-OAT-controlo, RVJategaonkar_codes_2ed/flt_data: companion data of "
        "Jategaonkar, Flight Vehicle System Identification, 2nd edition (author and AIAA)",
    ),
    Recordings("ATTAS, stalls", "attas_stall", ("fAttas_qst01.asc", "fAttas_qst02.asc"), recipe="the same folder"),
    Recordings("HFB-320", "hfb320", ("hfb320_1_10.asc",), recipe="the same folder"),
    Recordings("Citation II", "citation", marks="vane_AOA.csv",
               recipe="github.com/SybrenBootsma/SVV-flight-dynamics-B22, matlab/ and matlab/Our-data/ (no licence "
               "stated)"),
    Recordings("Twin Otter", "twin_otter", ("totter_lon_data.mat",),
               recipe="as ATTAS, RefIdent/SIDPAC (usage agreement of SIDPAC)"),
    Recordings("OAT UAV", "oat", ("ProcessedData_2022_05_07_11_13_57.mat",),
               recipe="as ATTAS, get_coeffs/flight_data_1 (no licence stated)"),
)  # fmt: skip


def recordings(folder: Path) -> list[tuple[Recordings, Path]]:
    """Return (set, file or folder) of every recording of the sets below `folder`."""
    out = []
    for s in SETS:
        found = [f for name in s.files for f in sorted(folder.rglob(name))[:1]]
        found += sorted(f.parent for f in folder.rglob(s.marks)) if s.marks else []
        out += [(s, f) for f in found]
    return out


def bounds(count: int, hours: float) -> tuple[float, float]:
    """Return the exact interval of a Poisson rate per hour, at LEVEL: one-sided where nothing was counted."""
    from scipy.stats import chi2

    if hours <= 0.0:
        return 0.0, float("inf")
    tail = (1.0 - LEVEL) / 2.0 if count else 1.0 - LEVEL
    low = chi2.ppf(tail, 2 * count) / 2.0 if count else 0.0
    return float(low) / hours, float(chi2.ppf(1.0 - tail, 2 * (count + 1))) / 2.0 / hours


def rows(s: Recordings, path: Path, told: Diagnosis) -> Iterable[str]:
    """Yield the lines of one recording: a detector each."""
    for d in told.detectors:
        hours = told.duration_s / 3600.0
        low, high = bounds(d["alarms"], hours * d["valid_pct"] / 100.0)
        mine = [c for c in told.caveats if c.startswith(f"{d['id']} of ")]
        found = (re.search(r": (.* for \S+ s) of .*not valid there", c) for c in mine)
        why = "; ".join(f[1] for f in found if f) or "–"
        yield (
            f"| {s.title} | {path.name} | `{d['id']}` | {hours:.3f} | {d['valid_pct']:.0f} | "
            f"{d['alarm_pct']:.0f} | {d['alarms']} | "
            f"{low:.2g} to {high:.2g} | {d['r_max']:.3g} | {why} |"
        )


def page(folder: Path) -> str:
    """Return the text of the page. A recording on which nothing judges stands there with what is missing."""
    lines: list[str] = []
    failed: list[str] = []
    valid: dict[str, tuple[float, int]] = {}
    notes: dict[str, str] = {}
    for s, path in recordings(folder):
        try:
            told = diagnose(path, MAPS / f"{s.map}.toml")
        except CosimError as error:
            failed.append(f"| {s.title} | {path.name} | {error.problem}; {error.remedy} |")
            continue
        lines += rows(s, path, told)
        if not any(d["valid_pct"] for d in told.detectors):
            why = "; ".join(c for c in told.caveats if "not valid there" in c)
            failed.append(f"| {s.title} | {path.name} | no detector is ever valid: {why} |")
        for d in told.detectors:
            hours, alarms = valid.get(d["id"], (0.0, 0))
            valid[d["id"]] = hours + told.duration_s * d["valid_pct"] / 3.6e5, alarms + d["alarms"]
        lacking = {r["id"]: ", ".join(r["missing"]) for r in told.not_run if r["target"] == "aircraft"}
        notes[s.title] = "; ".join(f"`{name}`: {missing}" for name, missing in lacking.items())
        proxies = {n: x.stands_on for n, x in load_map(MAPS / f"{s.map}.toml")[0].signals.items() if x.stands_on}
        notes[s.title] += "".join(f"; {n} is {what}" for n, what in proxies.items())
    if not lines and not failed:
        raise CosimError("holds no recording of these sets", place=str(folder), allowed=_files())
    table = [HEAD, "|---" * HEAD.count(" | ") + "|---|", *lines] if lines else []
    return "\n".join([*_head(), *table, *_tail(valid, notes, failed)])


def _files():
    return ", ".join(name for s in SETS for name in (*s.files, s.marks) if name)


def _head():
    return [
        "# Real flights: what the detectors say about recordings of aircraft",
        "",
        "Written by `python -m cosim.replay.real DIR`, DIR being a folder with the sets below in it; the data are not",
        "part of this project. Nothing in these recordings is known to be broken: every alarm counts as a false one.",
        "All of them are of other aircraft than the designs of the detectors (the narrow-body's), so that an alarm",
        "speaks of the model first, and of thresholds learned in simulation second. An elevator command is recorded by",
        "the UAV alone; elsewhere the measured deflection stands in for it. No recorded aircraft has sensors inside an",
        "actuator, so that no actuator-local detector can judge. A detector that is in alarm for nearly all of its",
        "valid time does not fit the recording: its count of alarms says nothing, its share of the time in alarm does.",
        "`kinematic` does not fit: it compares inertial with air data, and one stands in for the other here; between",
        "samples of 10 to 25 Hz that are interpolated to its 200 Hz there is no noise, which it takes for frozen.",
        "",
    ]  # fmt: skip


def _tail(valid: dict[str, Any], notes: dict[str, str], failed: list[str]) -> list[str]:
    out = ["", "Together:", "", "| detector | valid hours | alarms | per valid hour, 95 % |", "|---|---|---|---|"]
    for name, (hours, count) in valid.items():
        low, high = bounds(count, hours)
        out.append(f"| `{name}` | {hours:.2f} | {count} | {low:.2g} to {high:.2g} |")
    short = max((hours for hours, _ in valid.values()), default=0.0)
    if short:
        none = bounds(0, short)[1]
        out += ["", f"With {short:.2f} valid hours, no alarm at all would bound the rate at {none:.2g} per hour."]
    if failed:
        out += ["", "Nothing judges:", "", "| set | recording | why |", "|---|---|---|", *failed]
    out += ["", "What each set lacks, and what stands in for something else:", ""]
    out += [f"- {title}: {text}." for title, text in notes.items()]
    out += ["", "Where the sets are:", ""]
    out += [f"- {s.title}: {s.recipe}. Map: [maps/{s.map}.toml](maps/{s.map}.toml)" for s in SETS]
    return [*out, ""]


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit("python -m cosim.replay.real DIR: a folder with recordings of real flights")
    from cosim.replay import real_commands, real_sensors

    parts = [part.page(Path(sys.argv[1])) for part in (real_commands, real_sensors)]
    PAGE.write_text("\n".join([page(Path(sys.argv[1])), *filter(None, parts)]), encoding="utf-8")
    print(f"wrote  {PAGE}")
