"""Tables of a comparison: detectors, what becomes of alarms, kinds of fault, sizes, flights."""

import pandas as pd
from markupsafe import Markup

from cosim.compare import stats
from cosim.judge import coverage
from cosim.replay.recording import finite
from cosim.report.page import Row, Table, bold, code, mark


def detectors(each: list[dict]) -> Table:
    """Return the Table of all detectors, over what each was designed for."""
    rows = [Row((bold(d["id"]), coverage.group(d["id"], d["level"]), *scored(d)), {"data-detector": d["id"]})
            for d in each]  # fmt: skip
    note = (
        "Over the faults that it was designed for, on parts that it watches; right, ambiguous, wrong, not valid, not "
        "excited and missed add up to the flights, none is left out. Right: class and part; ambiguous is no name. Not "
        "valid: it missed, and could not judge. Not excited: a jam or runaway that never moved the rod 1 mm from where "
        "it would be. A fault that was missed, or never named right, counts as an endless time: “never” stands where "
        "the median is one. Bounds: exact, 95 %."
    )
    return Table(("detector", "draws on", *SCORED), rows, note, "wide")


def quiet(each: list[dict]) -> Table:
    """Return the Table of what each detector does without a fault, and what it costs."""
    columns = ("detector", "valid>", "fault-free flights with an alarm>", "false alarms>", "in valid h>", "per hour>",
               "95 % bounds>", "standing alarm>", "µs>")  # fmt: skip
    out = []
    for d in each:
        n, of = d["fault_free_alarmed"], d["fault_free_runs"]
        cells = (
            bold(d["id"]),
            f"{d['availability']:.0%}" if finite(d["availability"]) else "–",
            mark(f"{n} / {of}", "bad" if n else "") + f", ≤ {d['false_alarm_high']:.0%}" if of else "–",
            d["false_alarms"],
            f"{d['hours']:.2g}",
            _number(d["false_alarms_per_hour"]),
            f"{_number(d['false_alarms_per_hour_low'])} to {_number(d['false_alarms_per_hour_high'])}",
            f"{d['standing_s']:.0f} s" if finite(d["standing_s"]) else "–",
            _number(d["step_us"]),
        )
        out.append(Row(cells, {"data-detector": d["id"]}))
    note = (
        "Valid: share of all flights, from 8 s on, in which it calls itself so. False alarms: of all flights, per hour "
        "in which one would count (valid, and no fault there that concerns it; mean over its lanes). Standing alarm: "
        "without a fault, from 2 s after it has healed. µs: per step and lane."
    )
    return Table(columns, out, note, "wide")


def after(each: list[dict]) -> Table:
    """Return the Table of what becomes of alarms: names that change, alarms that fall early or never."""
    columns = ("detector", "seen>", "first name right or ambiguous>", "more than one change of class>",
               "called ambiguous>", "alarm held>", "healed>", "withdrawn>", "after>")  # fmt: skip
    out = []
    for d in each:
        if d["detected"]:
            cells = (bold(d["id"]), d["detected"], d["first_fair"], d["changed_often"], f"{d['ambiguous_s']:.0f} s",
                     d["held"], d["healed"] or "–", d["withdrawn"] if d["healed"] else "–",
                     _seconds(d["withdrawn_after_s"], d) if d["healed"] else "–")  # fmt: skip
            out.append(Row(cells, {"data-detector": d["id"]}))
    note = (
        f"Of the faults that it was designed for and saw. Held: the alarm stands {stats.HELD:.0%} of the time from its "
        "rise to the end of the fault. Healed: the fault ended while the alarm could be watched; withdrawn: its alarm "
        "did too, after: the median time, counted to its last alarm."
    )
    return Table(columns, out, note, "wide")


SCORED = (
    *("flights>", "seen>", "95 % bounds>", "right name>", "ambiguous>", "wrong name>", "not valid>", "not excited>"),
    *("missed>", "first alarm>", "right name after>"),
)


def scored(d: dict, moves: bool = False) -> tuple:
    """Return the cells of SCORED from a score of cosim/compare/stats.py; `moves` adds the time from motion on."""
    if not d["designed"]:
        return ("–",) * len(SCORED)
    idle = Markup('<span title="{}">{}</span>').format(d["why_not_valid"] or "", d["idle"])
    return (
        d["designed"],
        d["detected"],
        f"{d['detection_low']:.0%} to {d['detection_high']:.0%}",
        d["named"],
        d["ambiguous"] or "",
        mark(d["misnamed"], "bad") if d["misnamed"] else "",
        idle if d["idle"] else "",
        d["not_excited"] or "",
        d["missed"] or "",
        _seconds(d["delay_s"], d),
        _seconds(d["right_s"], d) + (f", {_seconds(d['motion_s'], d)} of motion" if moves else ""),
    )


def families(found: list[dict]) -> Table:
    """Return the Table of detectors by kind of fault, from stats.families; a line for each pair."""
    out, last = [], None
    for d in found:
        head = bold(d["family"]) if d["family"] != last else ""
        rows = (head, d["id"], *scored(d, moves=d["family"] == "jam or runaway"))
        last = d["family"]
        out.append(Row(rows, {"data-detector": d["id"]}))
    note = (
        "Kinds that it was designed for; columns as above. A jam or runaway also from when the rod is 1 mm from where "
        "it would be."
    )
    return Table(("kind of fault", "detector", *SCORED), out, note, "wide")


def sizes(found: list[dict]) -> Table:
    """Return the Table of a90/95 by kind of oscillation, from stats.sizes: groups by line, frequencies by column."""
    hz = sorted({d["frequency_hz"] for d in found})
    cells = {(d["family"], d["group"], d["frequency_hz"]): d for d in found}
    out, last = [], None
    for family, name in dict.fromkeys((d["family"], d["group"]) for d in found):
        head = bold(family) if family != last else ""
        last = family
        out.append(Row((head, name, *(_size(cells.get((family, name, f))) for f in hz))))
    note = (
        "Achieved amplitude, mm of rod, at which 90 % are seen (binomial regression on its logarithm), in brackets its "
        "lower bound and a90/95, with which one is on the safe side at 95 %; "
        "?: outside the sizes flown. Where no curve can be fitted, what the "
        "flights say. Flights in which no detector of the group could judge are not in the fit; their number stands "
        "behind it. Bound: of physics, what the best detector of that level could see with 90 % at best (median of the "
        "flights, cosim/compare/bound.py); flights below it stay in."
    )
    return Table(("oscillation", "draws on", *(f"{f:g} Hz>" for f in hz)), out, note, "wide")


def _size(d):
    return "–" if d is None else size(d)


def size(d: dict) -> str:
    """Return an entry of stats.sizes in words."""
    idle = f"; {d['idle']} not valid" if d["idle"] else ""
    if d["bound_mm"] is not None:
        idle += f"; bound {d['bound_mm']:.2g}" + (f", {d['below']} below it" if d["below"] else "")
    if d["a90"] is None:
        return f"{d['note']} ({d['seen']}/{d['n']}{idle})" if d["n"] else f"not valid ({d['idle']})"
    ends = ["?" if d[k] is None else f"{d[k]:.2g}" for k in ("low", "a90_95")]
    return f"{d['a90']:.2g} ({ends[0]} to {ends[1]}){idle}"


def _seconds(x, d):
    return f"{x:.2f} s" if finite(x) else "never" if d["designed"] else "–"


def _number(x):
    return f"{x:.3g}" if finite(x) else "–"


def flights(rows: pd.DataFrame) -> Table:
    """Return the Table of all flights."""
    runs: dict = {}
    for r in rows.to_dict("records"):
        runs.setdefault(r["run"], []).append(r)
    columns = ("run", "case", "target", "frequency>", "achieved>", "manoeuvre, air", "noticed by, after")
    return Table(columns, [Row(_flight(own)) for own in runs.values()])


def _flight(own):
    """Return the cells of one flight; `own` are the rows of its detectors as dicts."""
    r, fault = own[0], isinstance(own[0]["case"], str)
    seen = sorted((x for x in own if x["detected"]), key=lambda x: x["delay_s"])
    peak = f"{r['rod_mm']:.1f} mm peak" if finite(r["rod_mm"]) else "–"
    return (
        code(r["run"]),
        coverage.label(r["case"]) if fault else "no fault",
        r["target"] if fault else "–",
        f"{r['frequency_hz']:g} Hz" if finite(r["frequency_hz"]) else "–",
        f"{r['amplitude_mm']:.2f} mm" if finite(r["amplitude_mm"]) else peak,
        f"{r['manoeuvre'].replace('_', ' ')}, {r['turbulence']}",
        ", ".join(f"{x['id']} {x['delay_s']:.2f} s" for x in seen) or "–",
    )
