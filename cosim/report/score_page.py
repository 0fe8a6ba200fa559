"""The page of a score: detectors over all faults, by family, without a fault, against each other; from its JSON."""

import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from cosim.compare import metrics
from cosim.files import columns, marked, replace, replace_text
from cosim.report import compare_tables as tables
from cosim.report import markdown as readme
from cosim.report.figure import Figure, base
from cosim.report.page import PAGE, Row, Table, bold, page, write

SIGNS = {"score.json": marked(b'{\n "benchmark": "'), "score.parquet": columns("run", "fault"), "score.html": PAGE}
OPEN = (
    "Over every fault on a part that it watches, but those to which it is blind by its own word; right, ambiguous, "
    "wrong, not valid, not excited and missed add up to the flights. A fault that was missed, or never named right, "
    "counts as an endless time: “never” stands where the median is one. Bounds: exact, 95 %."
)


def score_report(found: dict, output: str | Path, beside: Sequence[dict] = ()) -> Path:
    """Write the page of a score, `found` being its JSON, to the file `output`; returns its Path. Raises OutputError.

    `beside` are rows of further detectors on the same recordings, from a stored table.
    """
    return write(output, render(found, beside))


def render(found: dict, beside: Sequence[dict] = ()) -> str:
    """Return the page as HTML text."""
    each = [*found["detectors"], *beside]
    figure = front(each)
    lost = f"; {found['infeasible']} points do not trim" if found["infeasible"] else ""
    return page(
        "score.html",
        title=f"Score of {_some(found)} on {found['benchmark']}",
        subtitle=f"{found['flights']} recorded flights, the same for all{lost}",
        figures=[figure],
        chips=[(d["id"], d["level"], d["detected"] > 0) for d in each],
        found=found,
        beside=[d["id"] for d in beside],
        seeds=", ".join(f"{k.replace('_', ' ')} {v}" for k, v in found["seeds"].items()),
        front=figure,
        detectors=detectors(each),
        sizes=sizes(each),
        quiet=tables.quiet(each),
        families=families(each),
        honest=honest(each),
        pairs=pairs(found["pairs"]),
        remarks=[(d["id"], d["remark"]) for d in each if d["remark"]] + [
            (d["id"], f"not valid in {d['idle']}: {d['why_not_valid']}") for d in each if d["why_not_valid"]
        ],
    )


def _some(found):
    names = [d["id"] for d in found["detectors"]]
    return f"{len(names)} detectors" if len(names) > 3 else ", ".join(names)


def detectors(each: list[dict]) -> Table:
    """Return the Table of all detectors over all families."""
    rows = [Row((bold(d["id"]), d["group"], *tables.scored(d)), {"data-detector": d["id"]}) for d in each]
    return Table(("detector", "draws on", *tables.SCORED), rows, OPEN, "wide")


def families(each: list[dict]) -> Table:
    """Return the Table of detectors by family, a line for each pair that is not blind."""
    order = dict.fromkeys(f["family"] for d in each for f in d["families"])
    found = [{"id": d["id"], **f} for name in order for d in each for f in d["families"]
             if f["family"] == name and f["designed"]]  # fmt: skip
    made = tables.families(found)
    return Table(("family", *made.columns[1:]), made.rows, "Columns as above.", made.classes)


def sizes(each: list[dict]) -> Table:
    """Return the Table of a90/95: families by line, detectors by column."""
    order = dict.fromkeys(f["family"] for d in each for f in d["families"])
    cells = {(d["id"], f["family"]): f for d in each for f in d["families"]}
    rows = []
    for name in order:
        own = [cells[d["id"], name] for d in each]
        unit = next((f["unit"] for f in own if f["designed"] and f["unit"]), "")
        bound = next((f["bound_mm"] for f in own if f["designed"] and f["bound_mm"]), None)
        head = f"{name}, {unit}" if unit else name
        best = min((f["a90_95"] for f in own if f["designed"] and f["a90_95"]), default=None)
        shown = [_size(f, best) for f in own]
        rows.append(Row((bold(head) if bound is None else bold(head) + f" (bound {bound:.2g})", *shown)))
    note = (
        "Size at which 90 % are seen, in brackets its lower bound and a90/95, with which one is on the safe side at "
        "95 % (binomial regression on its logarithm; not valid counts as missed; "
        "?: outside the sizes flown). Oscillations: achieved amplitude; "
        "jams: how far the rod was kept from where it would be; sensors: bias in standard deviations of that sensor's "
        "noise per sample. Without a curve: what the flights say, and seen of flights."
    )
    return Table(("family", *(d["id"] + ">" for d in each)), rows, note, "wide")


def _size(f, best):
    if not f["designed"]:
        return "blind" if f["blind"] else "–"
    seen = f"{f['detected']}/{f['designed']}"
    if not f["a90"]:
        return f"{f['note']} ({seen})"
    ends = ["?" if f[k] is None else f"{f[k]:.2g}" for k in ("low", "a90_95")]
    said = f"{f['a90']:.2g} ({ends[0]} to {ends[1]})"
    return bold(said) if best is not None and f["a90_95"] == best else said


def honest(each: list[dict]) -> Table | None:
    """Return the Table of log scores, None without a detector that gives probabilities."""
    own = [d for d in each if d["log_fault"] is not None or d["log_none"] is not None]
    if not own:
        return None
    rows = [Row((bold(d["id"]), _number(d["log_fault"]), _number(d["log_none"]))) for d in own]
    note = (
        "Mean over flights of ln p of the truth: of the right class while a fault lasts; of none before "
        "it and without one. 0 is certain and right; -2.3 is what says nothing at all."
    )
    return Table(("detector", "while a fault lasts>", "without a fault>"), rows, note)


def pairs(found: list[dict]) -> Table | None:
    """Return the Table of detectors compared on the same flights, None without any."""
    rows = []
    for p in found:
        more = "–" if p["difference"] is None else f"{p['difference']:+.2f} ({p['low']:+.2f} to {p['high']:+.2f})"
        ends = p["later_low_s"], p["later_high_s"]
        late = "–" if p["later_s"] is None else f"{p['later_s']:+.2f} ({ends[0]:+.2f} to {ends[1]:+.2f})"
        counts = p["n"], p["only_a"], p["only_b"], _number(p["p"])
        rows.append(Row((bold(p["a"]), bold(p["b"]), p["at"], *counts, more, late)))
    note = (
        "Faults on parts that both watch, neither blind. p: exact test of McNemar on the flights that only one of them "
        "saw. Sees more, later: mean difference of a and b with its 95 % interval by bootstrap over flights; a missed "
        "fault counts as noticed at the end. Equal false alarms: thresholds scaled until the same share of fault-free "
        "flights crosses them, before confirmation."
    )
    columns = ("a", "b", "at", "flights>", "only a>", "only b>", "p>", "a sees more>", "a later, s>")
    return Table(columns, rows, note, "wide") if rows else None


SHARES = (("right name", "named", "--green"), ("ambiguous", "ambiguous", "--gold"), ("wrong name", "misnamed", "--red"),
          ("not valid", "idle", "--muted"))  # fmt: skip


def front(each: list[dict]) -> Figure:
    """Return the figure of what a detector says of faults, and beside it what it costs in false alarms; a line each."""
    own = [d for d in each if d["designed"]]
    caption = "Left: share of the faults that it watches; the rest were missed. Right: 95 % bound of what was counted."
    figure = Figure("front", caption, 90 + 22 * len(own), time=False)
    figure.layout = base(figure.height) | {"hovermode": "closest", "barmode": "stack", "bargap": 0.35}
    figure.layout["margin"] |= {"l": 150, "b": 44}
    figure.layout["yaxis"] = {"categoryarray": [d["id"] for d in reversed(own)], "categoryorder": "array"}
    figure.layout["xaxis"] = {"domain": [0.0, 0.6], "range": [0.0, 1.0], "tickformat": ".0%",
                              "title": {"text": "faults"}}  # fmt: skip
    figure.layout["xaxis2"] = {"domain": [0.66, 1.0], "type": "log", "anchor": "y",
                               "title": {"text": "false alarms per hour, below"}}  # fmt: skip
    for d in own:
        common = {"y": [d["id"]], "meta": {"detector": d["id"]}}
        for name, key, colour in SHARES:
            figure.data.append({
                "type": "bar", "orientation": "h", "name": name, "x": [d[key] / d["designed"]], **common,
                "marker": {"color": colour}, "showlegend": d is own[0],
                "hovertemplate": f"{d[key]} of {d['designed']} {name}<extra>{d['id']}</extra>",
            })  # fmt: skip
        figure.data.append({
            "type": "scatter", "mode": "markers", "x": [d["false_alarms_per_hour_high"]], "xaxis": "x2", **common,
            "marker": {"size": 9, "color": "--ink"}, "showlegend": False,
            "hovertemplate": f"{metrics.rate_words(d['false_alarms'], d['hours'])}<extra>{d['id']}</extra>",
        })  # fmt: skip
    return figure


def _number(x):
    return "–" if x is None else f"{x:.3g}"


def write_readme(found: dict, path: str | Path) -> None:
    """Write the tables of a score between the markers `score` and `score-sizes` of the README at `path`, as far as it
    has them. Raises OutputError."""
    text = readme.read(path)
    for name, made in (("score", markdown(found)), ("score-sizes", markdown_sizes(found))):
        if readme.part(text, name) is not None:
            readme.replace(path, name, made)


def markdown(found: dict) -> str:
    """Return the table of all detectors as Markdown."""
    columns = ("detector", "draws on", "faults", "seen", "right name", "wrong name", "not valid", "first alarm, s",
               "right name, s", "false alarms (95 %)", "valid", "µs per step", "ln p")  # fmt: skip
    told = f"`{found['benchmark']}`, {found['flights']} of its flights, content `{found['content']}`:"
    lines = [told, "", f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    for d in found["detectors"]:
        counts = [str(d[k]) if d["designed"] else "–" for k in ("designed", "detected", "named", "misnamed", "idle")]
        rate = metrics.rate_words(d["false_alarms"], d["hours"])
        cells = (f"`{d['id']}`", d["group"], *counts, _short(d.get("delay_s")), _short(d.get("right_s")), rate,
                 f"{d['availability']:.0%}", _short(d["step_us"]), _short(d["log_fault"]))  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def markdown_sizes(found: dict) -> str:
    """Return a90/95 of every family as Markdown: the detectors that have one, smallest first."""
    each = found["detectors"]
    lines = ["| family | unit | a90/95, smallest first | no curve |", "|---|---|---|---|"]
    for name in dict.fromkeys(f["family"] for d in each for f in d["families"]):
        own = [(d["id"], f) for d in each for f in d["families"] if f["family"] == name and f["designed"]]
        unit = next((f["unit"] for _, f in own if f["unit"]), "")
        fitted = sorted((f["a90_95"], i) for i, f in own if f["a90_95"])
        other = [f"`{i}` {f['detected']}/{f['designed']}" for i, f in own if not f["a90_95"]]
        told = ", ".join(f"`{i}` {a:.2g}" for a, i in fitted)
        lines.append(f"| {name} | {unit} | {told or '–'} | {', '.join(other) or '–'} |")
    return "\n".join(lines)


def _short(x):
    return "–" if x is None else f"{x:.2g}"


def write_score(found: dict, rows: pd.DataFrame, out: str | Path, beside: Sequence[dict] = ()) -> None:
    """Write a score into folder `out`: score.json, score.html and, of public seeds, score.parquet, the rows behind it.

    Notes the paths in `found`. Raises OutputError.
    """
    out = Path(out)
    # a table to share: without paths
    replace_text(out / "score.json", json.dumps(found, indent=1, allow_nan=False), SIGNS["score.json"])
    if "digest" not in found["seeds"]:
        replace(out / "score.parquet", lambda part: rows.to_parquet(part, index=False), SIGNS["score.parquet"])
    found["table"], found["report"] = str(out / "score.json"), str(score_report(found, out / "score.html", beside))
