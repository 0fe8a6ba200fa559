"""Replay recordings of real flights: `python tests/helpers/real_flights.py DIR` writes cosim/replay/REAL.md of the sets
below DIR.

The data belong to others and are not part of this project: `SETS` says where each set is and which files are needed.
"""

import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from real_windows import bounds, command_part, sensor_part

import cosim
from cosim.errors import CosimError
from cosim.replay.map import Diagnosis, diagnose, prepare
from cosim.replay.map_file import load_map
from cosim.scenario.vocabulary import words
from fdi import registry

PAGE = Path(cosim.__file__).parent / "replay" / "REAL.md"
MAPS = PAGE.with_name("maps")
TOGETHER = "all"
ROW = "| set | recording | detector | hours | valid % | in alarm % | alarms | per hour, 95 % | largest r | not valid |"
RATE = "| set | detector | valid hours | alarms | per valid hour, 95 % |"
LACK = "| set | recording | detector | why |"


@dataclass(frozen=True)
class Recordings:
    """One set: its map, the names of its files, what marks a folder that is one, where to get it, and whether it has
    deflection, speed and angle of attack for windows of 60 s."""

    title: str
    map: str
    files: tuple[str, ...] = ()
    marks: str = ""
    recipe: str = ""
    windows: bool = False

    @property
    def map_path(self) -> Path:
        """Return the file of its map."""
        return MAPS / f"{self.map}.toml"


SETS = (
    Recordings(
        "ATTAS", "attas",
        tuple(f"fAttas{run}.mat" for run in ("Elv1", "Elv2", "Ail1", "Rud1", "AilRud1", "AilRud2")),
        recipe="github.com/josemiguelbento/UAV-OAT-controlo, RVJategaonkar_codes_2ed/flt_data: companion data of "
        "Jategaonkar, Flight Vehicle System Identification, 2nd edition (author and AIAA)", windows=True,
    ),
    Recordings("ATTAS, stalls", "attas_stall", ("fAttas_qst01.asc", "fAttas_qst02.asc"), recipe="the same folder",
               windows=True),
    Recordings("HFB-320", "hfb320", ("hfb320_1_10.asc",), recipe="the same folder"),
    Recordings("Citation II", "citation", marks="vane_AOA.csv",
               recipe="github.com/SybrenBootsma/SVV-flight-dynamics-B22, matlab/ and matlab/Our-data/ (no licence "
               "stated)", windows=True),
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


def page(folder: Path) -> str:
    """Return the text of the page. A recording on which nothing judges stands there with what is missing."""
    lines: list[str] = []
    failed: list[str] = []
    valid: dict[tuple[str, str], tuple[float, int]] = {}
    told: dict[str, tuple[Recordings, Path, Diagnosis]] = {}
    seconds = 0.0
    for s, path in recordings(folder):
        try:
            found = diagnose(path, s.map_path)
        except CosimError as error:
            failed.append(f"| {s.title} | {path.name} | – | {error.problem}; {error.remedy} |")
            continue
        seconds += found.duration_s
        told.setdefault(s.title, (s, path, found))
        lines += _rows(s, path, found)
        if not any(d["valid_pct"] for d in found.detectors):
            failed += [f"| {s.title} | {path.name} | `{name}` | {why} |" for name, why in _reasons(s, path, found)]
        for d in found.detectors:
            for title in (s.title, TOGETHER):
                hours, alarms = valid.get((title, d["id"]), (0.0, 0))
                hours += found.duration_s * d["valid_pct"] / 3.6e5
                valid[title, d["id"]] = hours, alarms + d["alarms"]
    if not lines and not failed:
        names = ", ".join(name for s in SETS for name in (*s.files, s.marks) if name)
        raise CosimError("holds no recording of these sets", place=str(folder), allowed=names)
    out = [HEAD, "", *(_table(ROW, lines) if lines else [])]
    out += ["", "Valid hours, and alarms in them:", "", *_table(RATE, _rates(valid))]
    most = max((hours for hours, _ in valid.values()), default=0.0)
    if most:
        none = bounds(0, most)[1]
        out += ["", f"With {most:.2f} valid hours, no alarm at all would bound the rate at {none:.2g} per hour."]
    if failed:
        out += ["", "Nothing judges, and what each detector would need there:", "", *_table(LACK, failed)]
    out += ["", "What each set lacks at the level of the aircraft, and what stands in for something else:", ""]
    out += [f"- {title}: {_lacks(s, found)}." for title, (s, _, found) in told.items()]
    out += ["", "Where the sets are:", ""]
    out += [f"- {s.title}: {s.recipe}. Map: [maps/{s.map}.toml](maps/{s.map}.toml)" for s in SETS]
    flown = [(path, s.map_path) for s, path in recordings(folder) if s.windows]
    out += ["", *command_part(flown, seconds), *sensor_part([(path, m) for path, m in flown if m.stem != "attas"])]
    return "\n".join([*out, VARGA])


def _table(head, lines):
    return [head, "|---" * (head.count("|") - 1) + "|", *lines]


def _rows(s: Recordings, path: Path, told: Diagnosis) -> Iterable[str]:
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


def _rates(valid):
    """Yield a line for each set and detector that was valid at all, those of all sets together last."""
    for (title, name), (hours, count) in sorted(valid.items(), key=lambda item: item[0][0] == TOGETHER):
        if hours:
            low, high = bounds(count, hours)
            yield f"| {title} | `{name}` | {hours:.2f} | {count} | {low:.2g} to {high:.2g} |"


def _reasons(s: Recordings, path: Path, told: Diagnosis) -> Iterable[tuple[str, str]]:
    """Yield (detector, why it does not judge): the signals that are missing, or where its design ends."""
    values = prepare(path, s.map_path).values
    for d in told.detectors:
        record, ends = registry.record(d["id"]), []
        for name, (low, high) in record.range.items():
            y = values[name][0][values[name][1] > 0.0] if name in values else np.empty(0)
            if len(y) and not low <= np.median(y) <= high:
                here = f"{name} is {y.min():.3g} to {y.max():.3g} {words()[name].unit}"
                ends.append(f"{here}, its design is for {low:.3g} to {high:.3g}")
        yield d["id"], f"no model: {', '.join(ends) or 'never settled'}; no design for such an aircraft is shipped"
    lacking: dict[str, dict[str, None]] = {}
    for row in told.not_run:
        lacking.setdefault(row["id"], {}).update(dict.fromkeys(n.rpartition(".")[2] for n in row["missing"]))
    for name, signals in lacking.items():
        yield name, f"no signal: {', '.join(signals)}"


def _lacks(s, told):
    lacking = {r["id"]: ", ".join(r["missing"]) for r in told.not_run if r["target"] == "aircraft"}
    proxies = {n: x.stands_on for n, x in load_map(s.map_path)[0].signals.items() if x.stands_on}
    out = [f"`{name}`: {missing}" for name, missing in lacking.items()]
    return "; ".join([*out, *(f"{n} is {what}" for n, what in proxies.items())])


HEAD = """\
# Real flights: what the detectors say about recordings of aircraft

Written by `python tests/helpers/real_flights.py DIR`, DIR being a folder with the sets below in it; the data are not
part of this project. Nothing in these recordings is known to be broken: every alarm counts as a false one.
All of them are of other aircraft than the designs of the detectors (the narrow-body's), so that an alarm
speaks of the model first, and of thresholds learned in simulation second. An elevator command is recorded by
the UAV alone; elsewhere the measured deflection stands in for it. No recorded aircraft has sensors inside an
actuator, so that no actuator-local detector can judge. A detector that is in alarm for nearly all of its
valid time does not fit the recording: its count of alarms says nothing, its share of the time in alarm does.
`kinematic` does not fit: it compares inertial with air data, and one stands in for the other here; between
samples of 10 to 25 Hz that are interpolated to its 200 Hz there is no noise, which it takes for frozen.
Hard cases: quasi-steady stalls (a set of their own), turbulence (HFB-320), and a zero-g parabola of the Citation, in
which pitch rate and attitude leave the range of `rfafe_airframe`: it is not valid there."""

VARGA = """\
## Varga's linear transport

Not a bench here. Its public files (github.com/andreasvarga/FDITools, `fdibook_examples/cs1data.mat`;
FaultDetectionTools.jl, `Examples/cs1data.jld2`) hold eleven linear models of one aircraft at its masses, 22 actuators
and a feedback gain, but no finished filter: the scripts CS1_1 and CS1_2 make theirs when they run, by EFDISYN of that
toolbox. `compare` takes rows of flights and logs, with sensors, noise and a catalogue of faults, none of which a linear
model has: its filters would be judged on other terms than every detector here.
"""

if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit("python tests/helpers/real_flights.py DIR: a folder with recordings of real flights")
    PAGE.write_text(page(Path(sys.argv[1])), encoding="utf-8")
    print(f"wrote  {PAGE}")
