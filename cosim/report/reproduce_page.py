"""The page of the papers' experiments: counts, our figures beside theirs, and every row."""

import math

from cosim.report.figure import Figure, axis, bands, base, curve, envelope, grid, least, level
from cosim.report.page import page, table, text, write

TITLES = {
    "lu17": "Lu17: hydraulic actuator, two-stage and three-step filters",
    "jay": "Jay: electromechanical actuator, one Kalman filter",
    "sun13": "Sun13: fast adaptive fault estimator",
    "mar10": "Mar10: control-induced redundancy",
    "alwi14": "Alwi14: sliding-mode observer over the flight envelope",
}
ROLES = {"ours": "--blue", "true": "--ink", "quiet": "--muted", "second": "--orange", "third": "--green"}
WORDS = {"agrees": "agrees", "differs_explained": "differs, explained", "differs": "differs", "ours": "ours"}
NARROW = {1: 320, 2: 560, 3: 780}  # least width of a figure [px] by its columns of panels
BANDS = (
    "Each band stands in the code beside the sentence, table or figure it is from. Ours: a number that the paper does "
    "not give; its band, where there is one, is derived."
)
MARKS = {"agrees": "good", "differs_explained": "", "differs": "bad", "ours": "muted"}


def reproduction_report(rows, drawings, output):
    """Write the page to the file `output`; returns its Path. Raises OutputError."""
    return write(output, render(rows, drawings))


def render(rows, drawings):
    """Return the page as HTML text, from the Rows and Drawings of `cosim.papers`."""
    papers = list(dict.fromkeys(r.paper for r in rows))
    body, figures, number = [], [], 0
    for paper in papers:
        body.append(f'<h2 id="{paper}">{text(TITLES[paper])}</h2>')
        for d in drawings:
            if d.paper != paper:
                continue
            number += 1
            heading = f"Figure {number}. {d.title}"
            caption = f"{text(d.caption)} Beside [{paper_key(paper)}] {text(d.beside)}."
            if d.table:
                body.append(f"<h3>{text(heading)}</h3>{_table(d.table, caption)}")
            else:
                figure = _figure(d, f"f{number}", caption)
                figures.append(figure)
                body.append(_place(figure, heading, min(d.columns, len(d.panels))))
        body.append(_rows([r for r in rows if r.paper == paper], paper))
    return page(
        title=f"{_papers(papers)}, reproduced",
        subtitle="The papers' own experiments: what they say, what we get. Figures, numbers and captions are ours.",
        summary=_summary(rows, papers),
        body="".join(body),
        figures=figures,
        chips=[],
    )


def _papers(papers):
    """Return "Lu17 and Jay", the keys as a title has them; the five of them as "Five papers"."""
    keys = [paper_key(p) for p in papers]
    if len(keys) == len(TITLES):
        return "Five papers"
    return " and ".join([", ".join(keys[:-1]), keys[-1]]) if len(keys) > 1 else keys[0]


def paper_key(paper):
    """Return the key as the code cites it: Lu17."""
    return paper[0].upper() + paper[1:]


def _count(rows):
    return [sum(r.verdict == v for r in rows) for v in WORDS]


def _summary(rows, papers):
    total = dict(zip((*list(WORDS.values())[:3], "ours, the paper gives no number"), _count(rows)))
    words = ", ".join(f"<b>{n}</b> {w}" for w, n in total.items())
    lines = [f'<div class="row"><b class="lead">Rows</b><div>{len(rows)}: {words}</div></div>']
    for paper in papers:
        own = [r for r in rows if r.paper == paper]
        n = _count(own)
        lines.append(
            f'<div class="row"><b class="lead"><a href="#{paper}">{paper_key(paper)}</a></b><div>{len(own)} rows: '
            f"{n[0]} agree, {n[1]} differ for a stated reason, {n[2]} differ; {n[3]} are ours, without a claim; "
            f'<a href="#{paper}-rows">all of them</a></div></div>'
        )
    return "".join(lines)


def _rows(rows, paper):
    made = []
    for r in rows:
        got = f"{r.got:.4g}"
        why = f"{text(r.reason)}: <code>{text(r.evidence)}</code>" if r.reason else ""
        why += f'{"<br>" if why and r.note else ""}<span class="muted">{text(r.note)}</span>'
        cells = (
            text(r.item),
            text(r.says),
            got,
            text(r.tolerance),
            f'<span class="{MARKS[r.verdict]}">{WORDS[r.verdict]}</span>',
            why,
        )
        made.append((cells, ""))
    columns = ("what", "paper says", "we get>", "band>", "verdict", "why")
    return (
        f'<h3 id="{paper}-rows">All rows of {paper_key(paper)}</h3>'
        f"{table(columns, made, caption=BANDS)}"
    )


def _table(t, caption):
    def cell(value):
        return f'<b class="good">{text(value[1:])}</b>' if value.startswith("+") else text(value)

    return table(t.columns, [(tuple(cell(v) for v in row), "") for row in t.rows], caption=caption)


def _place(figure, heading, columns):
    """Return the place of a figure; on a narrow screen it scrolls sideways by itself, not the page."""
    return (
        f'<figure><h3>{text(heading)}</h3><div class="scroll"><div style="min-width:{NARROW[columns]}px">'
        f'<div class="plot" id="{figure.id}" style="height:{figure.height}px"></div></div></div>'
        f"<figcaption>{figure.caption}</figcaption></figure>"
    )


def _figure(d, name, caption):
    columns = min(d.columns, len(d.panels))
    lines = -(-len(d.panels) // columns)
    height = 84 + d.row_px * lines + 52 * (lines - 1)
    figure = Figure(name, caption, height, time=False)
    figure.layout = base(height)
    figure.layout["margin"]["t"] = 50
    grid(figure.layout, [p.title for p in d.panels], [p.unit for p in d.panels], columns, span=d.span)
    figure.layout["legend"]["y"] = 1 + 20 / (height - 84)
    named = set()
    for i, panel in enumerate(d.panels, start=1):
        for c in panel.curves:
            figure.data.append(_curve(c, i, c.name not in named, d.span))
            named.add(c.name)
        for y in panel.levels:
            level(figure.layout, i, y)
        seen = [c.y[_inside(c, d.span)] for c in panel.curves]
        if panel.limits:
            figure.layout[axis("yaxis", i)]["range"] = list(panel.limits)
        elif panel.least or panel.levels:
            least(figure.layout, i, seen, max([panel.least, *(1.1 * abs(y) for y in panel.levels)]))
    if d.onset is not None:
        bands(figure.layout, [(d.onset, d.span[1])], len(d.panels))
    return figure


def _inside(c, span):
    """Return the slice of samples within `span`."""
    if span is None:
        return slice(None)
    first = max(0, math.floor((span[0] - c.t0) / c.dt))
    return slice(first, max(first, math.ceil((span[1] - c.t0) / c.dt)) + 1)


def _curve(c, panel, legend, span):
    on = _inside(c, span)
    made = curve(
        c.t0 + c.dt * (on.start or 0),
        c.dt,
        c.y[on],
        name=c.name,
        colour=ROLES[c.role],
        dash=c.dash,
        panel=panel,
        reduce=lambda y: envelope(y, 1000),
    )
    return made | {"showlegend": legend}
