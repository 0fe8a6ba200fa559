"""MathML in place of TeX: what arithmatex marked is converted when a page is built, so that a browser loads nothing."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

MARKED = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.S)


def on_page_content(text: str, **_: Any) -> str:
    """Return the page's HTML with every formula as MathML; a ValueError for TeX that the converter does not know."""
    return MARKED.sub(lambda m: _formula(html.unescape(m[3]), "block" if m[2] == "[" else "inline"), text)


def _formula(tex: str, display: str) -> str:
    made = convert(tex, display=display)
    if left := re.search(r"\\[A-Za-z]+", made):  # the converter prints what it does not know
        raise ValueError(f"{left[0]} in {tex!r} is not known. Write it with another command")
    return made
