"""The page of false alarms per hour: the curve of every detector, three ways, what it rests on, what is against it."""

import math
from pathlib import Path

from cosim.compare import tables
from cosim.report.figure import axis, still
from cosim.report.page import page, write
from cosim.table import number

LEAST = 1e-12  # per hour: below, nothing is drawn
TITLES = ("false alarms over the threshold", "return levels: the highest peaks", "shape over the number of peaks")
WAYS = (("counted", "counted", "--blue", "solid"), ("extremes", "extremes", "--red", "solid"),
        ("crossings", "Gaussian crossings", "--green", "dash"))  # fmt: skip


def false_alarms_report(found: dict, output: str | Path) -> Path:
    """Write the page of what `cosim.compare.false_alarms.false_alarms` found to the file `output`; returns its Path.
    Raises OutputError."""
    return write(output, render(found))


def render(found: dict) -> str:
    """Return the page as HTML text."""
    drawn = [({"id": d["id"], "said": _said(d)}, _figure(d)) for d in found["detectors"]]
    return page(
        "false_alarms.html", title="False alarms per flight hour",
        subtitle=f"{len(found['detectors'])} detectors over {found['hours']:.1f} flight hours of {found['campaign']}",
        figures=[figure for _, figure in drawn], figures_of=drawn, found=found,
        certified=sum(d["certified"] for d in found["detectors"]), rates=tables.rates(found["detectors"]),
        held_out=tables.held_out(found["detectors"]),
    )  # fmt: skip


def _said(d):
    fit = d["fit"]
    if fit["note"]:
        said = f"The curve ends with the count: {fit['note']}."
    else:
        said = (f"The {fit['peaks']} highest of {d['flights']} peaks, above c = {number(fit['from'])}; shape "
                f"{tables.with_ends(fit['shape'])}, Anderson-Darling {fit['anderson_darling']:.2f}.")  # fmt: skip
    return said + (f" No crossing bound: {d['gaussian']}." if d["gaussian"] else "")


def _figure(d):
    figure = still(f"curve-{d['id']}", "", 330, True)
    figure.layout["margin"] |= {"t": 56}
    figure.layout["legend"]["y"] = 1.08
    figure.grid(TITLES, ["per hour", "c", "shape"], 3, x_title="", gap=0.07)
    words = ("c: all thresholds times this", "hours between two", "peaks fitted")
    for panel, (x, y) in enumerate((("log", "log"), ("log", "log"), ("log", "linear")), 1):
        figure.layout[axis("xaxis", panel)] |= {"type": x}
        figure.layout[axis("xaxis", panel)]["title"]["text"] = words[panel - 1]
        figure.layout[axis("yaxis", panel)]["type"] = y
    c = d["curve"]["c"]
    for key, name, colour, dash in WAYS:
        if key in d["curve"]:
            for turned in (False, True)[: 1 + (key == "extremes")]:
                _band(figure, c, d["curve"][key], name, colour, dash, turned)
    figure.layout["yaxis"]["range"] = [math.log10(LEAST), 2.0]
    figure.upright(1, 1, color="--fault", width=1.2, dash="dash")
    top, rows = d["highest"], d["stability"]
    _dots(figure, 2, [d["hours"] / (i + 1) for i in range(len(top))], top, "--blue")
    if rows:
        error = {"type": "data", "symmetric": False, "array": [r["high"] - r["shape"] for r in rows],
                 "arrayminus": [r["shape"] - r["low"] for r in rows], "color": "--red"}  # fmt: skip
        _dots(figure, 3, [r["k"] for r in rows], [r["shape"] for r in rows], "--red", error_y=error)
    return figure


def _dots(figure, panel, x, y, colour, **more):
    marker = {"color": colour, "size": 5}
    figure.points(panel, x=x, y=y, marker=marker, hover="%{x:.3g}, %{y:.3g}<extra></extra>", **more)


def _band(figure, c, ways, name, colour, dash, turned):
    """Draw a curve and the ends of its interval, or return levels over hours."""
    for key, width in (("value", 1.8), ("low", 0.8), ("high", 0.8)):
        kept = [(x, y) for x, y in zip(c, ways[key]) if y is not None and y > LEAST]
        at = [(1.0 / y, x) for x, y in kept] if turned else kept
        line = {"color": colour, "width": width, "dash": dash if key == "value" else "dot"}
        named = {"name": name, "legendgroup": name, "showlegend": key == "value" and not turned}
        x, y = [x for x, _ in at], [y for _, y in at]
        figure.points(2 if turned else 1, mode="lines", x=x, y=y, line=line, hover="%{x:.3g}, %{y:.3g}", **named)
