"""The page of a score: detectors over all faults, by family, without a fault, against each other; from its JSON."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from cosim.compare import tables
from cosim.files import columns, marked, replace, replace_text
from cosim.report import markdown as readme
from cosim.report.figure import Figure, log_axis, still, style_axis
from cosim.report.page import PAGE, page, write
from cosim.table import DASH, Table, number

SIGNS = {"score.json": marked(b'{\n "benchmark": "'), "score.parquet": columns("run", "fault"), "score.html": PAGE}


def score_report(found: dict, output: str | Path, beside: Sequence[dict] = ()) -> Path:
    """Write the page of a score, `found` being its JSON, to the file `output`; returns its Path. Raises OutputError.
    `beside` are rows of further detectors on the same recordings, from a stored table."""
    return write(output, render(found, beside))


def render(found: dict, beside: Sequence[dict] = ()) -> str:
    """Return the page as HTML text."""
    each = [*found["detectors"], *beside]
    figure = front(each)
    lost = f"; {found['infeasible']} points do not trim" if found["infeasible"] else ""
    fitted = any(f.get("a90") is not None for d in each for f in d["families"])
    names = [d["id"] for d in found["detectors"]]
    some = f"{len(names)} detectors" if len(names) > 3 else ", ".join(names)
    return page(
        "score.html",
        title=f"Score of {some} on {found['benchmark']}",
        subtitle=f"{flights(found)} recorded, the same for all{lost}",
        figures=[figure],
        chips=[(d["id"], d["level"], d["detected"] > 0) for d in each],
        found=found,
        beside=[d["id"] for d in beside],
        seeds=", ".join(f"{'seeds of ' * (k == 'digest')}{k.replace('_', ' ')} {v}" for k, v in found["seeds"].items()),
        front=figure,
        detectors=tables.detectors(each, scored=True),
        sizes=tables.scored_sizes(each) if fitted else None,
        quiet=tables.quiet(each),
        families=tables.scored_families(each),
        honest=tables.probabilities(each),
        pairs=tables.pairs(found["pairs"]),
        remarks=[(d["id"], d["remark"]) for d in each if d["remark"]] + [
            (d["id"], f"not valid in {d['not_valid']}: {d['why_not_valid']}") for d in each if d["why_not_valid"]
        ],
    )


def flights(found: dict) -> str:
    """Return how many flights a score has run on, and of how many: "40 of the 642 flights"."""
    n, whole = found["flights"], found.get("of", found["flights"])
    return f"{n} flights" if n == whole else f"{n} of the {whole} flights"


SHARES = (("right name", "named", "--green"), ("ambiguous", "ambiguous", "--gold"), ("wrong name", "misnamed", "--red"),
          ("not valid", "not_valid", "--muted"))  # fmt: skip


def front(each: list[dict]) -> Figure:
    """Return the figure of what a detector says of faults, and beside it what it costs in false alarms; a line each."""
    own = [d for d in each if d["designed"]]
    caption = "Left: share of the faults that it watches; the rest were missed. Right: 95 % bound of what was counted."
    figure = still("front", caption, 90 + 22 * len(own), True, barmode="stack", bargap=0.35)
    figure.layout["margin"] |= {"l": 150, "b": 44}
    figure.layout["yaxis"] = style_axis(categoryarray=[d["id"] for d in reversed(own)], categoryorder="array")
    figure.layout["xaxis"] = style_axis("faults", domain=[0.0, 0.6], range=[0.0, 1.0], tickformat=".0%")
    rate = {"type": "log", "domain": [0.66, 1.0], "anchor": "y"}
    bounds = [math.log10(d["false_alarms_per_hour_high"]) for d in own if d["false_alarms_per_hour_high"]]
    if bounds:
        low, high = min(bounds) - 0.5, max(bounds) + 0.5  # a decade at least: more than one tick
        rate |= log_axis(10.0**low, 10.0**high, (1, 2, 5) if high - low < 2.0 else (1,))
    figure.layout["xaxis2"] = style_axis("false alarms per hour, below", **rate)
    for d in own:
        common: dict = {"y": [d["id"]], "detector": d["id"], "yaxis": "y"}
        for name, key, colour in SHARES:
            said = f"{d[key]} of {d['designed']} {name}<extra>{d['id']}</extra>"
            figure.points(1, type="bar", orientation="h", name=name, x=[d[key] / d["designed"]], hover=said,
                          marker={"color": colour}, showlegend=d is own[0], **common)  # fmt: skip
        said = f"counted {d['false_alarms_per_hour']:.2g}, below %{{x:.2g}} per hour<extra>{d['id']}</extra>"
        at = [d["false_alarms_per_hour_high"]]
        figure.points(2, x=at, hover=said, marker={"size": 9, "color": "--ink"}, **common)
    return figure


def write_readme(found: dict, path: str | Path) -> None:
    """Write the tables of a score between the markers `score` and `score-sizes` of the README at `path`, as far as it
    has them. Raises OutputError."""
    text = readme.read(path)
    for name, made in (("score", markdown(found)), ("score-sizes", markdown_sizes(found))):
        if readme.part(text, name) is not None:
            readme.replace(path, name, made)


def markdown(found: dict) -> str:
    """Return the table of all detectors as Markdown."""
    told = f"`{found['benchmark']}`, {flights(found)}, content `{found['content']}`:"
    return f"{told}\n\n{tables.detectors(found['detectors'], scored=True).upto(5).markdown()}"


def markdown_sizes(found: dict) -> str:
    """Return a90/95 of every family as Markdown: the detectors that have one, smallest first."""
    each, made = found["detectors"], Table("", "family", "unit", "a90/95, smallest first", "no curve")
    for name in dict.fromkeys(f["family"] for d in each for f in d["families"]):
        own = [(d["id"], f) for d in each for f in d["families"] if f["family"] == name and f["designed"]]
        unit = next((f["unit"] for _, f in own if f["unit"]), "")
        fitted = ", ".join(f"`{i}` {number(a, 2)}" for a, i in sorted((f["a90_95"], i) for i, f in own if f["a90_95"]))
        other = ", ".join(f"`{i}` {f['detected']}/{f['designed']}" for i, f in own if not f["a90_95"])
        made.add(name, unit, fitted or DASH, other or DASH)
    return made.markdown()


def write_score(found: dict, rows: pd.DataFrame, out: str | Path, beside: Sequence[dict] = ()) -> None:
    """Write a score into folder `out`: score.json, score.html and, of public seeds, score.parquet, the rows behind it.
    Notes the paths in `found`. Raises OutputError."""
    out = Path(out)
    # a table to share: without paths
    replace_text(out / "score.json", json.dumps(found, indent=1, allow_nan=False), SIGNS["score.json"])
    if "digest" not in found["seeds"]:
        replace(out / "score.parquet", lambda part: rows.to_parquet(part, index=False), SIGNS["score.parquet"])
    found["table"], found["report"] = str(out / "score.json"), str(score_report(found, out / "score.html", beside))
