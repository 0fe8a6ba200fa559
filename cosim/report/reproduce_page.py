"""The page of the papers' experiments: counts, our figures beside theirs, and every row."""

import math
from pathlib import Path

from cosim.papers import tables
from cosim.papers.claims import Row as PaperRow
from cosim.report.figure import axis, envelope, still
from cosim.report.page import page, write

TITLES = {
    "lu17": "Lu17: hydraulic actuator, two-stage and three-step filters",
    "jay": "Jay: electromechanical actuator, one Kalman filter",
    "sun13": "Sun13: fast adaptive fault estimator",
    "mar10": "Mar10: control-induced redundancy",
    "alwi14": "Alwi14: sliding-mode observer over the flight envelope",
}
ROLES = {"ours": "--blue", "true": "--ink", "quiet": "--muted", "second": "--orange", "third": "--green"}
NARROW = {1: 320, 2: 480, 3: 640}  # least width of a figure [px] by its columns of panels


def reproduction_report(rows: list[PaperRow], drawings: list, output: str | Path) -> Path:
    """Write the page to the file `output`; returns its Path. Raises OutputError."""
    return write(output, render(rows, drawings))


def render(rows: list[PaperRow], drawings: list) -> str:
    """Return the page as HTML text, from the Rows and Drawings of `cosim.papers`."""
    names = list(dict.fromkeys(r.paper for r in rows))
    sections, summary, number = [], [("Rows", [_count(rows)])], 0
    for name in names:
        own, key = [r for r in rows if r.paper == name], paper_key(name)
        summary += [(key, [_count(own)])] * (len(names) > 1)
        sections.append((TITLES[name], [_count(own)]))
        for d in (d for d in drawings if d.paper == name):
            number += 1
            look = f"Look at {d.look} " if d.look else ""
            caption = f"{look}{d.caption} Beside [{key}] {d.beside}."
            if d.table:
                d.table.caption = caption
            sections.append((f"Figure {number}. {d.title}", [d.table or _figure(d, f"f{number}", caption)]))
        sections.append((f"All rows of {key}", [tables.MEANING, tables.rows(own)]))
    return page(
        title=f"{_papers(names)}, reproduced", summary=summary, sections=sections,
        subtitle="The papers' own experiments: what they say, what we get. Figures, numbers and captions are ours.",
    )  # fmt: skip


def _papers(papers):
    """Return "Lu17 and Jay", the keys as a title has them; the five of them as "Five papers"."""
    keys = [paper_key(p) for p in papers]
    if len(keys) == len(TITLES):
        return "Five papers"
    return " and ".join([", ".join(keys[:-1]), keys[-1]]) if len(keys) > 1 else keys[0]


def paper_key(paper: str) -> str:
    """Return the key as the code cites it: Lu17."""
    return paper[0].upper() + paper[1:]


def _count(rows):
    counts = [f"{sum(r.verdict == v for r in rows)} {word}" for v, (word, _) in tables.VERDICTS.items()]
    return f"{len(rows)} rows: {'; '.join(counts)}"


def _figure(d, name, caption):
    columns = min(d.columns, len(d.panels))
    lines = -(-len(d.panels) // columns)
    height = 84 + d.row_px * lines + 52 * (lines - 1)
    figure = still(name, caption, height, True, "x unified", width=NARROW[columns])
    figure.layout["margin"]["t"] = 50
    figure.grid([p.title for p in d.panels], [p.unit for p in d.panels], columns, span=d.span)
    figure.layout["legend"]["y"] = 1 + 20 / (height - 84)
    named = set()
    for i, panel in enumerate(d.panels, start=1):
        for c in panel.curves:
            on, legend = _inside(c, d.span), c.name not in named
            figure.curve(
                c.t0 + c.dt * (on.start or 0), c.dt, c.y[on], name=c.name, colour=ROLES[c.role], dash=c.dash, panel=i,
                reduce=lambda y: envelope(y, 1000), showlegend=legend,
            )  # fmt: skip
            named.add(c.name)
        for y in panel.levels:
            figure.level(i, y)
        seen = [c.y[_inside(c, d.span)] for c in panel.curves]
        if panel.limits:
            figure.layout[axis("yaxis", i)]["range"] = list(panel.limits)
        elif panel.least or panel.levels:
            figure.least(i, seen, max([panel.least, *(1.1 * abs(y) for y in panel.levels)]))
    if d.onset is not None:
        figure.bands([(d.onset, d.span[1])], len(d.panels))
    return figure


def _inside(c, span):
    if span is None:
        return slice(None)
    first = max(0, math.floor((span[0] - c.t0) / c.dt))
    return slice(first, max(first, math.ceil((span[1] - c.t0) / c.dt)) + 1)
