"""P(token | hypothesis) as tables: from the records of the detectors, and from rates that were measured.

A lane's token is "-" while it is silent, else what it says, by its `name`. The records say who is designed for a
fault, who may see it, who is blind to it, and who reads the sensor that is wrong; how large the fault is stays open
(SIZES). Rates are counts of flights (fdi/thresholds/joint.json, by training `joint`); they move what the
records say as so many flights more beside the WEIGHT flights that a record counts for. How often a detector keeps to
its record is counted over all kinds of fault together. UNSEEN of the probability of every hypothesis is that of a
fault unlike any that rates were counted on: there the records speak, with that alone.
"""

import fnmatch
import functools
import itertools
import json
import math
from collections import Counter
from importlib import resources
from typing import Any

import numpy as np

from fdi import registry
from fdi.common.verdict import NAMES
from fdi.joint.places import (
    AIRCRAFT,
    DRIVE,
    ENGINES,
    LANES,
    LOCAL,
    SEGMENTS,
    WIDE,
    Hypothesis,
    case,
    hypotheses,
    turned,
)

WEIGHT = 3.0  # flights that a record counts for
LATE = 5.0  # alarms that the lateness of all kinds counts for in that of one
UNSEEN = 0.2  # probability that a fault is of a kind that no flight had
AGES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # [s] after the first witness; alarms are counted for 15 s
PHASES = (0.0, 0.25, 1.0, 4.0)  # [s] of a lane's own alarm, whose names are counted apart: the first are less sure
# P(alarm | designed for, may see, reads the sensor, blind), for a small, a middling and a large fault; assumed
SIZES = {
    "local": {"designed": (0.5, 0.95, 0.99), "may": (0.02, 0.4, 0.95), "reads": (0.02, 0.1, 0.3),
              "blind": (0.005,) * 3},
    "aircraft": {"designed": (0.05, 0.5, 0.95), "may": (0.01, 0.2, 0.8), "reads": (0.02, 0.1, 0.3),
                 "blind": (0.005,) * 3},
}  # fmt: skip
LARGE = ("runaway",)  # what goes on to a stop is large in the end, however slowly
# P(a class of the record | a class), likewise of a culprit, and P(ambiguous | alarm); assumed, then counted
RIGHT, OPEN = 0.9, 0.2
OPEN_CLASSES = ("effectiveness", "ambiguous")  # of more than one cause: where a detector tells more, it counts
ELSEWHERE = 3e-4  # P(false alarm) of a lane: a quarter of the 1e-3 per minute that a detector is trained to
SECOND = 0.9  # P(a detector names the second of two parts | it would name it alone)
FALSE = 1e-3  # false alarms of a detector per flight of 60 s, to which they are trained
# faults per minute, times what one that is missed weighs against a false alarm: so much that a detector that is alone
# with one fault in a thousand is believed in the last of PHASES, if it has no false alarm in the flights counted
FAULTS = 1.0 / 30.0
FEW = 0.5  # faults, and false alarms, that ALONE and FALSE count for
STANDS = (1.0, 1.0, 0.85, 0.4)  # share of false alarms that still stand in each of PHASES: 13 in 100 hours
# P(a detector is the only one to speak of a fault); assumed, then counted: few faults move the aircraft alone
ALONE = {"local": 0.5, "aircraft": 0.01}


@functools.cache
def words(detector: str) -> tuple[tuple[str, ...] | str, ...]:
    """Return the kinds of fault that a detector tells apart where it leaves the class open, and the parts that it tells
    apart beyond its culprit; the first: none of them."""
    told = (word for of in registry.module(detector).DETECTOR.finer.values() for word in of.values() if word)
    return ((), *dict.fromkeys(told))


def name(detector: str, verdict: str, culprit: str, word: tuple[str, ...] | str = ()) -> str:
    """Return the token of a lane that says class `verdict` of `culprit`; `word` is one of `words`."""
    if isinstance(word, str):
        culprit = word or culprit
    elif word and verdict in OPEN_CLASSES:
        return f"{verdict} {word[0]}"
    if detector in ("kinematic", "control_redundancy"):
        return culprit or "ambiguous"
    if verdict == "sensor":
        return f"sensor {culprit}".strip()
    if detector in LOCAL:
        return verdict
    return f"{culprit} {verdict if verdict in ('ofc_liquid', 'ofc_solid') else 'otherwise'}".strip()


@functools.cache
def names(detector: str) -> tuple[str, ...]:
    """Return the tokens of a detector but for silence."""
    culprits = registry.module(detector).CULPRITS
    said = (name(detector, v, c, k) for k in words(detector) for c in culprits for v in NAMES[1:])
    return tuple(dict.fromkeys(said))


@functools.cache
def _tokens(detector):
    """Return (culprit, class, word, index in `names`) of all that a detector can say."""
    own, culprits = names(detector), registry.module(detector).CULPRITS
    said = itertools.product(culprits, NAMES[1:], words(detector))
    return [(c, v, k, own.index(name(detector, v, c, k))) for c, v, k in said]


def codes(detector: str) -> np.ndarray:
    """Return (class code, culprit) -> 1 + index of the token in `names`."""
    culprits, own = registry.module(detector).CULPRITS, names(detector)
    said = [[1.0 + own.index(name(detector, v, c)) for c in culprits] for v in NAMES[1:]]
    return np.array([[0.0] * len(culprits), *said])


def finer_codes(detector: str) -> np.ndarray:
    """Return (class code, one of `words`) -> 1 + index of the token in `names`, 0 where the word adds nothing."""
    own = names(detector)
    said = [[1.0 + own.index(name(detector, v, "", k)) if k and (isinstance(k, str) or v in OPEN_CLASSES) else 0.0
             for k in words(detector)] for v in NAMES[1:]]  # fmt: skip
    return np.array([[0.0] * len(words(detector)), *said])


@functools.cache
def stands(detector: str, kind: str, technology: str) -> tuple[str, tuple[str, ...]]:
    """Return (designed, may, reads or blind; the classes of its record) of a detector for a kind of fault."""
    record, own = registry.module(detector).DETECTOR, case(kind, technology)
    for word, table in (("designed", record.designed_for), ("may", record.may_see)):
        for pattern, classes in table.items():
            if fnmatch.fnmatchcase(own, pattern):
                return word, tuple(classes)
    if own.startswith("sensor.") and own.removeprefix("sensor.") in record.inputs.values():
        return "reads", ()
    return "blind", ()


_LEFT = {h.kind: (h, t) for t in DRIVE for h in hypotheses(dict.fromkeys(SEGMENTS, t))
         if h.side != "right"}  # of every kind one on the left, left_inner if of one segment: as rates are counted


def _culprits(detector, hypothesis):
    """Return the culprits that are right for a hypothesis; those that share one equation with it are as right."""
    record, place = registry.module(detector).DETECTOR, hypothesis.place
    if hypothesis.segments:
        # a surface that has come loose looks as if its sensor were wrong
        sensor = place.removesuffix("_sensor").rpartition("_")[2] if place.endswith(("_sensor", "_surface")) else ""
        right = {sensor, "elevator", f"elevator_{hypothesis.side}"}
        if not hypothesis.side and len(hypothesis.segments) > 1:
            right |= {"elevator_left", "elevator_right", "elevator_left and elevator_right"}
    else:
        right = {place, "engine"} if place in ENGINES else {place}
    for group in record.shares:
        right |= set(group) if right & set(group) else set()
    return right & set(registry.module(detector).CULPRITS)


def keeps(detector: str, rates: dict, phase: int = -1) -> tuple[float, float, float, float]:
    """Return P(a class of its record | a class), likewise of the culprit, and P(ambiguous | alarm), over every kind
    that it is designed for; P(it does not say more | an open class, or one segment) over every kind for which it has
    a word: in a phase of its alarm; and P(alarm | a kind that it is designed for)."""
    counts = rates.get("seen", {}).get(detector, {})
    right, wrong, left = WEIGHT * RIGHT**2, WEIGHT * (1.0 - RIGHT**2), 0.0
    mute, open_ = WEIGHT * OPEN, WEIGHT
    shares = [np.mean(SIZES[level(detector)]["designed"])] * int(WEIGHT)
    for h, technology in _LEFT.values():
        word, classes = stands(detector, h.kind, technology)
        if h.kind not in counts:
            continue
        told = _told(detector, h, technology)
        part = told[0] if told and isinstance(told[0], str) else ""
        for token, n in counts[h.kind]["said"][phase].items() if told else ():
            mute += n * (not token.startswith(part) if part else token in OPEN_CLASSES)
            open_ += n * bool(part or token.partition(" ")[0] in OPEN_CLASSES)
        if word != "designed":
            continue
        shares.append(sum(counts[h.kind]["said"][-1].values()) / counts[h.kind]["flights"])
        own = ((), *told)
        good = {name(detector, v, c, k) for v in _classes(classes) for c in _culprits(detector, h) or {""} for k in own}
        for token, n in counts[h.kind]["said"][phase].items():
            if token in good:
                right += n
            elif "ambiguous" in token or "otherwise" in token:
                left += n
            else:
                wrong += n
    alarms = right + wrong + left
    kept = float(np.sqrt(right / (right + wrong))), (WEIGHT * OPEN + left) / (WEIGHT + alarms), mute / open_
    return *kept, float(np.mean(shares))


def level(detector: str) -> str:
    """Return "local" or "aircraft"."""
    return "local" if detector in LOCAL else "aircraft"


def _told(detector, hypothesis, technology):
    """Return those of `words` that are right for a hypothesis."""
    part = f"elevator_{hypothesis.segments[0]}" if len(hypothesis.segments) == 1 else ""
    own = case(hypothesis.kind, technology).partition(".")[2]
    return [k for k in words(detector) if (k == part if isinstance(k, str) else own in k)]


def _classes(classes):
    """Return those of a record that are more than ambiguous; ambiguous where there is no other."""
    return tuple(c for c in classes if c != "ambiguous") or tuple(classes)


def believed(
    detector: str, hypothesis: Hypothesis, technology: str, kept: tuple[float, ...] = (RIGHT, OPEN, OPEN)
) -> tuple[np.ndarray, np.ndarray]:
    """Return P(alarm) by size (3,) and P(token | alarm) (tokens,) as the records have them; `kept` as of `keeps`."""
    word, classes = stands(detector, hypothesis.kind, technology)
    alarm = np.array(SIZES[level(detector)][word])
    if word == "designed" and len(kept) > 3:
        alarm = _shifted(alarm, kept[3])
    if hypothesis.verdict in LARGE:
        alarm[:] = alarm[-1]
    own, culprits, said = names(detector), registry.module(detector).CULPRITS, NAMES[1:]
    if word in ("blind", "reads"):
        return alarm, np.full(len(own), 1.0 / len(own))
    # who is not designed for it says any of the classes of its record, of which ambiguous may be one
    right = classes if word == "may" and classes else _classes(classes)
    of_v = _shares(said, set(right), kept[0])
    if "ambiguous" not in right:
        of_v = {v: (1.0 - kept[1]) * share + kept[1] * (v == "ambiguous") for v, share in of_v.items()}
    of_c = _shares(culprits, _culprits(detector, hypothesis), kept[0])
    told = words(detector)
    of_k = _shares(told, set(_told(detector, hypothesis, technology)) or {()}, kept[0])
    of_k = {k: (1.0 - kept[2]) * share + kept[2] * (not k) for k, share in of_k.items()}
    p = np.zeros(len(own))
    for c, v, k, token in _tokens(detector):
        p[token] += of_c[c] * of_v[v] * of_k[k]
    return alarm, p


def _shares(every, right, p):
    """Return {one of `every`: probability}: `p` in equal shares to the `right` ones, the rest to the others."""
    others = len(every) - len(right)
    if not right or not others:
        return dict.fromkeys(every, 1.0 / len(every))
    return {one: p / len(right) if one in right else (1.0 - p) / others for one in every}


def measured(
    detector: str, hypothesis: Hypothesis, technology: str, kept: tuple[float, ...], rates: dict, phase: int = -1
) -> tuple[np.ndarray, np.ndarray]:
    """Return the same with what was counted: Beta and Dirichlet updates of WEIGHT flights' worth of the records."""
    alarm, said = believed(detector, hypothesis, technology, kept)
    counted = rates.get("seen", {}).get(detector, {}).get(hypothesis.kind)
    if not counted:
        return alarm, said
    flights, own = counted["flights"], np.zeros(len(said))
    for token, n in counted["said"][phase].items():
        own[names(detector).index(turned(token, hypothesis.segments))] += n
    mean = (WEIGHT * alarm.mean() + own.sum()) / (WEIGHT + flights)
    return _shifted(alarm, mean), (WEIGHT * said + own) / (WEIGHT + own.sum())


def _shifted(p, mean):
    """Return probabilities whose log odds are those of `p` and one number more, with this mean."""
    return np.array(_shift(tuple(p.tolist()), float(mean)))


@functools.lru_cache(4096)
def _shift(p, mean):
    odds, low, high = [math.log(one / (1.0 - one)) for one in p], -20.0, 20.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = sum(1.0 / (1.0 + math.exp(-o - middle)) for o in odds) > mean * len(odds)
        low, high = (low, middle) if above else (middle, high)
    return [1.0 / (1.0 + math.exp(-o - high)) for o in odds]


@functools.cache
def stored() -> dict[str, Any]:
    """Return the rates that `python -m cosim.training joint` wrote."""
    return json.loads(resources.files("fdi").joinpath("thresholds", "joint.json").read_text(encoding="utf-8"))


def rows(found: list[Hypothesis], technology: dict[str, str], rates: dict) -> tuple[np.ndarray, ...]:
    """Return (row (hypothesis, lane), alarm (rows, size and variant), said (rows, variant, phase, 1 + tokens),
    by_age (rows, age)).

    `technology` is {one of SEGMENTS: technology}. A variant is measured, or believed by the records alone.
    """
    common = next(iter(technology.values()), "hydraulic")
    most = 1 + max(len(names(d)) for d in (*LOCAL, *AIRCRAFT))
    phases = range(len(PHASES))
    kept = {(detector, k): keeps(detector, rates, k) for detector in (*LOCAL, *AIRCRAFT) for k in phases}
    of_kind: dict[tuple, tuple] = {}
    index: dict[bytes, int] = {}
    row = np.zeros((len(found), len(LANES)))
    made: list[tuple[np.ndarray, ...]] = []
    for i, h in enumerate(found):
        for j, (detector, lane) in enumerate(LANES):
            seen, own = lane in WIDE or lane in h.segments, h
            if seen and lane not in WIDE and len(h.segments) > 1:  # a segment's own filters cannot tell whose command
                own = Hypothesis(h.place, h.verdict, f"{technology[lane]}.{h.kind.partition('.')[2]}", (lane,))
            share = (SECOND if lane == "second" else 1.0) if seen else 0.0
            key = (detector, share, *((own.kind, own.side, own.place if lane in WIDE else "") if seen else ()))
            if key not in of_kind:
                of_kind[key] = _row(detector, own if seen else None, common, kept, rates, share, most)
            content = b"".join(part.tobytes() for part in of_kind[key])
            if content not in index:
                index[content] = len(made)
                made.append(of_kind[key])
            row[i, j] = index[content]
    return row, *(np.array(part) for part in zip(*made, strict=True))


def _row(detector, hypothesis, technology, kept, rates, share, most):
    """Return (alarm, said, by_age) of a row of the tables; without a hypothesis of a lane that does not look at it."""
    phases, number = range(len(PHASES)), len(names(detector))
    alarm, said = np.zeros(6), np.zeros((2, len(phases), number))
    late = by_age(detector, "", rates)
    if hypothesis:
        for k in phases:
            how = detector, hypothesis, technology, kept[detector, k]
            both = [measured(*how, rates, k), believed(*how)]
            said[:, k] = [s for _, s in both]
        alarm = np.concatenate([a for a, _ in both]) * share
        late = by_age(detector, hypothesis.kind, rates)
    of_v = alarm.reshape(2, 3).mean(axis=1)[:, None, None]  # beside a fault an alarm may be false, and says anything
    said = (of_v * said + false(detector)) / (of_v + ELSEWHERE)
    return 1.0 - (1.0 - alarm) * (1.0 - ELSEWHERE), padded(said, (2, len(phases), most), 1), late


def false(detector: str) -> float:
    """Return P(a false alarm with one name) of a lane."""
    return ELSEWHERE / len(names(detector))


def alone(rates: dict) -> np.ndarray:
    """Return (lane, phase): odds of a fault to none where only one detector has spoken, and in this phase still does.

    R FAULTS over the rate of its false alarms that stand so long; R = P(it is alone until the last phase | a fault):
    where a second one comes by then nothing is lost by waiting for it.
    """
    out = []
    for detector, _ in LANES:
        stays, faults, *stood, minutes = rates.get("alone", {}).get(detector, (0.0,) * (3 + len(PHASES)))
        right = (FEW * ALONE[level(detector)] + stays) / (FEW + faults)
        wrong = (FEW * np.array(STANDS) + np.array(stood)) / (FEW / FALSE + minutes)
        out.append(FAULTS * right / wrong)
    return np.array(out)


def by_age(detector: str, kind: str, rates: dict) -> np.ndarray:
    """Return (age,): P(alarm by then | alarm), after the first witness; without rates within a second or two, of a kind
    that nobody has counted as of all."""
    late = 1.0 - np.exp(-(np.array(AGES) + 0.1))
    for *counted, alarms in (
        rates.get("late", {}).get(detector, [0.0] * (len(AGES) + 1)),
        rates.get("seen", {}).get(detector, {}).get(kind, {}).get("late", [0.0] * (len(AGES) + 1)),
    ):
        late = (LATE * late + np.array(counted)) / (LATE + alarms)
    return late


def padded(values: np.ndarray, shape: tuple[int, ...], first: int = 0) -> np.ndarray:
    """Return an array of `shape` with `values` in its first corner, zeros beyond; on the last axis from `first` on."""
    out = np.zeros(shape)
    at = [slice(n) for n in values.shape]
    at[-1] = slice(first, first + values.shape[-1])
    out[tuple(at)] = values
    return out


def twins(found: list[Hypothesis], technology: dict[str, str]) -> np.ndarray:
    """Return (hypothesis, lane): 1 + the lane before it of the same detector that the same command moves, else 0.

    It is on a segment of the same technology: what a detector sees of one is no more than a hint of the other.
    """
    out = np.zeros((len(found), len(LANES)))
    for i, h in enumerate(found):
        for j, (detector, lane) in enumerate(LANES):
            alike = [s for s in h.segments if technology[s] == technology.get(lane)]
            before = [k for k in range(j) if LANES[k][0] == detector and LANES[k][1] in alike]
            out[i, j] = 1.0 + before[-1] if before and lane in h.segments else 0.0
    return out


def prior(found: list[Hypothesis]) -> np.ndarray:
    """Return P(h): every place alike, every class of a place, and every cause of a class."""
    classes = {h.place: {g.verdict for g in found if g.place == h.place} for h in found}
    causes = Counter((h.place, h.verdict) for h in found)
    share = [1.0 / (len(classes[h.place]) * causes[h.place, h.verdict]) for h in found]
    return np.array(share) / len(classes)
