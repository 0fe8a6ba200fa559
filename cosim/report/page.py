"""One self-contained HTML page: style, figures, plotly.js and a script in one file that opens offline."""

import html
import json
from importlib.resources import files
from pathlib import Path

from plotly.offline import get_plotlyjs

from cosim.files import replace_text
from cosim.judge.result import plain


def text(value):
    """Return a value as text that is safe inside HTML."""
    return html.escape(str(value))


def drawing(figure, heading=None):
    """Return the place of a figure in the page."""
    title = f"<h3>{text(heading)}</h3>" if heading else ""
    caption = f"<figcaption>{figure.caption}</figcaption>" if figure.caption else ""
    owner = f' data-detector="{text(figure.detector)}"' if figure.detector else ""
    return (
        f'<figure{owner}>{title}<div class="plot" id="{figure.id}" '
        f'style="height:{figure.height}px"></div>{caption}</figure>'
    )


def table(columns, rows, *, caption="", classes=""):
    """Return an HTML table. A column that ends in > is numeric; a row is (cells, attributes); cells are HTML."""
    head = "".join(f'<th class="n">{text(c[:-1])}</th>' if c.endswith(">") else f"<th>{text(c)}</th>" for c in columns)
    body = []
    for cells, attributes in rows:
        made = "".join(
            f'<td class="n">{x}</td>' if c.endswith(">") else f"<td>{x}</td>" for c, x in zip(columns, cells)
        )
        body.append(f"<tr{attributes}>{made}</tr>")
    below = f"<caption>{caption}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table '
        f'class="{classes}">{below}<thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
    )


def _bar(chips, span):
    made = "".join(
        f'<button class="chip {text(level)}{" on" if on else ""}" data-toggle="{text(name)}" aria-pressed="true" '
        f'title="{text(level)}-level detector: show or hide"><span class="dot"></span>{text(name)}</button>'
        for name, level, on in chips
    )
    cursor = ""
    if span:
        cursor = (
            f'<div class="cursor-row"><output id="t">t = 0.000 s</output><input id="time" type="range" '
            f'min="{span[0]}" max="{span[1]}" '
            'step="0.005" aria-label="time cursor"><span id="now"></span><button id="reset" title="show the '
            'whole flight">'
            "whole flight</button></div>"
        )
    return (
        f'<nav class="bar"><div>{made}<span class="grow"></span><button id="theme" title="dark or '
        f'light">dark</button>{cursor}</div></nav>'
    )


def page(*, title, subtitle, summary, body, figures, chips, span=None, start=0.0, faults=(), alarms=()):
    """Return the page as HTML text.

    `summary`, `body` are HTML; `figures` the Figures whose places stand in them; `chips` [(detector, level, alarmed)];
    `span` the (first, last) time for pages with a time cursor, which starts at `start`; `faults` and `alarms` are
    [{from, to, text, detector}] for the line that says what is on at the cursor.
    """
    content = {
        "figures": [f.plain() for f in figures],
        "span": span,
        "start": start,
        "faults": list(faults),
        "alarms": list(alarms),
    }
    packed = json.dumps(plain(content), allow_nan=False, separators=(",", ":")).replace("</", "<\\/")
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<link rel="icon" '
            f'href="data:,"><title>{text(title)}</title><style>{_own("page.css")}</style></head><body>',
            f'<header class="top"><h1>{text(title)}</h1><p '
            f'class="sub">{text(subtitle)}</p></header>{_bar(chips, span)}',
            f'<main><section class="summary" id="summary">{summary}</section>{body}</main>',
            f'<script type="application/json" id="figures">{packed}</script>',
            f"<script>{get_plotlyjs()}</script><script>{_own('page.js')}</script></body></html>\n",
        ]
    )


def _own(name):
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def write(path, content):
    """Write the page; returns its Path. Raises OutputError when that cannot be done."""
    replace_text(path, content)
    return Path(path)
