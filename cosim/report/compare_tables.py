"""Tables of a comparison: levels, detectors, coverage, confusion, flights."""

from cosim.compare import stats
from cosim.judge import coverage
from cosim.replay.recording import finite
from cosim.report.page import table, text

SYMBOL = {
    "named": "●",
    "seen": "◐",
    "misnamed": "≠",
    "missed": "✕",
    "quiet": "·",
    "bonus": "!",
    "idle": "–",
    "echo": "~",
}
CLASS = {
    "named": "c-seen",
    "seen": "c-seen",
    "misnamed": "c-part",
    "missed": "c-missed",
    "quiet": "c-quiet",
    "bonus": "c-bonus",
    "idle": "c-quiet",
    "echo": "c-bonus",
}


def levels(grouped):
    """Return the table case x group: flights in which the group saw the fault, and how soon."""
    if grouped.empty:
        return "<p>No flight with a fault.</p>"
    names = list(dict.fromkeys(grouped["group"]))
    out = []
    for case, own in sorted(grouped.groupby("case", sort=False), key=lambda pair: _order(pair[0])):
        cells = []
        for g in names:
            part = own[own["group"] == g]
            seen, able = int(part["seen"].sum()), bool(part["able"].any())
            soon = part["delay_s"].min()
            told = f"{seen}/{len(part)}" + (f", {soon:.2f} s" if seen else "")
            look = "c-none" if not able else "c-seen" if seen == len(part) else "c-part" if seen else "c-missed"
            first = ", ".join(sorted(set(part["first"].dropna())))
            cells.append(f'<td class="{look}" title="{text(first)}">{"blind" if not able else told}</td>')
        out.append(f'<tr><th class="row">{text(coverage.label(case))}</th>{"".join(cells)}</tr>')
    head = "".join(f"<th>{text(g)}</th>" for g in names)
    note = (
        "Flights in which a detector of the group saw the fault, and the shortest delay. Blind: no detector of "
        "the group can see it by structure, or none judged. "
        "Alarms of detectors that cry in more than half of the fault-free flights do not count."
    )
    return (
        f'<div class="scroll"><table '
        f'class="matrix"><caption>{note}</caption><thead><tr><th></th>{head}</tr></thead>'
        f"<tbody>{''.join(out)}</tbody></table></div>"
    )


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
        bad = "bad" if d["fault_free_alarmed"] else ""
        free = (
            f'<span class="{bad}">{d["fault_free_alarmed"]} / {d["fault_free_runs"]}</span>, ≤ '
            f"{d['false_alarm_high']:.0%}"
            if d["fault_free_runs"]
            else "–"
        )
        cells = (
            f"<b>{text(d['id'])}</b>",
            text(coverage.group(d["id"], d["level"])),
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
        out.append((cells, f' data-detector="{text(d["id"])}"'))
    remarks = "".join(
        f"<li><b>{text(d['id'])}</b>: {text(coverage.remark(d['id']))}</li>" for d in each if coverage.remark(d["id"])
    )
    note = (
        "Over the faults that it was designed for, on parts that it watches, in flights in which it judged. A "
        "missed fault counts as an endless delay: “never” "
        "stands where so many were missed that the quantile is not reached. ≤: exact upper bound of the "
        "two-sided 95 % interval."
    )
    return table(columns, out, caption=note, classes="wide") + (f"<ul class=muted>{remarks}</ul>" if remarks else "")


def _seconds(x, d):
    return f"{x:.2f} s" if finite(x) else "never" if d["designed"] else "–"


def _number(x):
    return f"{x:.3g}" if finite(x) else "–"


def matrix(rows):
    """Return the coverage matrix: what was expected, what happened."""
    found, names = stats.coverage_matrix(rows), list(dict.fromkeys(rows["id"]))
    names = [n for group in stats.groups(rows).values() for n in group]
    if not found:
        return ""
    out, last = [], None
    for case in sorted(found, key=_order):
        head = coverage.label(case).split(":")[0] if "." in case else "other effectors"
        head = "aircraft sensors" if case.startswith("sensor") else head
        if head != last:
            out.append(f'<tr class="group"><th colspan="{len(names) + 1}">{text(head)}</th></tr>')
            last = head
        cells = "".join(_cell(n, found[case].get(n)) for n in names)
        out.append(f'<tr><th class="row">{text(coverage.label(case).split(": ")[-1])}</th>{cells}</tr>')
    head = "".join(f'<th class="col" data-detector="{text(n)}">{text(n)}</th>' for n in names)
    key = (
        ("c-seen", "●", "seen and named right"),
        ("c-seen", "◐", "seen, called ambiguous"),
        ("c-part", "≠", "seen under another name"),
        ("c-missed", "✕", "designed for it, and missed"),
        ("c-quiet", "·", "may see it, stayed quiet"),
        ("c-none", "", "blind by structure, and quiet"),
        ("c-bonus", "!", "alarm though blind: not of the fault itself"),
        ("c-bonus", "~", "alarm that the manoeuvre raises without a fault as well"),
        ("c-quiet", "–", "never judged"),
    )
    legend = "".join(f'<span><span class="box {c}">{s}</span>{t}</span>' for c, s, t in key)
    note = (
        "k/n: flights seen of flights flown; where outcomes differ, the number of each. Bordered: designed "
        "for. The expectation stands in fdi/expected.toml and was written from the equations, not from "
        "these flights."
    )
    return (
        f'<div class="key">{legend}</div><div class="scroll"><table class="matrix '
        f'coverage"><caption>{note}</caption><thead><tr><th></th>{head}</tr></thead>'
        f"<tbody>{''.join(out)}</tbody></table></div>"
    )


def _cell(name, cell):
    own = f' data-detector="{text(name)}"'
    if cell is None:
        return f"<td{own}></td>"
    found = sorted(cell["outcomes"].items(), key=lambda pair: -pair[1])
    good, kinds = {"named", "seen"}, {o for o, _ in found}
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
        look = "c-seen" if kinds <= good else "c-part" if kinds & {"named", "seen", "misnamed"} else CLASS[found[0][0]]
        told = " ".join(f"{SYMBOL[o]}{n}" for o, n in found)
    border = (
        ' style="outline:2px solid var(--muted);outline-offset:-2px"'
        if cell["word"] == coverage.DESIGNED and cell["lane"]
        else ""
    )
    more = f"{coverage.WORDS[cell['word']]}; " + ", ".join(f"{n} {o}" for o, n in found)
    return f'<td class="{look}"{border}{own} title="{text(name)}: {text(more)}">{told}</td>'


def confusions(rows):
    """Return one confusion matrix per detector."""
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
        body = ""
        for case in sorted(counts.index, key=lambda c: _order(c) if c != "no fault" else (99, "")):
            right = coverage.expected(name, case).classes
            cells = "".join(_count(int(counts.loc[case, c]), c, case, right, name) for c in columns)
            label = coverage.label(case) if case != "no fault" else case
            body += f'<tr><th class="row">{text(label)}</th>{cells}</tr>'
        head = "".join(f"<th>{text(c.replace('_', ' '))}</th>" for c in columns)
        out.append(
            f'<div data-detector="{text(name)}"><h3>{text(name)}</h3><table '
            f'class="matrix"><thead><tr><th>fault</th>{head}</tr></thead><tbody>{body}</tbody></table>'
            f"{_rest(rest)}</div>"
        )
    return (
        f"<p class=muted>Rows: what was broken on a part that the detector watches; columns: what it said "
        f'last while its alarm stood.</p><div class="tiles">{"".join(out)}</div>'
    )


def _count(n, said, case, right, name):
    return f'<td class="{_shade(n, said, case, right, name)}">{n or ""}</td>'


def _rest(n):
    return f"<p class=muted>{n} further kinds of fault: never an alarm.</p>" if n else ""


def _shade(count, said, case, right, name):
    if not count:
        return "c-none"
    if said == "none":
        return "c-missed" if coverage.expected(name, case).word == coverage.DESIGNED else "c-quiet"
    if said == "false alarm":
        return "c-missed"
    return "c-seen" if said in right else "c-quiet" if said == "ambiguous" else "c-part"


def flights(rows):
    """Return the list of flights."""
    runs: dict = {}
    for r in rows.to_dict("records"):
        runs.setdefault(r["run"], []).append(r)
    columns = ("run", "case", "target", "frequency>", "achieved>", "manoeuvre, air", "noticed by, after")
    out = [(_flight(own), "") for own in runs.values()]
    return f"<details><summary>{len(out)} flights, and who noticed</summary>{table(columns, out)}</details>"


def _flight(own):
    """Return the cells of one flight; `own` are the rows of its detectors as dicts."""
    r, fault = own[0], isinstance(own[0]["case"], str)
    seen = sorted((x for x in own if x["detected"]), key=lambda x: x["delay_s"])
    peak = f"{r['rod_mm']:.1f} mm peak" if finite(r["rod_mm"]) else "–"
    return (
        f"<code>{text(r['run'])}</code>",
        text(coverage.label(r["case"]) if fault else "no fault"),
        text(r["target"] if fault else "–"),
        f"{r['frequency_hz']:g} Hz" if finite(r["frequency_hz"]) else "–",
        f"{r['amplitude_mm']:.2f} mm" if finite(r["amplitude_mm"]) else peak,
        text(f"{r['manoeuvre'].replace('_', ' ')}, {r['turbulence']}"),
        text(", ".join(f"{x['id']} {x['delay_s']:.2f} s" for x in seen) or "–"),
    )
