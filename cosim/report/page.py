"""One self-contained HTML page: style, figures, plotly.js and a script in one file that opens offline.

A page is a list of sections, a heading and what stands below it each: a Figure, a Table, a paragraph (a text), a list
(of texts), a legend (of (class, symbol, words)) or what opens on a click ({"title": text, "content": any of these, or
"source": text}). None and empty tables are left out, and so is a section of which nothing is left.
"""

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs

from cosim.files import PAGE, replace_text
from cosim.judge.result import plain
from cosim.report.figure import Figure
from cosim.table import Table


@cache
def environment() -> Environment:
    """Return the templates' environment: every value is escaped, an unknown name is an error."""
    made = Environment(
        loader=PackageLoader("cosim.report", ""), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return made


def page(
    *, title: str, subtitle: str, summary: Sequence[tuple[str, list]], sections: Sequence[tuple[str, list]],
    chips: Sequence[Any] = (), span: list[float] | None = None, start: float = 0.0,
    faults: Sequence[Any] | None = None, alarms: Sequence[Any] = (),
) -> str:  # fmt: skip
    """Return the page as HTML text.

    `summary` is [(heading, [texts])]; `chips` [(detector, level, alarmed)]; `span` the (first, last) time for pages
    with a time cursor, which starts at `start`; `faults` and `alarms` are [{from, to, text, detector}] for the line
    that says what is on at the cursor; None where nobody knows the faults.
    """
    kept = [(heading, [item for item in items if not _empty(item)]) for heading, items in sections]
    figures = [item.plain() for _, items in kept for item in items if isinstance(item, Figure) and item.data]
    data = {"figures": figures, "span": span, "start": start, "faults": faults, "alarms": alarms}
    fixed = {name: files(__package__).joinpath(f"page.{name}").read_text(encoding="utf-8") for name in ("css", "js")}
    return environment().get_template("page.html").render(
        title=title, subtitle=subtitle, summary=summary, sections=[s for s in kept if s[1]], chips=chips, span=span,
        data=plain(data), plotly=get_plotlyjs(), **fixed,
    ).lstrip() + "\n"  # fmt: skip


def _empty(item: Any) -> bool:
    return not item.rows if isinstance(item, Table) else not item


def write(path: str | Path, content: str) -> Path:
    """Write the page; returns its Path. Raises OutputError when that cannot be done."""
    replace_text(path, content, PAGE)
    return Path(path)
