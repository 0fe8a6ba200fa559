"""Rows of a score, every detector run on every recording and judged as a flight is, and the table made of them."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from cosim.campaign.flights import table
from cosim.campaign.parts import TIMING
from cosim.campaign.pool import finished
from cosim.campaign.store import Store
from cosim.campaign.worker import failed
from cosim.compare import pod, stats
from cosim.compare import rows as compare_rows
from cosim.compare.score.flights import RecordedFlight
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.faults.inject import lanes as fault_lanes
from cosim.judge import coverage
from cosim.judge import row as judged
from cosim.judge.result import SETTLE_S
from cosim.replay import benchmark_recording
from cosim.scenario import Scenario, parse
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.texts import toml
from fdi import registry
from fdi.common.verdict import NAMES

MOST_LANES = 1000  # of a detector: the lanes of a run are numbered through
LOG = ("run", "id", "lane", "log_fault", "log_none")  # ln p of the fault while it lasts, of "none" before and without


@dataclass
class Scored:
    """Rows per run, detector and fault (cosim/compare/rows.py) with `part` of the benchmark, `size` and `unit`; what
    the clock measured; log scores per run and lane."""

    rows: pd.DataFrame
    timing: pd.DataFrame
    logs: pd.DataFrame
    lanes: pd.DataFrame  # rows per lane, with the columns of a campaign (cosim/campaign)
    lost: dict[str, str] = field(default_factory=dict)  # {file: how its detector ended its process}


def scored(
    flights: Sequence[RecordedFlight], ids: Sequence[str], files: Iterable[str | Path] = (), *,
    workers: int | None = None, progress: Callable[[int, int], None] | None = None,
) -> Scored:  # fmt: skip
    """Run the detectors `ids` that ship and those of `files` on the recordings of `flights`; return the Scored. Raises
    LogError, GuestError, ScenarioError."""
    files = [str(Path(f).resolve()) if Path(f).is_file() else str(f) for f in files]
    rows: list[dict] = []
    timing: list[dict] = []
    logs: list[dict] = []
    lost: dict[str, str] = {}
    # what the detector of a file does to its process is its own
    groups: list[tuple] = [(tuple(ids), ()), *(((), (file,)) for file in files)]
    for turn, (shipped, own) in enumerate(groups):
        flown = [f for f in flights if not own or "sha256" in f.told]  # of one that could not be flown there is one row
        calls = ((f.run, one, (f.run, f.toml, str(f.path), f.told, shipped, own)) for f in flown)
        found: list[tuple] = []
        try:
            for done, (_, each) in enumerate(finished(calls, workers=workers, crashed=_ended if own else None)):
                found.append(each)
                if progress:
                    progress((turn * len(flights) + done + 1) // len(groups), len(flights))
        except _Ended as error:
            lost[str(own[0])] = str(error)
            continue
        first = len(ids) * MOST_LANES + turn * MOST_LANES if own else 0
        for new, took, said in found:
            numbered = [row if row["lane"] is None else {**row, "lane": row["lane"] + first} for row in new]
            rows, timing, logs = rows + numbered, timing + took, logs + said
    tomls = {f.run: f.toml for f in flights}
    scenarios = {run: parse(toml(text, place=run)) for run, text in tomls.items()}
    store = Store(None, table(scenarios, scenarios.values()))
    store.add(rows, timing)
    lanes = store.rows()
    tidied = compare_rows.tidy(lanes, tomls)
    families = {f.run: f.family for f in flights}
    sizes = [size(row, scenarios[row["run"]]) for row in tidied.to_dict("records")]
    tidied["part"] = tidied["run"].map(families)
    tidied["size"], tidied["unit"] = [s for s, _ in sizes], [u for _, u in sizes]
    times = pa.Table.from_pylist(timing, TIMING).to_pandas()
    return Scored(tidied, times, pd.DataFrame(logs, columns=list(LOG)), lanes, lost)


class _Ended(Exception):
    """A process that a detector ended."""


def _ended(run, text):
    raise _Ended(f"{text} (flight {run})")


def one(run: str, text: str, path: str, told: dict, ids: tuple, files: tuple) -> tuple[list, list, list]:
    """Run detectors on one recording; return (rows, timing, log scores) as dicts."""
    if "sha256" not in told:
        return [failed(run, told["status"], told["reason"])], [], []
    recording = benchmark_recording.again(path, text, told["sha256"])
    installed = benchmark_recording.flown_with(recording, ids, files)
    entries, timing, logs = [], [], []
    for each in benchmark_recording.judgement(recording, installed):
        entries.append(each.entry)
        timing.append({"run": run, "id": each.entry["id"], "step_us": each.step_us})
        if each.told:
            logs.append({"run": run, "id": each.entry["id"], "lane": each.entry["target"], **_honest(recording, each)})
    timing = list({t["id"]: t for t in timing}.values())
    return judged.rows(run, {**recording.about, "detectors": entries}), timing, logs


def _honest(recording, lane):
    """Return the log scores of one lane: in the fault that concerns it, and where there is none."""
    dt, entry = recording.scenario.dt, lane.entry
    settled, onset = round(SETTLE_S / dt), min((round(f["start_s"] / dt) for f in recording.faults), default=None)
    out = {"log_none": log_score(lane.told, ("none",), settled, onset or recording.ticks), "log_fault": None}
    if entry["concerned"] and entry["by_fault"]:
        fault = next(f for f in recording.faults if f["fault"] == entry["by_fault"][0]["fault"])
        own = coverage.expected(entry["id"], fault["case"])
        end = recording.ticks if math.isinf(fault["end_s"]) else min(recording.ticks, round(fault["end_s"] / dt))
        if own != coverage.BLIND:
            true = coverage.true_classes(fault["case"], fault["kind"])
            out["log_fault"] = log_score(lane.told, true, round(fault["start_s"] / dt), end)
    return out


def size(row: dict, scenario: Scenario) -> tuple[float, str]:
    """Return (size of the row's fault, its unit); (NaN, "") for one without.

    Of oscillations and jams what was achieved, a jam's how far it kept the rod from where it would be; of a runaway its
    rate, of a loss its share; a sensor's bias in standard deviations of the noise of that sensor.
    """
    if row["fault"] is None or row["fault"] != row["fault"]:
        return math.nan, ""
    fault = scenario.faults[int(row["fault"])]
    own = fault.model_extra or {}
    if fault.kind.startswith("ofc"):
        return row["amplitude_mm"], "mm of rod"
    if fault.kind in ("jam_solid", "jam"):
        return row["rod_mm"], "mm of rod"
    if "rate_deg_s" in own:
        return own["rate_deg_s"], "deg/s"
    if "loss_pct" in own:
        return own["loss_pct"], "%"
    j = next(j for j in scenario.injections() if j.fault == int(row["fault"]))
    if j.kind not in ("bias", "jam_liquid") or not (j.sensor or j.place == "sensor"):
        return math.nan, ""
    technology = scenario.elevator.technology.get(j.name, "")
    sigma = TECHNOLOGIES[technology].sensors[j.sensor].sigma if technology else TRANSPORT[j.name][1]
    lane = next(lane for lane in fault_lanes(scenario) if lane.fault == j.fault)
    return abs(float(lane.p["amplitude"][0])) / sigma, "sigma"


FREE = "no fault"
OF_THE_CLOCK = ("step_us",)  # never the same twice
WHOLE = (  # of cosim.compare.stats.detectors: over all flights
    *("availability", "standing_s", "false_alarms", *stats.PER_HOUR, "hours", "fault_free_runs", "fault_free_alarmed"),
    *(*stats.PER_FLIGHT, "credible", "step_us"),
)


def detector(found: Scored, name: str, flights: Sequence[RecordedFlight]) -> dict:
    """Return the row of detector `name`: what it made of all faults that it is not blind to, of each family, its false
    alarms, cost and log scores.

    A family counts every flight in which it has a lane on the faulty part and is not blind to the fault by its own
    word; one in which it called itself not valid is not seen, here as in the fitted curve: otherwise a detector would
    gain by giving up.
    """
    own = found.rows[found.rows["id"] == name]
    faults = own[own["case"].notna() & own["concerned"]]
    record = registry.find(name)
    whole = stats.detectors(own, found.timing)[0]
    families = [f for f in dict.fromkeys(f.family for f in flights) if f != FREE]
    lines = [_family(faults[faults["part"] == f], f, found.logs, name) for f in families]
    open_to = faults[faults["word"] != coverage.BLIND]
    guest = registry.GUESTS.get(name)
    return {
        "id": name, "level": whole["level"], "group": stats.draws_on(name, whole["level"]),
        "inputs": sorted(set(record.inputs.values())) if record else [],
        "guest": None if guest is None else {"sha256": guest.sha256}, "remark": coverage.remark(name),
        **(stats.score(open_to) if len(open_to) else {"designed": 0, "detected": 0}),
        "blind": int(len(faults) - len(open_to)), **{k: whole[k] for k in WHOLE},
        **_mean(found.logs[found.logs["id"] == name]), "families": lines,
    }  # fmt: skip


def _family(rows, family, logs, name):
    open_to = rows[rows["word"] != coverage.BLIND]
    out = {"family": family, "flights": len(rows), "blind": int(len(rows) - len(open_to)),
           "seen_though_blind": int(rows[rows["word"] == coverage.BLIND]["detected"].sum()),
           "words": open_to["word"].value_counts().to_dict()}  # fmt: skip
    if not len(open_to):
        return {**out, "designed": 0}
    sized = open_to[open_to["size"] > 0.0]
    units = sized["unit"].unique()
    curve = asdict(pod.fit(sized["size"], sized["detected"])) if len(units) == 1 else {"note": "no size"}
    mine = logs[(logs["id"] == name) & logs["run"].isin(open_to["run"])]
    physics = open_to["bound_mm"].median() if "bound_mm" in open_to else None
    return {
        **out, **stats.score(open_to), "unit": units[0] if len(units) == 1 else "",
        **{k: curve.get(k) for k in ("a90", "low", "a90_95", "note")}, "bound_mm": physics, **_mean(mine),
    }  # fmt: skip


def _mean(logs: pd.DataFrame) -> dict:
    """Return mean log scores over flights, None for a detector that gives no probabilities."""
    out = {}
    for key in ("log_fault", "log_none"):
        each = pd.to_numeric(logs[key]).groupby(logs["run"]).mean().dropna()
        out[key] = float(each.mean()) if len(each) else None
    return out


def differences(table: dict, again: dict, detectors: Sequence[str]) -> list[str]:
    """Return what differs between a stored table and one made again, a sentence each; clocks are left out."""
    out = [f"{k}: {table.get(k)} stored, {again[k]} here" for k in ("benchmark", "flights", "seeds", "content")
           if table.get(k) != again[k]]  # fmt: skip
    stored, fresh = ({d["id"]: d for d in t["detectors"]} for t in (table, again))
    for name in detectors:
        out += [f"{name}: {line}" for line in _differ(stored[name], fresh[name], "")]
    return out


def _differ(a, b, place):
    if isinstance(a, dict) and isinstance(b, dict):
        for key in dict.fromkeys((*a, *b)):
            if key not in OF_THE_CLOCK:
                yield from _differ(a.get(key), b.get(key), f"{place}.{key}" if place else key)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (x, y) in enumerate(zip(a, b)):
            yield from _differ(x, y, f"{place}[{i}]")
    elif a != b and not (isinstance(a, float) and isinstance(b, float) and abs(a - b) <= 1e-9 * max(abs(a), abs(b))):
        yield f"{place} = {a} stored, {b} here"


LEAST = 1e-6  # no answer counts as less: a single certain error would otherwise be endless
UNSAID = math.log(1.0 / len(NAMES))


def log_score(
    told: Sequence[tuple[int, Mapping[str, float]]], classes: Sequence[str], first: int, last: int
) -> float | None:
    """Return the mean of ln p(any of `classes`) over the ticks first <= k < last; None without a tick. `told` is
    [(tick, {class: probability})] in order of time: an answer holds until the next one, before the first every class is
    as likely. A proper score [Good 1952]: on average nobody gains by saying anything but what they believe."""
    if last <= first:
        return None
    if not told:
        return UNSAID
    at = np.array([k for k, _ in told])
    p = np.array([sum(said.get(c, 0.0) for c in classes) for _, said in told], float)
    each = np.concatenate([[UNSAID], np.log(np.clip(p, LEAST, 1.0))])
    return float(np.mean(each[np.searchsorted(at, np.arange(first, last), side="right")]))
