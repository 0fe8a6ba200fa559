"""Hooks of mkdocs: each page's code runs in a folder of its own, and formulas become MathML, which needs no script."""

import html
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert

WORK = tempfile.TemporaryDirectory()
MARKED = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.S)
TITLED = re.compile(r'^```\w+ title="([^"]+)"\n(.*?)^```$', re.S | re.M)


def on_startup(**_: Any) -> None:
    """Set what the commands on the pages find: 80 columns, this interpreter, and plots.py for the figures."""
    os.environ |= {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb"}
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    sys.path.insert(0, str(Path(__file__).parent))


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Go to a fresh folder for the page's code, and write the files that it shows under a title."""
    folder = Path(WORK.name) / page.file.src_uri
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    for name, text in TITLED.findall(markdown):
        Path(name).write_text(text, encoding="utf-8")
    return markdown


def on_page_content(text: str, **_: Any) -> str:
    """Return the page's HTML with every formula as MathML; a ValueError for TeX that the converter does not know."""
    return MARKED.sub(lambda m: _formula(html.unescape(m[3]), "block" if m[2] == "[" else "inline"), text)


def _formula(tex: str, display: str) -> str:
    mathml = convert(tex, display=display)
    if unknown := re.search(r"\\[A-Za-z]+", mathml):  # the converter prints what it does not know
        raise ValueError(f"{unknown[0]} in {tex!r} is not known. Write it with another command")
    return mathml
