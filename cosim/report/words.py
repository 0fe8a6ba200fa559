"""The plain-language summary of a flight: what was broken, who noticed, when, what they said, who stayed blind."""

from collections.abc import Iterable

from markupsafe import Markup

from actuators.constants import DEG_PER_RAD
from cosim.judge import coverage
from cosim.judge.naming import outcome
from cosim.replay.recording import Lane, LoggedFlight, words
from cosim.report.page import bold, mark
from cosim.scenario import Scenario
from cosim.scenario.fault import Fault

LEVELS = {"aircraft": "aircraft level", "local": "local"}


def article(items: Iterable, last: str = "and") -> str:
    """Return "a, b and c"."""
    items = list(items)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""


def point(s: Scenario) -> str:
    """Return the flight point and the manoeuvre in words."""
    f = s.flight
    speed = f"{f.cas_kt:g} kt CAS" if f.cas_kt else f"{f.tas_kt:g} kt TAS" if f.tas_kt else f"Mach {f.mach:g}"
    where = f"{f.mass_t:g} t, CG {f.cg_pct:g} %, {f.altitude_ft:,.0f} ft, {speed}"
    return ", ".join(filter(None, (where, f.path, f.weather, words(s.manoeuvre.kind))))


def fault(f: Fault) -> Markup:
    """Return one fault in words."""
    own = ", ".join(f"{k} {v:g}" for k, v in (f.model_extra or {}).items() if not (k == "phase_deg" and v == 0.0))
    until = "" if f.end_s is None else f" to {f.end_s:g} s"
    where = f" at the {f.at}" if f.at else f" ({f.path})" if f.path else ""
    until += "" if f.when is None else f", when {f.when}"
    return bold(words(f.kind)) + f" on {words(f.target)}{where} from {f.start_s:g} s{until}{f' ({own})' if own else ''}"


def delay(entry: dict) -> str:
    """Return when a lane noticed, in words."""
    said = f"after {entry['detection_delay_s']:.2f} s"
    periods, right = entry["detection_delay_periods"], entry["time_to_right_s"]
    said += f" ({periods:.1f} periods)" if periods is not None and periods == periods else ""
    return said + (f", with the right name after {right:.2f} s" if right is not None else "")


def verdict(entry: dict) -> str:
    """Return the verdict of a lane in words."""
    found = entry["isolated"]
    if not found:
        return "no verdict"
    more = found["target"].removeprefix(entry["target"]).strip(".")
    return f"{found['class']}{' ' + words(more) if more else ''}"


def entries(lane: Lane) -> list[dict]:
    """Return the entries of a lane, one for each fault that it could notice, or its own."""
    return [{**lane.entry, **part} for part in lane.entry["by_fault"]] or [lane.entry]


def case_of(flown: LoggedFlight, entry: dict) -> str | None:
    """Return the case of the fault of an entry, or None."""
    return None if entry["fault"] is None else flown.cases[entry["fault"]]


def came_of_it(flown: LoggedFlight, lane: Lane, entry: dict) -> str | None:
    """Return the outcome of an entry of a lane (cosim/judge/naming.py), or None when no fault concerns it."""
    case = case_of(flown, entry)
    if case is None:
        return None
    seen = entry["detection_delay_s"] is not None
    return outcome(
        lane.id, case, seen=seen, class_=entry["class_given"], place=entry["place_given"], able=entry["able"]
    )


MARKS = {"named": "good", "misnamed": "bad", "missed": "bad"}
JUDGED = {
    "idle": "not valid",
    "named": "right",
    "ambiguous": "seen, not named",
    "misnamed": "another name",
    "bonus": "not expected",
    "missed": "missed",
    "quiet": "quiet",
}


def summary(flown: LoggedFlight) -> list[tuple[str, list]]:
    """Return the summary: [(heading, [items])]."""
    s, status = flown.scenario, (flown.log.result or {}).get("status", "incomplete: the log ends early")
    rows = [("Flown", [f"{flown.end - flown.t0 + flown.dt:.1f} s: {point(s)}; {status}"])]
    faults = [fault(f) + _swing(flown, f) for f in s.faults]
    rows.append(("Broken", faults or ["nothing: every alarm below is a false one"]))
    met = [(lane, e, came_of_it(flown, lane, e)) for lane in flown.lanes for e in entries(lane)]
    noticed = sorted((one for one in met if one[2] and one[1]["detection_delay_s"] is not None),
                     key=lambda one: one[1]["detected_at_s"])  # fmt: skip
    if faults:
        rows.append(("Noticed", [_noticed(flown, *one) for one in noticed] or ["by nobody"]))
        rows.append(("Quiet", _quiet(flown, met) or ["nobody: every detector that the fault concerns noticed it"]))
    rows.append(("False", _false(flown)))
    return rows


def _swing(flown, f):
    """Return how far the true surface of a faulted elevator segment moved, before the fault and with it."""
    if f.parsed.place not in ("elevator", "actuator_sensor") or f.start_s >= flown.end:
        return ""
    k = max(1, round((f.start_s - flown.t0) / flown.dt))
    out = []
    for seg in f.parsed.names:
        delta = flown.values("/truth/aircraft", f"de_{flown.scenario.aircraft.short[seg]}") * DEG_PER_RAD
        before, after = delta[:k], delta[k:]
        out.append(
            f"{words(seg)} moved {after.min():.2f} to {after.max():.2f} deg (before: {before.min():.2f} to "
            f"{before.max():.2f})"
        )
    return "; " + mark("; ".join(out), "muted")


def _noticed(flown, lane, entry, how):
    about = f" ({LEVELS[lane.level]}) {delay(entry)}{_of(flown, entry)}; said "
    return bold(lane.name) + about + bold(verdict(entry)) + ", " + mark(JUDGED[how], MARKS.get(how, ""))


def _of(flown, entry):
    """Return which fault an entry is about, where there are several."""
    if len(flown.faults) < 2:
        return ""
    f = flown.scenario.faults[entry["fault"]]
    return f" of {words(f.kind)} on {words(f.target)}"


def _quiet(flown, met):
    groups: dict = {}
    for lane, entry, how in met:
        if how in ("missed", "quiet"):
            word = coverage.expected(lane.id, case_of(flown, entry) or "").word
            groups.setdefault(word, []).append(lane.name + _of(flown, entry))
        if how == "idle":
            why = f" ({entry['why_not_valid']})" if entry["why_not_valid"] else ""
            groups.setdefault("idle", []).append(lane.name + _of(flown, entry) + why)
    order = (coverage.DESIGNED, "idle", coverage.MAY, coverage.BLIND, coverage.UNDECLARED)
    heads = {
        coverage.DESIGNED: mark("missed, though designed for it", "bad"),
        coverage.MAY: "could have seen it, did not",
        coverage.BLIND: "blind by structure",
        coverage.UNDECLARED: "quiet, and nothing declared about it",
        "idle": "not valid, so that it could not judge",
    }
    return [Markup("{}: {}").format(heads[w], ", ".join(groups[w])) for w in order if w in groups]


def _false(flown):
    loud = [(lane, lane.entry["false_alarms"]) for lane in flown.lanes
            if lane.entry["false_alarms"] or lane.entry["standing_s"]]  # fmt: skip
    if not loud:
        return [f"no false alarm of {len(flown.lanes)} detector lanes"]
    return [
        mark(lane.name, "bad") + f": {n} false alarm{'s' * (n > 1)}, {lane.entry['standing_s']:.1f} s of alarm without "
        "a fault"
        for lane, n in loud
    ]
