"""A flight in sentences: what broke, who noticed, when, as what, who did not and why; for terminal and page.

`found` is what Result.to_dict returns, or a part of it: detectors, sim_time_s, achieved, not_run.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from cosim.judge import coverage
from cosim.judge.lanes import part, seconds
from cosim.scenario import Scenario

# As published these alarm in every flight: they stay in log, JSON and tables, and no sentence counts them.
APART = {"ema_kalman": "alarms always, it knows no load"}
LEVELS = {"local": "actuator", "aircraft": "aircraft", "both": "joint"}
RISE = 1.05  # a residual that grew by less than this factor is said not to have risen

MASKED = "(masked by the standing alarm of an earlier fault)"
OTHERS = ", with the other faults"
LITTLE, MUCH = 0.8, 1.25  # achieved over asked, beyond which a note says so

WHY = {  # place of entry -> why the elevator moves otherwise
    "valve": "valve or drive can do so much, and the servo works against it",
    "command": "the servo follows a fast command in part, or overshoots",
    "sensor": "the servo follows a fast reading in part, or overshoots",
}

def sentences(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a sentence per fault of `scenario` that began within the flight; one about false alarms without any.

    It tells what broke, when and how large, the first alarm and its level, the right name, the first alarm at the other
    level.
    """
    lanes = _lanes(found)
    began = _began(found, scenario)
    if not lanes:
        return []
    if not began:
        return [_without_fault(lanes)]
    lead = (lambda i: f"Fault {i}: ") if len(scenario.faults) > 1 else (lambda i: "")
    cases, lost = coverage.cases(scenario), found.get("not_run") or {}
    return [f"{lead(i)}{broke(scenario, i, found.get('achieved'))}: {_heard(i, lanes, cases[i], lost)}." for i in began]


def silent(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a line per fault about the detectors designed for it that did not alarm, and why."""
    lanes, cases = _lanes(found), coverage.cases(scenario)
    lead = (lambda i: f"fault {i}: ") if len(scenario.faults) > 1 else (lambda i: "")
    told = [(i, _silent(i, cases[i], lanes)) for i in _began(found, scenario)] if lanes else []
    return [lead(i) + text for i, text in told if text]


def faults(scenario: Scenario, achieved: Mapping | None) -> list[tuple[str, str]]:
    """Return (line, note) about each fault of `scenario`: where it entered, and how far the elevator moved; the note
    says where that is not what was asked for. `achieved` {segment: peaks and amplitudes}, or None."""
    out = []
    for i, f in enumerate(scenario.faults):
        own = _own(f)
        until = "" if f.end_s is None else f" to {f.end_s:g} s"
        at = f.entry(scenario.elevator.technology)
        where = "".join(f" {w} {v}" for w, v in (("at", at), ("path", f.path)) if v)
        began = f.start_s < scenario.duration_s
        onset = f"from {f.start_s:g} s{until}" if began or f.when is None else "which never began"
        text = f"{f.kind} on {f.target}{where}, {onset}{'' if f.when is None else f', when {f.when}'}"
        reached, note = _achieved(scenario, i, _moved(f, achieved)) if began else ("", "")
        out.append((f"{text}{f'  ({own})' if own else ''}{reached}", note))
    return out


def broke(scenario: Scenario, i: int, achieved: Mapping | None) -> str:
    """Return what fault `i` broke, when, and how large it became, or what was asked for where no elevator moved."""
    f = scenario.faults[i]
    reached = _achieved(scenario, i, _moved(f, achieved))[0]
    size = reached.removeprefix("; achieved ").removesuffix(OTHERS) or _own(f)
    return f"{f.kind} on {f.target} from {f.start_s:g} s" + (f", {size}" if size else "")


def consequences(f: Mapping[str, float] | None) -> str:
    """Return what the faults did to the aircraft; nothing without a fault that began."""
    if not f:
        return ""
    outside = f"{f['outside_s']:.1f} s out of bounds" if f["outside_s"] else "within bounds"
    return (
        f"n_z {f['nz_min_g']:.2f} to {f['nz_max_g']:.2f} g, {f['altitude_lost_m']:.0f} m lost, "
        f"bank {f['bank_deg']:.1f} deg, speed -{f['speed_lost_kt']:.0f} +{f['speed_gained_kt']:.0f} kt, "
        f"hinge {f['hinge_max_nm'] / 1e3:.1f} kN m, {outside}"
    )


def point(scenario: Scenario) -> str:
    """Return where a flight begins, through which air, with which manoeuvre."""
    f, m = scenario.flight, scenario.manoeuvre
    return ", ".join(filter(None, (f.point, f.path, f.weather, m.kind.replace("_", " "))))


def noticed(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a line per lane and fault that it noticed, the soonest first."""
    told = [(e["detected_at_s"], d, e) for i in _began(found, scenario) for d, e in _entries(i, found["detectors"])
            if e.get("detection_delay_s") is not None]  # fmt: skip
    of = (lambda e: f" of fault {e['fault']}") if len(scenario.faults) > 1 else (lambda e: "")
    out = []
    for _, d, e in sorted(told, key=_soonest):
        said = "no name" if not e["isolated"] else f"{e['isolated']['class']} {part(d, e)}".strip()
        named = e["time_to_right_s"]
        right = f"right name after {seconds(named)} s" if named is not None else "no right name"
        who = f"{d['id']} {part(d)}".removesuffix(" aircraft") + f" ({LEVELS[d['level']]} level)"
        out.append(f"{who} after {seconds(e['detection_delay_s'])} s{of(e)}, {right}; said last: {said}")
    return out


def false(found: Mapping[str, Any]) -> list[str]:
    """Return a line per lane with false alarms, or one that there are none."""
    loud = [d for d in found["detectors"] if d["false_alarms"] or d["standing_s"]]
    return [f"{d['id']} {part(d)}: {d['false_alarms']} false alarm{'s' * (d['false_alarms'] != 1)}, "
            f"{d['standing_s']:.1f} s of alarm without a fault" for d in loud] or [
            f"no false alarm of {len(found['detectors'])} detector lanes"]  # fmt: skip


def _moved(fault, achieved):
    return {n: (achieved or {})[n] for n in _segments(fault) if n in (achieved or {})}


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


def _soonest(told):
    """Return what (time, lane, ...) is ordered by: in the same tick who has heard others comes after them."""
    return told[0], told[1]["level"] == "both"


def _not_run(level, lanes, case, lost):
    """Return why no detector of `level` that could see `case` flew, or "": one did, or none was lost of {id: why}."""
    able = (coverage.DESIGNED, coverage.MAY)
    flown = any(coverage.expected(d["id"], case) in able for d in lanes if d["level"] == level)
    why = {lost[n]: n for n in lost if coverage.level(n) == level and coverage.expected(n, case) in able}
    return "" if flown or not why else f"{LEVELS[level]} level not run: {'; '.join(why)}"


def _heard(i, lanes, case, lost):
    """Return who noticed fault `i` first, who named it right first, and who was first at the other level."""

    def first(key, level=None):
        told = [(e[key], d) for d, e in _entries(i, lanes) if e.get(key) is not None and level in (None, d["level"])]
        return min(told, key=_soonest, default=(None, None))

    late, lane = first("detection_delay_s")
    if lane is None:
        away = (_not_run(level, lanes, case, lost) for level in ("local", "aircraft"))
        return "; ".join(["no alarm", *filter(None, away)])
    named, by = first("time_to_right_s")
    other = "local" if lane["level"] == "aircraft" else "aircraft"
    then, elsewhere = first("detection_delay_s", other)
    text = f"first alarm after {seconds(late)} s by {lane['id']} ({LEVELS[lane['level']]} level)"
    text += f", right name after {seconds(named)} s" if by else ", no right name"
    text += f" by {by['id']}" if by and by["id"] != lane["id"] else ""
    if not elsewhere and (away := _not_run(other, lanes, case, lost)):
        text += f"; {away}"
    elif any(d["level"] == other for d in lanes):
        at = f"{LEVELS[other]} level"
        text += f"; {at} after {seconds(then)} s by {elsewhere['id']}" if elsewhere else f"; {at} no alarm"
    return text


def _silent(i, case, lanes):
    made = list(dict.fromkeys(d["id"] for d in lanes if coverage.expected(d["id"], case) == coverage.DESIGNED))
    if not made:
        return "no detector in this flight is designed for this fault"
    seen = {d["id"] for d, e in _entries(i, lanes) if e.get("detection_delay_s") is not None}
    away = {name: why for name in made if name not in seen and (why := _away(i, lanes, name)) is not None}
    reasons: dict[str, list[str]] = {}
    for name in (name for name in made if name not in seen and name not in away):
        masked = any(e.get("masked") for d, e in _entries(i, lanes) if d["id"] == name)
        reasons.setdefault(MASKED if masked else _why(*_peak(lanes, name)), []).append(name)
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


def _own(fault):
    given = (fault.model_extra or {}).items()
    return ", ".join(f"{k} {v:g}" for k, v in given if not (k == "phase_deg" and v == 0.0))


def _segments(fault):
    """Return the elevator segments that a fault acts on; none for one that only a monitor sees."""
    on = fault.parsed.place in ("elevator", "actuator_sensor") and fault.path != "monitor"
    return fault.parsed.names if on else ()


def _achieved(scenario, i, moved):
    """Return (words for how far fault `i` moved its segments `moved`, a note where that is not what was asked for)."""
    f, extra = scenario.faults[i], scenario.faults[i].model_extra or {}
    if not moved:
        return "", ""
    swings = all(m["amplitude_deg"] is not None for m in moved.values())
    keys = ("amplitude_mm", "amplitude_deg") if swings else ("rod_mm", "surface_deg")
    given = {key: [m[key] for m in moved.values() if m[key] is not None] for key in keys}
    found = [f"{_span(v)} {key.rpartition('_')[2]}" for key, v in given.items() if v]
    if not found:
        return "", ""
    others = any(set(_segments(g)) & moved.keys() for j, g in enumerate(scenario.faults) if j != i)
    words = f"; achieved {'' if swings else 'at most '}{', '.join(found)}{OTHERS * others}"
    if others or not (swings and f.kind.startswith("ofc")):  # of several faults only their sum is known
        return words, ""
    travel = extra["amplitude_travel"] * math.degrees(scenario.aircraft.travel) if "amplitude_travel" in extra else None
    for key, asked in zip(keys, (extra.get("amplitude_mm"), extra.get("amplitude_deg", travel))):
        if asked and given[key] and not all(LITTLE <= v / asked <= MUCH for v in given[key]):
            unit = key.rpartition("_")[2]
            share = " to ".join(dict.fromkeys(f"{100.0 * v / asked:.0f}" for v in (min(given[key]), max(given[key]))))
            return words, f"faults.{i}: asked for {asked:g} {unit}, achieved {share} % of it; {WHY[f.at]}"
    return words, ""


def _span(values):
    """Return "6.0", or "5.1 to 6.0" of several segments."""
    low, high = (f"{v:.1f}" if v >= 1.0 else f"{v:.2g}" for v in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
