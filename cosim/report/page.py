"""One self-contained HTML page: style, figures, plotly.js and a script in one file that opens offline.

What a page says stands in its template (cosim/report/templates), which escapes every value; tables
(cosim/table.py) escape their cells themselves.
"""

import re
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from plotly.offline import get_plotlyjs

from cosim.files import marked, replace_text
from cosim.judge.result import plain


@cache
def environment() -> Environment:
    """Return the templates' environment: every value is escaped, an unknown name is an error."""
    made = Environment(
        loader=PackageLoader("cosim.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    made.filters["coded"] = lambda text: Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return made


def page(
    template: str, *, title: str, subtitle: str, figures: list, chips: Sequence[Any] = (),
    span: list[float] | None = None, start: float = 0.0, faults: Sequence[Any] = (), alarms: Sequence[Any] = (),
    **content: Any,
) -> str:  # fmt: skip
    """Return the page of `template` as HTML text; `content` are the template's own names.

    `figures` are the Figures whose places stand in it; `chips` [(detector, level, alarmed)]; `span` the (first, last)
    time for pages with a time cursor, which starts at `start`; `faults` and `alarms` are [{from, to, text, detector}]
    for the line that says what is on at the cursor.
    """
    drawn = {
        "figures": [f.plain() for f in figures if f],
        "span": span,
        "start": start,
        "faults": list(faults),
        "alarms": list(alarms),
    }
    fixed = {"css": _own("page.css"), "js": _own("page.js"), "plotly": Markup(get_plotlyjs())}
    made = environment().get_template(template)
    told = {"summary": (), **content, **fixed, "title": title, "subtitle": subtitle, "chips": chips, "span": span}
    return made.render(data=plain(drawn), **told).lstrip() + "\n"


def _own(name):
    return Markup(files(__package__).joinpath(name).read_text(encoding="utf-8"))


PAGE = marked(b"<!doctype html", b'<meta name="generator" content="cosim">')  # the sign of our pages


def write(path: str | Path, content: str) -> Path:
    """Write the page; returns its Path. Raises OutputError when that cannot be done."""
    replace_text(path, content, PAGE)
    return Path(path)
