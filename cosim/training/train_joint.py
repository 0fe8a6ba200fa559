"""Rates of `joint` from flights that nothing else uses: who says what of which fault, and how late.

The flights are those of `cosim campaign joint` with one fault, with other seeds and draws, without the kinds of
fault that it keeps from the rates. Of each lane and flight counts the name that stood longest in the first WITHIN_S of
the fault, and how much later than the first witness it came; names of a fault on the right side count as on the left.
"""

import dataclasses
import functools
from collections import Counter
from typing import Any

import numpy as np

from cosim.campaign.jobs import work
from cosim.campaign.spec import load_campaign
from cosim.files import replace_text
from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.judge import coverage
from cosim.judge.alarms import onsets
from cosim.judge.detection import Watch, valid
from cosim.scenario import Scenario
from cosim.training.trainer import FOLDER
from fdi import registry
from fdi.common import compact
from fdi.common.verdict import class_name
from fdi.joint import joint, places, tables

CAMPAIGN, FIRST_SEED, DRAWS = "joint", 40_000, 35
NOT_LEARNED = ("pairs", "kinds not in the rates", "fault-free")  # parts of the campaign that begin so
LEAST_RUNS = 20  # of every fault: with ten, what nobody has missed is missed in one of 25 by the records' weight
WITHIN_S = 15.0


@functools.cache
def scenarios(first_seed: int = FIRST_SEED) -> list[Scenario]:
    """Return the training flights, without `joint`: all of them at each call, so that a process makes them once."""
    whole = load_campaign(CAMPAIGN)
    learned = (p for p in whole.parts if not p.name.startswith(NOT_LEARNED))
    parts = tuple(dataclasses.replace(p, runs=max(p.runs, LEAST_RUNS)) for p in learned)
    made, _ = dataclasses.replace(whole, parts=parts, seed=DRAWS, first_seed=first_seed).scenarios()
    quiet = [s.detectors.model_copy(update={"enabled": tuple(d for d in s.running if d != "joint")}) for s in made]
    return [s.model_copy(update={"detectors": own}) for s, own in zip(made, quiet)]


def surveyed(index: int, first_seed: int = FIRST_SEED) -> dict[str, Any]:
    """Return what `told` says of one training flight."""
    return told(scenarios(first_seed)[index])


def told(scenario: Scenario) -> dict[str, Any]:
    """Fly a scenario with one fault and return plain data: the `kind` of the fault, its `segments`, whether it is on
    the `right` side, the `technology` of all segments, of every lane that could judge [detector, lane, token or "",
    seconds after the first witness], and `before` the fault {detector: [alarms, minutes]}."""
    setup = build(scenario)
    index, finer = columns(setup)
    trace, _, _ = fly(setup, keep=(index, np.float32))
    dt = setup.loop.dt
    start = round(scenario.faults[0].start_s / dt)
    end = min(len(trace), start + round(WITHIN_S / dt))
    rises: dict[int, float] = {}
    said: list[list[str]] = []
    before: dict[str, list] = {}  # alarms without a fault, minutes in which it is valid
    for w in setup.trace.watches({}):
        able, counts = valid(w, trace[:start]), before.setdefault(w.id, [0, 0.0])
        counts[0] += int(able[onsets(trace[:start, w.alarm])].sum())
        counts[1] = max(counts[1], round(able.sum() * dt / 60.0, 3))
        rise = onsets(trace[:, w.alarm])
        rise = rise[(rise >= start) & (rise < end)]
        if len(rise) or valid(w, trace[start : start + 1]).all():
            token = _token(w, trace[start:end], finer.get((w.id, w.target), {})) if len(rise) else ""
            rises[len(said)] = rise[0] * dt if len(rise) else np.inf
            said.append([w.id, w.target.removeprefix("elevator."), token])
    first = min(rises.values(), default=np.inf)
    lanes = [[*s, round(rises[i] - first, 3) if s[2] else None] for i, s in enumerate(said)]
    kind, segments = kind_of(scenario)
    right = bool(segments) and all(s.startswith("right") for s in segments)
    own = dict(scenario.elevator.technology)
    return {"kind": kind, "segments": list(segments), "technology": own, "right": right, "lanes": lanes,
            "before": before}


def columns(setup: Any) -> tuple[np.ndarray, dict]:
    """Return (positions on the bus of what the judgement reads, then of the outputs that tell more than a class;
    {(detector, target): {output: column}} of the latter)."""
    index = list(setup.trace.index)
    finer: dict[tuple[str, str], dict[str, int]] = {}
    for w in setup.trace.watches({}):
        lane = w.target.removeprefix("elevator.")
        for output in registry.record(w.id).finer:
            finer.setdefault((w.id, w.target), {})[output] = len(index)
            index.append(setup.loop.bus.index(f"{w.id}.{lane}.{output}"))
    return np.array(index), finer


def _token(watch: Watch, trace: np.ndarray, finer: dict[str, int]) -> str:
    """Return the token that stood longest; what tells more than a class stands while the alarm does."""
    more, said = registry.record(watch.id).finer, []
    kinds: tuple[str, ...] = ()
    own = trace[:, [watch.alarm, watch.verdict, watch.culprit, *finer.values()]].astype(int)
    for on, verdict, culprit, *values in own.tolist():
        if not on:
            kinds = ()
            continue
        kinds = next((more[o][v] for o, v in zip(finer, values, strict=True) if v in more[o]), kinds)
        said.append((verdict, culprit, kinds))
    (verdict, culprit, kinds), _ = Counter(said).most_common(1)[0]
    return tables.name(watch.id, class_name(verdict or 9), watch.culprits[culprit], kinds)


def kind_of(scenario: Scenario) -> tuple[str, tuple[str, ...]]:
    """Return (kind as in `fdi.joint.places.hypotheses`, segments) of the first fault of a scenario."""
    fault, case = scenario.faults[0], coverage.cases(scenario)[0]
    place, *rest = fault.target.split(".")
    if place == "engine":
        return ("engine.all" if rest == ["all"] else "engine.one"), ()
    if place != "elevator":
        return (case if place == "sensor" else f"surface.{place}"), ()
    own = scenario.elevator.technology
    segments = tuple(s for s in own if s == rest[0] or s.startswith(f"{rest[0]}_") or rest[0] == "all")
    inside = coverage.inside(case)
    if inside.endswith("_sensor"):
        return f"{own[segments[0]]}.{inside}", segments
    part = "drive" if inside in places.DRIVE.values() else inside
    group = own[segments[0]] if len(segments) == 1 else "all" if len(segments) == len(own) else "side"
    kind, cause = f"{group}.{part}.{coverage.true_class(case)}", case.partition(".")[2]
    return f"{group}.{part}.{cause}" if cause in places.CAUSES.get(kind, ()) else kind, segments


def counted(flights: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the rates from what `told` said: `seen` {detector: {kind: {flights, said {token: count}}}}, `late`, of
    every detector how many of its alarms had come at each of `tables.AGES`, and at all, and `alone` {detector: [faults
    of which it alone spoke, faults, alarms without one, minutes]}."""
    seen: dict = {}
    late: dict = {}
    alone: dict = {}
    for f in flights:
        spoke = [detector for detector, _, token, _ in f["lanes"] if token]
        for detector, (wrong, minutes) in f["before"].items():
            before = alone.get(detector, [0, 0, 0, 0.0])
            more = int(spoke == [detector]), 1, wrong, minutes
            alone[detector] = [round(a + b, 2) for a, b in zip(before, more, strict=True)]
        for detector, lane, token, delay in f["lanes"]:
            own = f["kind"]
            if lane != "aircraft":
                if lane not in f["segments"]:
                    continue
                if own.startswith(("side.", "all.")):
                    own = f"{f['technology'][lane]}.{own.partition('.')[2]}"
            cell = seen.setdefault(detector, {}).setdefault(own, {"flights": 0, "said": {}})
            cell["flights"] += 1
            if token:
                token = places.mirrored(token) if f["right"] else token
                cell["said"][token] = cell["said"].get(token, 0) + 1
                late.setdefault(detector, []).append(delay)
    ages = {d: [sum(v <= a for v in times) for a in tables.AGES] + [len(times)] for d, times in late.items()}
    return {"late": ages, "alone": alone, "seen": seen}


def train(*, first_seed: int = FIRST_SEED, **how: Any) -> dict[str, Any]:
    """Fly the training flights and return the rates; `how` as in `cosim.campaign.jobs.work`."""
    number = len(scenarios(first_seed))
    flown = work([(surveyed, {"index": k, "first_seed": first_seed}) for k in range(number)], **how)
    about = {"command": "cosim train joint", "flights": number, "first_seed": first_seed, "draws": DRAWS}
    return {"training": about, **counted(flown)}


def changes(found: dict[str, Any]) -> list[tuple]:
    """Return (file, detector, kind, stored, trained) of the share of each kind that a detector sees."""
    stored, out = tables.stored(), []
    for detector, kinds in found["seen"].items():
        for kind, cell in kinds.items():
            before = stored.get("seen", {}).get(detector, {}).get(kind, {"flights": 0, "said": {}})
            shares = (sum(c["said"].values()) / c["flights"] if c["flights"] else float("nan") for c in (before, cell))
            out.append(("joint", detector, kind, *shares))
    return out


def store(found: dict[str, Any]) -> None:
    """Write the rates where `joint` reads them."""
    replace_text(FOLDER / "joint.json", compact.text(found))
    tables.stored.cache_clear()
    joint.of_layout.cache_clear()
