"""Rates of `joint` from flights that nothing else uses: who says what of which fault, and how late.

The flights are those of `cosim campaign joint` with one fault, with other seeds and draws, without the kinds of
fault that it keeps from the rates. Of each lane and flight counts the name that stood longest in the first WITHIN_S of
the fault, and how much later than the first witness it came; names of a fault count as on the left, of one segment as
on left_inner.
"""

import dataclasses
import functools
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.campaign.spec import load_campaign
from cosim.errors import TrimError
from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.judge import coverage
from cosim.judge.alarms import onsets
from cosim.judge.detection import Watch, valid
from cosim.scenario import Scenario
from cosim.training.trainer import Trained, Training
from fdi import registry
from fdi.common.verdict import class_name
from fdi.joint import places, tables

CAMPAIGN, FIRST_SEED, DRAWS = "joint", 40_000, 35
NOT_LEARNED = ("pairs", "kinds not in the rates")  # parts of the campaign that begin so
LEAST_RUNS = 20  # of every fault: with ten, what nobody has missed is missed in one of 25 by the records' weight
WITHOUT, WITHOUT_RUNS = "fault-free", 1200  # part without a fault: 20 hours
WITHIN_S = 15.0


@functools.cache
def scenarios(first_seed: int = FIRST_SEED) -> list[Scenario]:
    """Return the training flights, without `joint`: all of them at each call, so that a process makes them once."""
    whole = load_campaign(CAMPAIGN)
    parts = tuple(
        dataclasses.replace(p, runs=WITHOUT_RUNS if p.name == WITHOUT else max(p.runs, LEAST_RUNS))
        for p in whole.parts if not p.name.startswith(NOT_LEARNED)
    )  # fmt: skip
    made, _ = dataclasses.replace(whole, parts=parts, seed=DRAWS, first_seed=first_seed).scenarios()
    quiet = [s.detectors.model_copy(update={"enabled": tuple(d for d in s.running if d != "joint")}) for s in made]
    return [s.model_copy(update={"detectors": own}) for s, own in zip(made, quiet)]


def surveyed(index: int, first_seed: int = FIRST_SEED) -> dict[str, Any]:
    """Return what `told` says of one training flight; {} where the engines cannot hold the point drawn."""
    try:
        return told(scenarios(first_seed)[index])
    except TrimError:
        return {}


def told(scenario: Scenario) -> dict[str, Any]:
    """Fly a scenario with one fault or none and return plain data: the `kind` of the fault, its `segments`, the
    `technology` of all segments, of every lane that could judge [detector, lane, `_tokens`, seconds after the first
    witness], and `before` the fault {detector: [alarms that still stood in each of `tables.PHASES`, minutes]}."""
    setup = build(scenario)
    index, finer = columns(setup)
    trace, _, _ = fly(setup, keep=(index, np.float32))
    dt = setup.loop.dt
    start = round(scenario.faults[0].start_s / dt) if scenario.faults else len(trace)
    end = min(len(trace), start + round(WITHIN_S / dt))
    rises: dict[int, float] = {}
    said: list[list[Any]] = []
    before: dict[str, list] = {}  # alarms without a fault that stand for each phase, minutes in which it is valid
    for w in setup.trace.watches({}):
        able, on = valid(w, trace[:start]), trace[:start, w.alarm] > 0.5
        counts = before.setdefault(w.id, [*(0 for _ in tables.PHASES), 0.0])
        for begins in onsets(on)[able[onsets(on)]]:
            stands = dt * (np.argmin(on[begins:]) or start - begins)
            for k, age in enumerate(tables.PHASES):
                counts[k] += int(stands >= age)
        counts[-1] = max(counts[-1], round(float(able.sum()) * dt / 60.0, 3))
        rise = onsets(trace[:, w.alarm])
        rise = rise[(rise >= start) & (rise < end)]
        if len(rise) or (start < end and valid(w, trace[start : start + 1]).all()):
            own = finer.get((w.id, w.target), {})
            tokens = _tokens(w, trace[rise[0] : end], own, dt) if len(rise) else []
            rises[len(said)] = rise[0] * dt if len(rise) else np.inf
            said.append([w.id, w.target.removeprefix("elevator."), tokens])
    first = min(rises.values(), default=np.inf)
    lanes = [[*s, round(float(rises[i] - first), 3) if s[2] else None] for i, s in enumerate(said)]
    kind, segments = kind_of(scenario) if scenario.faults else ("", ())
    own = dict(scenario.elevator.technology)
    return {"kind": kind, "segments": list(segments), "technology": own, "lanes": lanes, "before": before}


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


def _tokens(watch: Watch, trace: np.ndarray, finer: dict[str, int], dt: float) -> list[str]:
    """Return the token that stood longest in each of `tables.PHASES` of the alarm that `trace` begins with, that of the
    phase before where none stood in one; what tells more than a class stands while the alarm does."""
    more, out = registry.record(watch.id).finer, []
    kinds: tuple[str, ...] | str = ()
    own = trace[:, [watch.alarm, watch.verdict, watch.culprit, *finer.values()]].astype(int)
    for rows in np.split(own, [round(age / dt) for age in tables.PHASES[1:]]):
        said: Counter = Counter()
        for on, verdict, culprit, *values in rows.tolist():
            if not on:
                kinds = ()
                continue
            kinds = next((more[o][v] for o, v in zip(finer, values, strict=True) if v in more[o]), kinds)
            said[verdict, culprit, kinds] += 1
        if said:
            (verdict, culprit, told), _ = said.most_common(1)[0]
            out.append(tables.name(watch.id, class_name(verdict or 9), watch.culprits[culprit], told))
        else:
            out.append(out[-1])
    return out


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
    """Return the rates from what `told` said: `seen` {detector: {kind: {flights, said [{token: count} of each phase],
    late}}}, `late` of every detector how many of its alarms had come at each of `tables.AGES`, and at all, and `alone`
    {detector: [faults of which it alone spoke until the last phase, faults, `before`]}."""
    seen: dict = {}
    late: dict = {}
    alone: dict = {}
    for f in flights:
        soon = {detector for detector, _, tokens, delay in f["lanes"] if tokens and delay <= tables.PHASES[-1]}
        for detector, (*stood, minutes) in f["before"].items():
            before = alone.get(detector, [0] * (2 + len(stood)) + [0.0])
            more = int(soon == {detector}), int(bool(f["kind"])), *stood, minutes
            alone[detector] = [round(a + b, 2) for a, b in zip(before, more, strict=True)]
        for detector, lane, tokens, delay in f["lanes"]:
            own = f["kind"]
            if lane != "aircraft":
                if lane not in f["segments"]:
                    continue
                if own.startswith(("side.", "all.")):
                    own = f"{f['technology'][lane]}.{own.partition('.')[2]}"
            new = {"flights": 0, "said": [{} for _ in tables.PHASES], "late": _late([])}
            cell = seen.setdefault(detector, {}).setdefault(own, new)
            cell["flights"] += 1
            for phase, token in zip(cell["said"], tokens):
                token = places.turned(token, f["segments"])
                phase[token] = phase.get(token, 0) + 1
            if tokens:
                cell["late"] = [a + b for a, b in zip(cell["late"], _late([delay]), strict=True)]
                late.setdefault(detector, []).append(delay)
    return {"late": {d: _late(times) for d, times in late.items()}, "alone": alone, "seen": seen}


def _late(times: list[float]) -> list[int]:
    """Return how many of delays [s] are over at each of `tables.AGES`, and how many there are."""
    return [*(sum(v <= a for v in times) for a in tables.AGES), len(times)]


def collect(first_seed: int, number: int | None, run: Callable[..., Any]) -> list[dict[str, Any]]:
    """Return what `surveyed` finds in each flight that can be flown."""
    indices = range(len(scenarios(first_seed)))[:number]
    return [found for found in run([(surveyed, {"index": k, "first_seed": first_seed}) for k in indices]) if found]


def limits(flown: list[dict[str, Any]]) -> list[Trained]:
    """Return the rates of all flights."""
    return [Trained("joint", "", counted(flown), {"flights": len(flown), "draws": DRAWS}, rounded=lambda value: value)]


TRAININGS = {"joint": Training("joint", FIRST_SEED, None, collect, limits)}
