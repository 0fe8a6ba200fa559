"""Tables of a comparison: levels, detectors, coverage, confusion, flights."""

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


def levels(grouped):
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


def detectors(each):
    """Return the table of all detectors."""
    columns = (
        "detector",
        "draws on",
        "seen / designed for>",
        "95 % bounds>",
        "named right>",
        "misnamed>",
        "median delay>",
        "95th percentile>",
        "fault-free flights with an alarm>",
        "alarms per hour>",
        "µs>",
    )
    out = []
    for d in each:
        bounds = f"{d['detection_low']:.0%} to {d['detection_high']:.0%}" if d["designed"] else "–"
        n, of = d["fault_free_alarmed"], d["fault_free_runs"]
        free = mark(f"{n} / {of}", "bad" if n else "") + f", ≤ {d['false_alarm_high']:.0%}" if of else "–"
        cells = (
            bold(d["id"]),
            coverage.group(d["id"], d["level"]),
            f"{d['detected']} / {d['designed']}",
            bounds,
            d["named"],
            d["misnamed"],
            _seconds(d["delay_s"], d),
            _seconds(d["delay_s_p95"], d),
            free,
            _number(d["false_alarms_per_hour"]),
            _number(d["step_us"]),
        )
        out.append(Row(cells, {"data-detector": d["id"]}))
    note = (
        "Over the faults that it was designed for, on parts that it watches, in flights in which it judged. A "
        "missed fault counts as an endless delay: “never” "
        "stands where so many were missed that the quantile is not reached. ≤: exact upper bound of the "
        "two-sided 95 % interval."
    )
    return Table(columns, out, note, "wide")


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
    ("c-quiet", "–", "never judged"),
)


def matrix(rows):
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


def confusions(rows):
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


def flights(rows):
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
