"""A flight in sentences: what broke, who noticed, when, as what, who did not and why; for terminal and page.

`found` is what Result.to_dict returns, or a part of it: detectors, sim_time_s, achieved, not_run.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from cosim.judge import coverage
from cosim.judge.lanes import entries, part, seconds
from cosim.scenario import Scenario

LEVELS = {"local": "actuator", "aircraft": "aircraft", "both": "joint"}
RISE = 1.05  # a residual that grew by less than this factor is said not to have risen
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
    lanes, began = found["detectors"], _began(found, scenario)
    if not lanes:
        return []
    if not began:
        loud = list(dict.fromkeys(d["id"] for d in lanes if d["alarm"]))
        return [f"No fault, {f'false alarms of {listed(loud)}' if loud else 'and no detector alarmed'}."]
    lead = "Fault {}: " if len(scenario.faults) > 1 else ""
    cases, lost = coverage.cases(scenario), found.get("not_run") or {}
    return [f"{lead.format(i)}{_broke(scenario, i, found.get('achieved'))}: {_heard(i, lanes, cases[i], lost)}."
            for i in began]  # fmt: skip


def silent(found: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """Return a line per fault about the detectors designed for it that did not alarm, and why."""
    lanes, cases, out = found["detectors"], coverage.cases(scenario), []
    lead = "fault {}: " if len(scenario.faults) > 1 else ""
    for i in _began(found, scenario) if lanes else ():
        designed = [n for n in dict.fromkeys(d["id"] for d in lanes) if coverage.expected(n, cases[i]) == "designed"]
        why = {n: _why([e for e in _entries(i, lanes) if e["id"] == n]) for n in designed}
        told = [f"{listed(n for n in why if why[n] == text)} {text}" for text in dict.fromkeys(why.values()) if text]
        if told or not designed:
            said = f"designed for this fault, no alarm: {'; '.join(told)}"
            out.append(lead.format(i) + (said if designed else "no detector in this flight is designed for this fault"))
    return out


def faults(scenario: Scenario, achieved: Mapping | None) -> list[tuple[str, str]]:
    """Return (line, note) about each fault of `scenario`: where it entered, and how far the elevator moved; the note
    says where that is not what was asked for. `achieved` {segment: peaks and amplitudes}, or None."""
    out = []
    for i, f in enumerate(scenario.faults):
        own, began = _own(f), f.start_s < scenario.duration_s
        until = "" if f.end_s is None else f" to {f.end_s:g} s"
        places = ("at", f.entry(scenario.elevator.technology)), ("path", f.path)
        where = "".join(f" {word} {value}" for word, value in places if value)
        onset = f"from {f.start_s:g} s{until}" if began or f.when is None else "which never began"
        text = f"{f.kind} on {f.target}{where}, {onset}{'' if f.when is None else f', when {f.when}'}"
        size, note = _achieved(scenario, i, achieved) if began else ("", "")
        out.append((text + (f"  ({own})" if own else "") + (f"; achieved {size}" if size else ""), note))
    return out


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


def false(found: Mapping[str, Any]) -> list[str]:
    """Return a line per lane with false alarms, or one that there are none."""
    loud = [d for d in found["detectors"] if d["false_alarms"] or d["standing_s"]]
    return [f"{d['id']} {part(d)}: {d['false_alarms']} false alarm{'s' * (d['false_alarms'] != 1)}, "
            f"{d['standing_s']:.1f} s of alarm without a fault" for d in loud] or [
            f"no false alarm of {len(found['detectors'])} detector lanes"]  # fmt: skip


def listed(items: Iterable[str]) -> str:
    """Return "a, b and c"."""
    *most, last = items
    return f"{', '.join(most)} and {last}" if most else last


def _began(found, scenario):
    return [i for i, f in enumerate(scenario.faults) if f.start_s < found["sim_time_s"]]


def _entries(i, lanes):
    """Return what each lane that fault `i` concerns made of it, beside what the lane is."""
    return [e for e in entries(d for d in lanes if d.get("concerned", True)) if e.get("fault", i) == i]


def _heard(i, lanes, case, lost):
    """Return who noticed fault `i` first, who named it right first, who was first at the other level, and the last
    verdict of both."""
    met = _entries(i, lanes)

    def first(key, *levels):
        told = [e for e in met if e.get(key) is not None and e["level"] in levels]
        # in the same tick who has heard others comes after them
        return min(told, key=lambda e: (e[key], e["level"] == "both"), default=None)

    alarm, name = first("detection_delay_s", *LEVELS), first("time_to_right_s", *LEVELS)
    if alarm is None:
        away = (_not_run(level, lanes, case, lost) for level in ("local", "aircraft"))
        return "; ".join(["no alarm", *filter(None, away)])
    other = "local" if alarm["level"] == "aircraft" else "aircraft"
    then, level = first("detection_delay_s", other), f"{LEVELS[other]} level"
    at = f"{alarm['id']} ({LEVELS[alarm['level']]} level)"
    text = f"first alarm after {seconds(alarm['detection_delay_s'])} s by {at}"
    text += f", right name after {seconds(name['time_to_right_s'])} s" if name else ", no right name"
    text += f" by {name['id']}" if name and name["id"] != alarm["id"] else ""
    silence = f"{level} no alarm" if any(d["level"] == other for d in lanes) else ""
    silence = _not_run(other, lanes, case, lost) or silence
    said = f"{level} after {seconds(then['detection_delay_s'])} s by {then['id']}" if then else silence
    both = next((e["isolated"] for e in met if e["level"] == "both" and e.get("isolated")), None)
    verdict = f"joint verdict {both['class']} {both['target'].replace('_', ' ')}" if both else ""
    return "; ".join(filter(None, (text, said, verdict)))


def _not_run(level, lanes, case, lost):
    """Return why no detector of `level` that could see `case` flew, or "": one did, or none was lost of {id: why}."""
    able, there = (coverage.DESIGNED, coverage.MAY), {d["id"] for d in lanes if d["level"] == level}
    names = [n for n in lost if coverage.level(n) == level and coverage.expected(n, case) in able]
    if not names or any(coverage.expected(n, case) in able for n in there):
        return ""
    who = f"{LEVELS[level]} level" if not there else listed(names)
    return f"{who} not run: {'; '.join(dict.fromkeys(lost[n] for n in names))}"


def _why(met):
    """Return why a detector was silent, from what its lanes made of a fault that concerns them; "" if it was not."""
    if any(e.get("detection_delay_s") is not None for e in met):
        return ""
    if met and not any(e.get("able", True) for e in met):
        why = next((e["why_not_valid"] for e in met if e.get("why_not_valid")), None)
        return f"could not judge (not valid{f': {why}' if why else ''})"
    if any(e.get("masked") for e in met):
        return "(masked by the standing alarm of an earlier fault)"
    peaks = [(e.get("r_max_after"), e.get("r_max_before")) for e in met]
    after, before = max(((a, b or math.nan) for a, b in peaks if a is not None), default=(math.nan, math.nan))
    if math.isnan(after):
        return "(not valid)"
    if after <= RISE * before:
        return "(statistic did not rise)"
    return f"(statistic came to {after:.0%} of its threshold)" if after < 1.0 else "(alarm not confirmed)"


def _broke(scenario, i, achieved):
    """Return what fault `i` broke, when, and how large it became, or what was asked for where no elevator moved."""
    f = scenario.faults[i]
    size = _achieved(scenario, i, achieved)[0].removesuffix(OTHERS) or _own(f)
    return f"{f.kind} on {f.target} from {f.start_s:g} s" + (f", {size}" if size else "")


def _own(fault):
    given = (fault.model_extra or {}).items()
    return ", ".join(f"{k} {v:g}" for k, v in given if not (k == "phase_deg" and v == 0.0))


def _segments(fault):
    """Return the elevator segments that a fault acts on; none for one that only a monitor sees."""
    on = fault.parsed.place in ("elevator", "actuator_sensor") and fault.path != "monitor"
    return set(fault.parsed.names if on else ())


def _achieved(scenario, i, achieved):
    """Return (words for how far fault `i` moved its segments, a note where that is not what was asked for)."""
    f, extra = scenario.faults[i], scenario.faults[i].model_extra or {}
    moved = [m for segment, m in (achieved or {}).items() if segment in _segments(f)]
    swings = all(m["amplitude_deg"] is not None for m in moved)
    keys = ("amplitude_mm", "amplitude_deg") if swings else ("rod_mm", "surface_deg")
    given = {key: [m[key] for m in moved if m[key] is not None] for key in keys}
    if not any(given.values()):
        return "", ""
    sizes = ", ".join(f"{_span(v)} {key.rpartition('_')[2]}" for key, v in given.items() if v)
    others = any(_segments(g) & _segments(f) & achieved.keys() for j, g in enumerate(scenario.faults) if j != i)
    words = f"{'' if swings else 'at most '}{sizes}{OTHERS * others}"
    if others or not (swings and f.kind.startswith("ofc")):  # of several faults only their sum is known
        return words, ""
    travel = extra["amplitude_travel"] * math.degrees(scenario.aircraft.travel) if "amplitude_travel" in extra else None
    for key, asked in zip(keys, (extra.get("amplitude_mm"), extra.get("amplitude_deg", travel))):
        if asked and given[key] and not all(LITTLE <= v / asked <= MUCH for v in given[key]):
            share = " to ".join(dict.fromkeys(f"{100.0 * v / asked:.0f}" for v in (min(given[key]), max(given[key]))))
            unit = key.rpartition("_")[2]
            return words, f"faults.{i}: asked for {asked:g} {unit}, achieved {share} % of it; {WHY[f.at]}"
    return words, ""


def _span(values):
    """Return "6.0", or "5.1 to 6.0" of several segments."""
    low, high = (f"{v:.1f}" if v >= 1.0 else f"{v:.2g}" for v in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
