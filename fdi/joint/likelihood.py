"""P(token | hypothesis): rates counted in flights, and the detectors' records where nobody has flown a fault.

A lane's token is what its detector says: verdict class, part, and what it tells beyond the class. Against a hypothesis
a token is silence, the right name, an open one, or a wrong one. How often a detector does each of these is counted over
all kinds of fault that its record puts alike (designed for, may see, blind) and shared among the tokens of an outcome;
the kind's own counts move that as a Dirichlet distribution that is worth WEIGHT flights. Counts are taken from the
first alarm on (cosim/training/train_joint.py), apart until it is YOUNG old and later: many a name takes its time.
"""

import fnmatch
import functools
import itertools
import json
from importlib import resources
from typing import Any

import numpy as np

from fdi import registry
from fdi.common.verdict import NAMES
from fdi.joint.hypotheses import AIRCRAFT, LANES, LOCAL, SEGMENTS, TECHNOLOGIES, Hypothesis, hypotheses, turned

Token = tuple[str, str, str]  # verdict class, part, word
SILENT: Token = ("", "", "")
Seen = dict[str, dict[str, dict[str, float]]]  # {detector: {key of a hypothesis: {token: flights}}}
Rates = tuple[Seen, Seen]  # while an alarm is young, and later
OUTCOMES = ("silent", "right", "open", "wrong")
WEIGHT = 3.0  # flights that the record counts for
YOUNG = 2.0  # an alarm is young for so long [s]; of 1, 1.5, 2 and 4 chosen on the training flights
FALSE = 3e-4  # P(a false alarm of a lane): a quarter of the 1e-3 per minute that a detector is trained to
# share of each of OUTCOMES before any count, as FIRST flights
FIRST = 3.0
SHARES = {"designed": (0.2, 0.6, 0.15, 0.05), "may": (0.6, 0.15, 0.2, 0.05), "blind": (0.99, 0.0, 0.005, 0.005)}


@functools.cache
def words(detector: str) -> tuple[str, ...]:
    """Return what a detector tells beyond class and part: kinds joined by commas, or a part; the first: nothing."""
    return ("", *dict.fromkeys(word(w) for of in registry.record(detector).finer.values() for w in of.values() if w))


def word(told: tuple[str, ...] | str) -> str:
    """Return a value of `Detector.finer` as a word."""
    return told if isinstance(told, str) else ",".join(told)


def token(detector: str, verdict: str, isolated_part: str, told: str) -> Token:
    """Return the token of what a lane says; of its parts stays what a detector of its level means by them."""
    if told.startswith("elevator"):
        return verdict, told, ""
    if detector in LOCAL and verdict != "sensor":
        isolated_part = ""
    return verdict, isolated_part, told if verdict == "effectiveness" else ""


@functools.cache
def tokens(detector: str) -> tuple[Token, ...]:
    """Return all tokens of a detector, silence first."""
    record, parts = registry.record(detector), registry.module(detector).ISOLABLE_PARTS
    said = {v for cases in (record.designed_for, record.may_see) for of in cases.values() for v in of} | {"ambiguous"}
    every = itertools.product([v for v in NAMES if v in said], parts, words(detector))
    return (SILENT, *dict.fromkeys(token(detector, *one) for one in every))


def index(detector: str, verdict: str, isolated_part: str, told: str) -> int:
    """Return the index in `tokens` of what a lane says; a class that its record does not have counts as open."""
    every, one = tokens(detector), token(detector, verdict, isolated_part, told)
    return every.index(one) if one in every else every.index(token(detector, "ambiguous", isolated_part, told))


@functools.cache
def relation(detector: str, case: str) -> tuple[str, tuple[str, ...]]:
    """Return (designed, may or blind; the classes of its record) of a detector for a case."""
    record = registry.record(detector)
    for how, table in (("designed", record.designed_for), ("may", record.may_see)):
        for pattern, classes in table.items():
            if fnmatch.fnmatchcase(case, pattern):
                return how, tuple(c for c in classes if c != "ambiguous")
    return "blind", ()


def outcomes(detector: str, h: Hypothesis) -> np.ndarray:
    """Return (tokens,): index into OUTCOMES of every token of a detector against a hypothesis."""
    classes = [c for c in relation(detector, h.case)[1] if h.segments or c == h.verdict]
    parts = _parts(detector, h)
    kind = h.case.partition(".")[2].partition("@")[0]
    out = []
    for verdict, isolated_part, told in tokens(detector):
        fits = not isolated_part or isolated_part in parts
        if not verdict:
            out.append(0)
        elif not fits or (told and kind not in told.split(",")):
            out.append(3)
        elif verdict in classes and (isolated_part or detector in LOCAL):
            out.append(1)
        else:
            out.append(2 if verdict == "ambiguous" or verdict in classes else 3)
    return np.array(out)


def _parts(detector, h):
    """Return the isolable_parts of a detector that are right for a hypothesis; one equation's are as right."""
    if h.segments and detector in LOCAL:
        return {h.names[0].removesuffix("_sensor").rpartition("_")[2]} if h.verdict == "sensor" else {""}
    parts = {n for n in h.names if n}
    if h.segments and not h.names[1] and not h.names[2]:
        parts |= {"elevator_left", "elevator_right", "elevator_left and elevator_right"}
    return parts


# of every key one hypothesis on the left, of one segment on left_inner, as rates are counted
_CANON = {
    h.key: h
    for t in TECHNOLOGIES
    for h in hypotheses(dict.fromkeys(SEGMENTS, t))
    if h.segments in ((), ("left_inner",)) or (len(h.segments) > 1 and h.segments[0] == "left_outer")
}


def pooled(detector: str, rates: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return {relation: share of each of OUTCOMES (4,)}, counted over all kinds."""
    flights = {how: FIRST * np.array(shares) for how, shares in SHARES.items()}
    for key, cell in rates.get(detector, {}).items():
        h = _CANON[key]
        kinds, every = outcomes(detector, h), tokens(detector)
        for text, n in cell.items():
            flights[relation(detector, h.case)[0]][kinds[every.index(tuple(text.split("|")))]] += n
    return {how: n / n.sum() for how, n in flights.items()}


def likelihood(detector: str, h: Hypothesis, rates: dict[str, Any], shares: dict[str, np.ndarray]) -> np.ndarray:
    """Return (tokens,): P(token | h) of a lane that the fault of `h` concerns; `shares` as of `pooled`."""
    kinds, every = outcomes(detector, h), tokens(detector)
    share = shares[relation(detector, h.case)[0]]
    base = share[kinds] / np.bincount(kinds, minlength=4)[kinds]
    base /= base.sum()
    counts = np.zeros(len(every))
    for text, n in rates.get(detector, {}).get(h.key, {}).items():
        verdict, isolated_part, told = text.split("|")
        counts[every.index((verdict, turned(isolated_part, h.segments), told))] += n
    return (WEIGHT * base + counts) / (WEIGHT + counts.sum())


def false(detector: str) -> np.ndarray:
    """Return (tokens,): P(token) of a lane that a fault does not concern."""
    p = np.full(len(tokens(detector)), FALSE / (len(tokens(detector)) - 1))
    p[0] = 1.0 - FALSE
    return p


def rows(found: list[Hypothesis], here: dict[str, str], rates: Rates) -> tuple[np.ndarray, np.ndarray]:
    """Return (row (hypothesis, lane), P(token | row) (3, rows, most tokens): while an alarm is young, later, and of the
    record alone); `here` is {one of SEGMENTS: technology}."""
    flown: tuple[Seen, ...] = (*rates, {})
    shares = [{d: pooled(d, of) for d in (*LOCAL, *AIRCRAFT)} for of in flown]
    most = max(len(tokens(d)) for d in shares[0])
    made: list[np.ndarray] = []
    where: dict[tuple, int] = {}
    row = np.zeros((len(found), len(LANES)))
    for i, h in enumerate(found):
        for j, (d, lane) in enumerate(LANES):
            concerned = lane == "aircraft" or lane in h.segments
            own = h.on(lane, here[lane]) if concerned and lane != "aircraft" else h
            key = (d, own.key, own.names if lane == "aircraft" else own.verdict) if concerned else (d,)
            if key not in where:
                p = np.array([likelihood(d, own, of, share[d]) for of, share in zip(flown, shares)] if concerned else
                             [false(d)] * 3)  # fmt: skip
                p = (1.0 - FALSE) * p + FALSE * false(d)
                where[key] = len(made)
                made.append(np.pad(p, ((0, 0), (0, most - p.shape[1]))))
            row[i, j] = where[key]
    return row, np.stack(made, axis=1)


@functools.cache
def stored() -> Rates:
    """Return the rates that `python -m cosim.training joint` wrote."""
    seen = json.loads(resources.files("fdi").joinpath("thresholds", "joint.json").read_text("utf-8"))["seen"]
    return seen["young"], seen["later"]
