"""Tables of a comparison: levels, detectors, coverage, confusion, flights."""

import pandas as pd

from cosim.compare import stats
from cosim.judge import coverage
from cosim.replay.recording import finite
from cosim.report.page import Row, Table, bold, code, mark

SYMBOL = {
    "named": "●",
    "ambiguous": "◐",
    "misnamed": "≠",
    "missed": "✕",
    "quiet": "·",
    "bonus": "!",
    "idle": "–",
    "echo": "~",
}
CLASS = {
    "named": "c-seen",
    "ambiguous": "c-part",
    "misnamed": "c-part",
    "missed": "c-missed",
    "quiet": "c-quiet",
    "bonus": "c-bonus",
    "idle": "c-quiet",
    "echo": "c-bonus",
}


def levels(grouped: pd.DataFrame) -> dict | None:
    """Return {names, rows} of case x group: flights in which the group saw the fault, and how soon; None without."""
    if grouped.empty:
        return None
    names = list(dict.fromkeys(grouped["group"]))
    out = []
    for case, own in sorted(grouped.groupby("case", sort=False), key=lambda pair: _order(pair[0])):
        cells = []
        for g in names:
            part = own[own["group"] == g]
            seen, able = int(part["seen"].sum()), bool(part["able"].any())
            told = f"{seen}/{len(part)}" + (f", {part['delay_s'].min():.2f} s" if seen else "")
            look = "c-none" if not able else "c-seen" if seen == len(part) else "c-part" if seen else "c-missed"
            cells.append((look, ", ".join(sorted(set(part["first"].dropna()))), told if able else "blind"))
        out.append((coverage.label(case), cells))
    return {"names": names, "rows": out}


def _order(case):
    heads = ("hydraulic", "ema", "simple", "aileron", "rudder", "stabiliser", "engine", "sensor")
    head = case.split(".")[0]
    return heads.index(head) if head in heads else len(heads), case


def detectors(each: list[dict]) -> Table:
    """Return the Table of all detectors, over what each was designed for."""
    rows = [Row((bold(d["id"]), coverage.group(d["id"], d["level"]), *_scored(d)), {"data-detector": d["id"]})
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
    columns = ("detector", "valid>", "fault-free flights with an alarm>", "false alarms>", "hours>", "per hour>",
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
        "Valid: share of all flights, from 8 s on, in which it calls itself so. False alarms and hours: of all "
        "flights, healthy times and parts of faulty ones included. Standing alarm: without a fault, from 2 s "
        "after it has healed. µs: per step and lane."
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


def _scored(d, moves=False):
    """Return the cells of SCORED from a score of cosim/compare/stats.py; `moves` adds the time from motion on."""
    if not d["designed"]:
        return ("–",) * len(SCORED)
    why = f": {d['why_not_valid']}" if d["idle"] and d["why_not_valid"] else ""
    return (
        d["designed"],
        d["detected"],
        f"{d['detection_low']:.0%} to {d['detection_high']:.0%}",
        d["named"],
        d["ambiguous"] or "",
        mark(d["misnamed"], "bad") if d["misnamed"] else "",
        f"{d['idle']}{why}" if d["idle"] else "",
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
        rows = (head, d["id"], *_scored(d, moves=d["family"] == "jam or runaway"))
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
        "lower bound and a90/95, with which one is on the safe side at 95 %. Where no curve can be fitted, what the "
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


KEY = (
    ("c-seen", "●", "seen and named right"),
    ("c-part", "◐", "seen, called ambiguous"),
    ("c-part", "≠", "seen under another name"),
    ("c-missed", "✕", "designed for it, and missed"),
    ("c-quiet", "·", "may see it, stayed quiet"),
    ("c-none", "", "blind by structure, and quiet"),
    ("c-bonus", "!", "alarm though blind: not of the fault itself"),
    ("c-bonus", "~", "alarm that the manoeuvre raises without a fault as well"),
    ("c-quiet", "–", "not valid: it could not judge"),
)


def matrix(rows: pd.DataFrame) -> dict | None:
    """Return {names, key, groups} of the coverage matrix: what was expected, what happened; None without a fault."""
    found = stats.coverage_matrix(rows)
    names = [n for group in stats.groups(rows).values() for n in group]
    if not found:
        return None
    groups: dict = {}
    for case in sorted(found, key=_order):
        head = coverage.label(case).split(":")[0] if "." in case else "other effectors"
        head = "aircraft sensors" if case.startswith("sensor") else head
        row = [_cell(n, found[case].get(n)) for n in names]
        groups.setdefault(head, []).append((coverage.label(case).split(": ")[-1], row))
    return {"names": names, "key": KEY, "groups": groups.items()}


def _cell(name, cell):
    """Return (class, title, words) of one detector and case."""
    if cell is None:
        return "", "", ""
    found = sorted(cell["outcomes"].items(), key=lambda pair: -pair[1])
    good, kinds = {"named"}, {o for o, _ in found}
    if cell["word"] == coverage.BLIND and kinds <= {"quiet", "idle"}:
        look, told = "c-none", ""
    elif len(found) == 1:
        outcome = found[0][0]
        look, told = (
            CLASS[outcome],
            f"{SYMBOL[outcome]} {cell['detected']}/{cell['runs']}"
            if outcome not in ("quiet", "idle")
            else SYMBOL[outcome],
        )
    else:
        part = kinds & {"named", "ambiguous", "misnamed"}
        look = "c-seen" if kinds <= good else "c-part" if part else CLASS[found[0][0]]
        told = " ".join(f"{SYMBOL[o]}{n}" for o, n in found)
    border = " designed" * (cell["word"] == coverage.DESIGNED and cell["lane"])
    more = f"{coverage.WORDS[cell['word']]}; " + ", ".join(f"{n} {o}" for o, n in found)
    return look + border, f"{name}: {more}", told


def confusions(rows: pd.DataFrame) -> list[dict]:
    """Return [{name, columns, rows, rest}]: one confusion matrix per detector."""
    out = []
    for name in dict.fromkeys(rows["id"]):
        counts = stats.confusion(rows, name)
        if counts.empty:
            continue
        telling = [
            c
            for c in counts.index
            if c == "no fault"
            or coverage.expected(name, c).word == coverage.DESIGNED
            or counts.loc[c].drop("none", errors="ignore").sum()
        ]
        rest, counts = len(counts) - len(telling), counts.loc[telling]
        counts = counts.loc[:, counts.sum() > 0]
        last = [c for c in ("ambiguous", "none", "false alarm") if c in counts.columns]
        columns = [c for c in counts.columns if c not in last] + last
        out.append({
            "name": name,
            "columns": [c.replace("_", " ") for c in columns],
            "rest": rest,
            "rows": [
                (case if case == "no fault" else coverage.label(case),
                 [(_shade(n := int(counts.loc[case, c]), c, case, name), "", n or "") for c in columns])
                for case in sorted(counts.index, key=lambda c: _order(c) if c != "no fault" else (99, ""))
            ],
        })  # fmt: skip
    return out


def _shade(count, said, case, name):
    if not count:
        return "c-none"
    if said == "none":
        return "c-missed" if coverage.expected(name, case).word == coverage.DESIGNED else "c-quiet"
    if said == "false alarm":
        return "c-missed"
    right = coverage.expected(name, case).classes
    return "c-seen" if said in right else "c-quiet" if said == "ambiguous" else "c-part"


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
