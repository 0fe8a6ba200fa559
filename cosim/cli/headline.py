"""The first sentence of a run: what broke, the first alarm at each level, the right name; who missed it, and why."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from cosim.cli import faults
from cosim.judge import coverage
from cosim.scenario import Scenario

# As published these alarm in every flight: they stay in log, JSON and tables, and no sentence counts them.
APART = {"ema_kalman": "alarms always, it knows no load"}
LEVELS = {"local": "actuator", "aircraft": "aircraft"}
RISE = 1.05  # a residual that grew by less than this factor is said not to have risen


def sentences(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a sentence per fault of `scenario` that began within the flight; one about false alarms without any.

    It tells what broke, when and how large, the first alarm and its level, the right name, the first alarm at the other
    level. `found` is what Result.to_dict returns.
    """
    lanes = _lanes(found)
    began = _began(found, scenario)
    if not lanes:
        return []
    if not began:
        return [_without_fault(lanes)]
    lead = (lambda i: f"Fault {i}: ") if len(scenario.faults) > 1 else (lambda i: "")
    return [f"{lead(i)}{faults.broke(scenario, i, found.get('achieved'))}: {_heard(i, lanes)}." for i in began]


def silent(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a line per fault about the detectors designed for it that did not alarm, and why; `found` as above."""
    lanes, cases = _lanes(found), coverage.cases(scenario)
    lead = (lambda i: f"fault {i}: ") if len(scenario.faults) > 1 else (lambda i: "")
    told = [(i, _silent(i, cases[i], lanes)) for i in _began(found, scenario)] if lanes else []
    return [lead(i) + text for i, text in told if text]


def _lanes(found):
    return [d for d in found["detectors"] if d["id"] not in APART]


def _began(found, scenario):
    return [i for i, f in enumerate(scenario.faults) if f.start_s < found["sim_time_s"]]


def _without_fault(lanes):
    loud = list(dict.fromkeys(d["id"] for d in lanes if d["alarm"]))
    said = f"false alarms of {listed(loud)}" if loud else "and no detector alarmed"
    return f"No fault, {said}."


def _entries(i, lanes):
    """Return (lane, entry of fault `i`) of the lanes that the fault concerns."""
    mine = ((d, e) for d in lanes if d.get("concerned", True) for e in d.get("by_fault") or [d])
    return [(d, e) for d, e in mine if e.get("fault", i) == i]


def _heard(i, lanes):
    """Return who noticed fault `i` first, who named it right first, and who was first at the other level."""

    def first(key, level=None):
        told = [(e[key], d) for d, e in _entries(i, lanes) if e.get(key) is not None and level in (None, d["level"])]
        return min(told, key=lambda one: one[0], default=(None, None))

    late, lane = first("detection_delay_s")
    if lane is None:
        return "no alarm"
    named, by = first("time_to_right_s")
    other = "local" if lane["level"] == "aircraft" else "aircraft"
    then, elsewhere = first("detection_delay_s", other)
    text = f"first alarm after {late:.2f} s by {lane['id']} ({LEVELS[lane['level']]} level)"
    text += f", right name after {named:.2f} s" if by else ", no right name"
    text += f" by {by['id']}" if by and by["id"] != lane["id"] else ""
    if any(d["level"] == other for d in lanes):
        at = f"{LEVELS[other]} level"
        text += f"; {at} after {then:.2f} s by {elsewhere['id']}" if elsewhere else f"; {at} no alarm"
    return text


def _silent(i, case, lanes):
    made = list(dict.fromkeys(d["id"] for d in lanes if coverage.expected(d["id"], case).word == coverage.DESIGNED))
    if not made:
        return "no detector in this flight is designed for this fault"
    seen = {d["id"] for d, e in _entries(i, lanes) if e.get("detection_delay_s") is not None}
    away = {name: why for name in made if name not in seen and (why := _away(i, lanes, name)) is not None}
    reasons: dict[str, list[str]] = {}
    for name in (name for name in made if name not in seen and name not in away):
        reasons.setdefault(_why(*_peak(lanes, name)), []).append(name)
    told = [f"{listed(names)} {why}" for why, names in reasons.items()]
    told += [f"{name} could not judge ({why})" for name, why in away.items()]
    return f"designed for this fault, no alarm: {'; '.join(told)}" if told else ""


def _away(i, lanes, name):
    """Return why detector `name` could not judge fault `i`, in words; None where one of its lanes could."""
    mine = [e for d, e in _entries(i, lanes) if d["id"] == name]
    if not mine or any(e.get("able", True) for e in mine):
        return None
    why = next((e["why_not_valid"] for e in mine if e.get("why_not_valid")), None)
    return f"not valid: {why}" if why else "not valid"


def _peak(lanes, name):
    """Return the largest |r| over its threshold (before the fault, after its onset) among the lanes of a detector that
    the fault concerns; NaN where there is none."""
    mine = [d for d in lanes if d["id"] == name and d.get("concerned", True)]
    pairs = [[math.nan if d.get(k) is None else d[k] for k in ("r_max_before", "r_max_after")] for d in mine]
    return max(pairs, key=lambda p: p[1], default=[math.nan, math.nan])


def _why(before, after):
    """Return why a detector with these largest statistics was silent, 1 is the threshold."""
    if math.isnan(after):
        return "(not valid)"
    if after <= RISE * before:
        return "(statistic did not rise)"
    return f"(statistic came to {after:.0%} of its threshold)" if after < 1.0 else "(alarm not confirmed)"


def apart(found: Mapping[str, Any]) -> list[str]:
    """Return a line per detector that flew and stands apart."""
    flew = {d["id"] for d in found["detectors"]}
    return [f"{name}, as published: {text}" for name, text in APART.items() if name in flew]


def listed(items: Iterable[str]) -> str:
    """Return "a, b and c"."""
    *most, last = items
    return f"{', '.join(most)} and {last}" if most else last
