"""Rates of `joint` from flights that nothing else uses: who says what of which fault.

The flights are those of `cosim campaign joint` with one fault, with other seeds and draws, without the kinds of fault
that it keeps from the rates. A flight counts once for each lane that its fault concerns while the alarm is young, and
once later, shared among what the lane says at AGES_S after the first alarm; names of a fault count as on the left, of
one segment as on left_inner.
"""

import dataclasses
import functools
from collections import Counter

import numpy as np

from cosim.campaign.spec import load_campaign
from cosim.errors import TrimError
from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.judge import coverage
from cosim.scenario import Scenario
from cosim.training.trainer import Limits, Training
from fdi import registry
from fdi.common.verdict import NAMES
from fdi.joint import likelihood
from fdi.joint.hypotheses import AIRCRAFT, LOCAL, SAME, turned

HEARD = (*LOCAL, *AIRCRAFT)
CAMPAIGN, FIRST_SEED, DRAWS = "joint", 40_000, 35
NOT_LEARNED = ("pairs", "kinds not in the rates", "fault-free")  # parts of the campaign that begin so
RUNS = 20  # of every fault: with ten, what nobody has missed is missed in one of 25 by the records' weight
AGES_S = np.arange(0.0, 15.0, 0.5)
Said = tuple[str, str, str, dict[str, float]]  # "young" or "later", detector, key of a hypothesis, {token: share}
WITHIN_S = 15.0  # of the onset: a later first alarm is no alarm of this fault


@functools.cache
def scenarios(first_seed: int = FIRST_SEED) -> list[Scenario]:
    """Return the training flights, without `joint`: all of them at each call, so that a process makes them once."""
    whole = load_campaign(CAMPAIGN)
    parts = tuple(dataclasses.replace(p, runs=RUNS) for p in whole.parts if not p.name.startswith(NOT_LEARNED))
    made, _ = dataclasses.replace(whole, parts=parts, seed=DRAWS, first_seed=first_seed).scenarios()
    quiet = [s.detectors.model_copy(update={"enabled": tuple(d for d in s.running if d != "joint")}) for s in made]
    return [s.model_copy(update={"detectors": own}) for s, own in zip(made, quiet)]


def surveyed(index: int, first_seed: int = FIRST_SEED) -> list[Said]:
    """Return `said` of one training flight; nothing where the engines cannot hold the point drawn."""
    scenario = scenarios(first_seed)[index]
    try:
        setup = build(scenario)
    except TrimError:
        return []
    heard = (lane for lane in setup.judged_lanes() if lane.id in HEARD)
    fields = columns([(lane.id, lane.target.removeprefix("elevator.")) for lane in heard])
    trace, _, _ = fly(setup, keep=(np.array([setup.loop.bus.index(".".join(f)) for f in fields]), np.float32))
    return said(scenario, {f: trace[:, i].astype(int) for i, f in enumerate(fields)}, setup.loop.dt)


def columns(lanes: list[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Return (detector, lane, output) of all that is read of each lane."""
    outputs = ("alarm", "verdict", "isolated_part", "valid")
    return [(d, lane, o) for d, lane in lanes for o in (*outputs, *registry.record(d).finer)]


def said(scenario: Scenario, flown: dict, dt: float) -> list[Said]:
    """Return the Said of a flight with one fault; `flown` is {(detector, lane, output): values by tick}."""
    key, segments = key_of(scenario)
    own = scenario.elevator.technology
    start, lanes = round(scenario.faults[0].start_s / dt), {f[:2] for f in flown}
    alarms = np.any([flown[*lane, "alarm"][start : start + round(WITHIN_S / dt)] for lane in lanes], axis=0)
    if not alarms.any():
        return []
    ticks = start + int(np.argmax(alarms)) + np.round(AGES_S / dt).astype(int)
    young, out = AGES_S < likelihood.YOUNG, []
    for d, lane in sorted(lanes):
        if lane != "aircraft" and lane not in segments:
            continue
        mine = key if lane == "aircraft" else f"{own[lane]}.{key.partition('.')[2]}"
        for age, those in (("young", ticks[young]), ("later", ticks[~young])):
            texts = [_text(d, {f[2]: v[k] for f, v in flown.items() if f[:2] == (d, lane)}, segments)
                     for k in those if k < len(flown[d, lane, "alarm"])]  # fmt: skip
            shares = Counter(t for t in texts if t)
            out.append((age, d, mine, {t: n / shares.total() for t, n in shares.items()}))
    return out


def _text(detector, values, segments):
    """Return the token of outputs of one tick as `likelihood` stores it, "" of one that is silent and not valid."""
    if not values["alarm"]:
        return "|".join(likelihood.SILENT) if values["valid"] else ""
    told = (likelihood.word(of[values[o]]) for o, of in registry.record(detector).finer.items() if values[o] in of)
    isolated_part = registry.module(detector).ISOLABLE_PARTS[values["isolated_part"]]
    verdict = NAMES[values["verdict"] or -1]
    one = likelihood.index(detector, verdict, isolated_part, next(told, ""))
    verdict, isolated_part, word = likelihood.tokens(detector)[one]
    return "|".join((verdict, turned(isolated_part, segments), word))


def key_of(scenario: Scenario) -> tuple[str, tuple[str, ...]]:
    """Return (key of a hypothesis, segments) of the first fault of a scenario."""
    fault, case = scenario.faults[0], coverage.cases(scenario)[0]
    place, *rest = fault.target.split(".")
    if place != "elevator":
        return (fault.target if fault.target == "engine.all" else case + ".runaway" * (fault.kind == "runaway")), ()
    own = scenario.elevator.technology
    segments = tuple(s for s in own if s == rest[0] or s.startswith(f"{rest[0]}_") or rest[0] == "all")
    kind = case.partition(".")[2]
    reach = own[segments[0]] if len(segments) == 1 else "all" if len(segments) == len(own) else "side"
    return f"{reach}.{SAME.get(kind, kind)}", segments


def counted(flights: list[list[Said]]) -> dict[str, likelihood.Seen]:
    """Return {"young" or "later": rates} from what `said` returns."""
    seen: dict[str, dict[str, dict[str, Counter]]] = {}
    for age, detector, key, shares in sorted((one for flight in flights for one in flight), key=lambda one: one[:3]):
        seen.setdefault(age, {}).setdefault(detector, {}).setdefault(key, Counter()).update(shares)
    return {age: {d: {key: {t: round(n, 1) for t, n in cell.items() if n >= 0.05} for key, cell in of.items()}
                  for d, of in whole.items()} for age, whole in seen.items()}  # fmt: skip


def flights(first_seed: int, number: int | None) -> list[dict[str, int]]:
    """Return the arguments of `surveyed` of every flight."""
    return [{"index": k, "first_seed": first_seed} for k in range(len(scenarios(first_seed)))[:number]]


def limits(flown: list) -> Limits:
    """Return the rates of all flights that could be flown."""
    held = [found for found in flown if found]
    return {"joint": ({"seen": counted(held)}, {"flights": len(held), "draws": DRAWS})}


JOINT = Training(FIRST_SEED, None, flights, surveyed, limits, {})
