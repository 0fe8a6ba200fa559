"""The first words of a run: who noticed the fault, how soon, what was said, who was made for it and did not."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from cosim.judge import coverage
from cosim.judge.naming import outcome
from cosim.scenario import Scenario

# As published these alarm in every flight: they stay in log, JSON and tables, and no sentence counts them.
APART = {"ema_kalman": "alarms always, it knows no load"}
RISE = 1.05  # a residual that grew by less than this factor is said not to have risen


def sentences(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a sentence per fault of `scenario` that began within the flight; one about false alarms without any.

    `found` is what Result.to_dict returns.
    """
    lanes = [d for d in found["detectors"] if d["id"] not in APART]
    if not lanes:
        return []
    cases = coverage.cases(scenario)
    began = [i for i, f in enumerate(scenario.faults) if f.start_s < found["sim_time_s"]]
    if not began:
        return [_without_fault(lanes)]
    lead = (lambda i: f"Fault {i}: ") if len(scenario.faults) > 1 else (lambda i: "")
    return [lead(i) + _about(i, cases[i], lanes) for i in began]


def _without_fault(lanes):
    loud = list(dict.fromkeys(d["id"] for d in lanes if d["alarm"]))
    said = f"false alarms of {listed(loud)}" if loud else "and no detector alarmed"
    return f"No fault, {said}."


def _about(i, case, lanes):
    """Return the sentence about fault `i` of case `case`."""
    seen: dict[str, dict] = {}
    for lane in lanes:
        for entry in lane.get("by_fault") or [lane]:
            if entry.get("fault", i) == i and entry.get("detection_delay_s") is not None:
                before = seen.get(lane["id"])
                if before is None or entry["detection_delay_s"] < before["detection_delay_s"]:
                    seen[lane["id"]] = entry
    first, *others = sorted(seen, key=lambda name: seen[name]["detection_delay_s"]) or [""]
    made = list(dict.fromkeys(d["id"] for d in lanes if coverage.expected(d["id"], case).word == coverage.DESIGNED))
    if first:
        text = f"{first} noticed after {seen[first]['detection_delay_s']:.2f} s and {_said(first, case, seen[first])}"
        if others:
            text += ", then " + listed(
                f"{n} after {seen[n]['detection_delay_s']:.2f} s{_word(seen[n])}" for n in others
            )
    else:
        text = "Nobody noticed"
    away = {name: why for name in made if name not in seen and (why := _away(i, lanes, name)) is not None}
    reasons: dict[str, list[str]] = {}
    for name in (name for name in made if name not in seen and name not in away):
        reasons.setdefault(_why(*_peak(lanes, name)), []).append(name)
    told = [f"{listed(names)} {why}" for why, names in reasons.items()]
    told += [f"{name} could not judge ({why})" for name, why in away.items()]
    if told:
        text += f". Made for this and silent: {'; '.join(told)}"
    elif not made:
        text += "; no detector in this flight is made for this fault"
    return text + "."


def _away(i, lanes, name):
    """Return why detector `name` could not judge fault `i`, in words; None where one of its lanes could."""
    mine = [e for d in lanes if d["id"] == name and d.get("concerned", True) for e in d.get("by_fault") or [d]]
    mine = [e for e in mine if e.get("fault", i) == i]
    if not mine or any(e.get("able", True) for e in mine):
        return None
    why = next((e["why_not_valid"] for e in mine if e.get("why_not_valid")), None)
    return f"not valid: {why}" if why else "not valid"


def _said(name, case, entry):
    found = entry["isolated"]
    if not found or found["class"] == "ambiguous":
        return "did not name it"
    wrong = outcome(name, case, seen=True, is_right=entry.get("right"), verdict=found["class"]) == "misnamed"
    late = entry.get("time_to_right_s")
    when = f" after {late:.2f} s" if late is not None and late > entry["detection_delay_s"] + 0.005 else ""
    return f"said {found['class']}{when}" + ", which is wrong" * wrong


def _word(entry):
    first, last = ((entry.get(key) or {}).get("class") for key in ("first_verdict", "isolated"))
    if not last:
        return ""
    return f" ({last})" if first in (None, last) else f" ({first}, at last {last})"


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
