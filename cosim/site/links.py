"""Check the links of a built site: each leads to a file and an anchor that are there; no page loads from elsewhere."""

import re
import urllib.parse
from html.parser import HTMLParser
from pathlib import Path

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}


class Page(HTMLParser):
    """Collect the anchors of a page, where its links lead, and what it loads."""

    def __init__(self, text: str):
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        """Note what a tag names, links to and loads."""
        given = dict(attrs)
        self.anchors |= {given[key] for key in ("id", "name") if given.get(key)}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        if tag in LOADED and given.get(LOADED[tag]) and given.get("rel") != "canonical":
            self.loaded.append(given[LOADED[tag]])


def wrong(folder: Path) -> list[str]:
    """Return a line for each link of the pages in `folder` that leads nowhere, and for each load from elsewhere."""
    pages = {p.resolve(): Page(p.read_text(encoding="utf-8")) for p in sorted(folder.rglob("*.html"))}
    out = []
    for path, page in pages.items():
        here = path.relative_to(folder.resolve())
        out += [f"{here}: loads {url}" for url in page.loaded if re.match(r"(https?:)?//", url)]
        for url in [*page.links, *page.loaded]:
            parts = urllib.parse.urlsplit(url)
            if parts.scheme or parts.netloc or here.name == "404.html":
                continue
            target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file():
                out.append(f"{here}: {url} is not there")
            elif parts.fragment and target in pages:
                anchor = urllib.parse.unquote(parts.fragment)
                if anchor not in pages[target].anchors and not anchor.startswith("__"):
                    out.append(f"{here}: {url}: no such anchor")
    return out
