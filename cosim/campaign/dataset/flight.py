"""One flight of a data set, in a worker: a scenario in, a Parquet file of signals and labels out.

A signal is NaN while its sensor is invalid, and in a flight whose actuator has none. Samples are every n-th tick as it
was flown, without a filter.
"""

import hashlib
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pydantic import BaseModel, ConfigDict, Field

import cosim.flight.loop.signals
from cosim.campaign.parts import write
from cosim.errors import CampaignError, TrimError, did_you_mean
from cosim.flight.faults.conditions import resolved
from cosim.flight.faults.inject import lanes
from cosim.scenario import Scenario, parse
from cosim.scenario.vocabulary import Signal, find, words


def every(scenario: Scenario, rate_hz: float) -> int:
    """Return how many ticks lie between two samples. Raises CampaignError."""
    n = scenario.rate_hz / rate_hz if rate_hz > 0 else 0.0
    if n < 1 or abs(n - round(n)) > 1e-9:
        allowed = ", ".join(f"{scenario.rate_hz / k:g}" for k in (1, 2, 4, 5, 10, 20))
        said = f"the flights run at {scenario.rate_hz:g} Hz, of which it must be a whole part"
        raise CampaignError(said, place=f"--rate {rate_hz:g}", allowed=f"{allowed}, ... Hz")
    return round(n)


def fly(folder: str, run: str, toml: str, signals: list[str], every: int) -> dict[str, Any]:
    """Fly a scenario and its healthy twin, write flights/<run>.parquet; return what is known of the file.

    That is {file, status, reason, rows, bytes, sha256}. A point without a steady flight has no file and the status
    "infeasible".
    """
    given = parse(tomllib.loads(toml))
    none = {"file": "", "status": "infeasible", "rows": 0, "bytes": 0, "sha256": ""}
    try:
        quiet = given.detectors.model_copy(update={"enabled": ()})  # but those that a servo closes on
        scenario = resolved(given.model_copy(update={"detectors": quiet}))
        flown = cosim.flight.loop.signals.fly(scenario, _sources(scenario, signals))
        healthy = _healthy(scenario)
    except TrimError as error:
        return {**none, "reason": str(error)}
    table = _table(scenario, flown, healthy, signals)[::every]
    path = Path(folder) / "flights" / f"{run}.parquet"
    write(path, _arrow(table, described([given], signals)))
    held = path.read_bytes()
    return {"file": f"flights/{run}.parquet", "status": flown.attrs["status"], "reason": flown.attrs["reason"],
            "rows": len(table), "bytes": len(held), "sha256": hashlib.sha256(held).hexdigest()}  # fmt: skip


class _Told(BaseModel):
    """What `fly` tells of a file."""

    model_config = ConfigDict(strict=True, extra="forbid")

    file: Annotated[str, Field(pattern=r"^(flights/[0-9a-f]+\.parquet)?$")]
    status: str
    reason: str
    rows: Annotated[int, Field(ge=0)]
    bytes: Annotated[int, Field(ge=0)]
    sha256: str


def told(value: Any) -> dict[str, Any]:
    """Return what `fly` told of a file; raises ValueError for anything else."""
    return _Told.model_validate(value).model_dump()


def whole(folder: Path, done: dict[str, Any]) -> bool:
    """Tell whether the file of a flight that was flown is still what it was."""
    path = folder / done["file"]
    return not done["file"] or (path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == done["sha256"])


def _has(scenario, name):
    """Tell whether the flight has the signal of a column."""
    segment, _, word = name.rpartition(".")
    return not segment or scenario.elevator.technology.get(segment) in words()[word].technologies


def _sources(scenario, signals):
    """Return the bus names of signals, their flags, what tells a fault's state, and the deflections."""
    found = [find(name) for name in signals if _has(scenario, name)]
    faults = [f"faults.{lane.name}.{field}" for lane in lanes(scenario) for field in ("active", "f_inj")]
    every = [*(s.source for s in found), *(s.flag for s in found if s.flag), *faults, *achieved(scenario).values()]
    return list(dict.fromkeys(every))


def _healthy(scenario):
    """Return the deflections of the flight without its faults; None where it has none."""
    if not scenario.faults:
        return None
    twin = scenario.model_copy(update={"title": "", "faults": ()})
    return cosim.flight.loop.signals.fly(twin, list(achieved(scenario).values()))


def _table(scenario, flown, healthy, signals):
    """Return every tick's columns but their types."""
    out: dict[str, Any] = {"t_s": flown.index.to_numpy()}
    for name in signals:
        if not _has(scenario, name):
            out[name] = np.full(len(flown), np.nan)
            continue
        signal = find(name)
        values = flown[signal.source].to_numpy(copy=True)
        if signal.flag:
            values[flown[signal.flag].to_numpy() < 0.5] = np.nan
        out[name] = values
    out |= _labels(scenario, flown)
    for name, source in achieved(scenario).items():
        n = len(flown) if healthy is None else min(len(flown), len(healthy))
        out[name] = np.full(len(flown), np.nan)  # beyond the end of a twin that departed
        out[name][:n] = 0.0 if healthy is None else flown[source].to_numpy()[:n] - healthy[source].to_numpy()[:n]
    return pd.DataFrame(out)


def _labels(scenario, flown):
    """Return the columns that say which faults act."""
    own: dict[int, list[str]] = {}
    for lane in lanes(scenario):
        own.setdefault(lane.fault, []).append(f"faults.{lane.name}")
    acts = {i: np.any([flown[f"{b}.active"] > 0.5 for b in buses], axis=0) for i, buses in own.items()}
    n = len(flown)
    kind, place, injected = np.full(n, "", object), np.full(n, "", object), np.zeros(n)
    for i, on in acts.items():
        fault = scenario.faults[i]
        at = fault.target + (f"@{fault.at}" if fault.at else "")
        injected[on & (kind == "")] = flown[f"{own[i][0]}.f_inj"].to_numpy()[on & (kind == "")]
        for column, word in ((kind, fault.kind), (place, at)):
            column[on] = np.where(column[on] == "", word, column[on] + f"+{word}")
    active = np.sum(list(acts.values()), axis=0) if acts else np.zeros(n)
    return {"faults_active": active, "fault_kind": kind, "fault_place": place, "fault_injected": injected}


def _arrow(table, columns):
    """Return the table with its types, and unit and meaning beside each column."""
    kinds = {"sc:Integer": pa.int8(), "sc:Text": pa.string(), "sc:Float": pa.float32()}
    about = {name: {"unit": unit, "meaning": meaning} for name, (_, unit, meaning) in columns.items()}
    fields = [pa.field(name, pa.float64() if name == "t_s" else kinds[kind], metadata=about[name])
              for name, (kind, *_) in columns.items() if name in table]  # fmt: skip
    arrays = [pa.array(table[f.name].to_numpy()).cast(f.type) for f in fields]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


Column = tuple[str, str, str]  # type in Croissant, unit, meaning

LABELS: dict[str, Column] = {
    "faults_active": ("sc:Integer", "-", "number of faults that act at this sample"),
    "fault_kind": ("sc:Text", "-", "kind of the fault that acts, of several joined by +, empty without one"),
    "fault_place": ("sc:Text", "-", "its target, and behind @ where it enters"),
    "fault_injected": ("sc:Float", "of the place", "its signal, where it enters"),
}


def known(scenarios: Iterable[Scenario]) -> dict[str, Signal]:
    """Return {column: Signal} of what the flights have; a word of an actuator for each segment that has it."""
    out: dict[str, Signal] = {}
    technologies: dict[str, set[str]] = {}
    for scenario in scenarios:
        for segment, technology in scenario.elevator.technology.items():
            technologies.setdefault(segment, set()).add(technology)
    for word, signal in words().items():
        if not signal.technologies:
            out[word] = signal
        else:
            lanes = (seg for seg, has in technologies.items() if has & set(signal.technologies))
            out |= {f"{seg}.{word}": signal.at(seg) for seg in lanes}
    return out


def chosen(scenarios: Sequence[Scenario], signals: Sequence[str]) -> list[str]:
    """Return the columns that `signals` mean, all without any. Raises CampaignError."""
    if not scenarios:
        raise CampaignError("no flight is left", place="--limit", allowed="1 or more")
    there = known(scenarios)
    out: list[str] = []
    for name in signals or there:
        found = [c for c in there if c == name or c.partition(".")[2] == name]
        if not found:
            near = did_you_mean(name, [*there, *words()])
            raise CampaignError("no flight of this campaign has it", place=f"--signal {name}", remedy=near)
        out += found
    return sorted(dict.fromkeys(out))


def achieved(scenario: Scenario) -> dict[str, str]:
    """Return {column: bus name} of the elevator deflections whose difference from the healthy flight is a label."""
    return {f"achieved_{seg}": f"{tech}.{seg}.delta" for seg, tech in scenario.elevator.technology.items()}


def described(scenarios: Sequence[Scenario], signals: Sequence[str]) -> dict[str, Column]:
    """Return {column: (type, unit, meaning)} of a flight's file, in its order."""
    there = known(scenarios)
    made = "deflection less that of the same flight without faults, trailing edge down +"
    return {
        "t_s": ("sc:Float", "s", "time since the start"),
        **{name: ("sc:Float", there[name].unit, there[name].meaning) for name in signals},
        **LABELS,
        **{name: ("sc:Float", "rad", made) for s in scenarios for name in achieved(s)},
    }
