"""The table of results in cosim/papers/README.md, between its markers: `cosim reproduce all --readme FILE`."""

from pathlib import Path

from cosim.papers.row import VERDICTS, Row, counts
from cosim.report import markdown as readme

NAME = "reproduce"  # of the markers
WORDS = {"agrees": "agrees", "differs_explained": "explained", "differs": "**differs**", "ours": "ours"}


def markdown(rows: list[Row]) -> str:
    """Return the counts per paper, then every row folded, as Markdown."""
    papers = list(dict.fromkeys(r.paper for r in rows))
    lines = ["| paper | rows | agree | differ, explained | differ | ours, no claim |", "|---|---|---|---|---|---|"]
    for name in (*papers, "all"):
        own = [r for r in rows if name in (r.paper, "all")]
        n = counts(own)
        lines.append(f"| {name} | {len(own)} | {' | '.join(str(n[v]) for v in VERDICTS)} |")
    for name in papers:
        lines += ["", f"<details><summary>{name}, row by row</summary>", ""]
        lines += ["| what | we get | band | verdict |", "|---|---|---|---|"]
        lines += [
            f"| {_cell(r.item)} | {r.got:.3g} | {r.tolerance} | {WORDS[r.verdict]} |" for r in rows if r.paper == name
        ]
        lines += ["", "</details>"]
    return "\n".join(lines)


def identifiers(text: str) -> tuple[dict, dict]:
    """Return {paper: [row]} of the table between the markers in `text`; and {paper: (rows, four counts)} as second."""
    found: dict = {}
    totals = {}
    name = None
    for line in (readme.part(text, NAME) or "").splitlines():
        if line.startswith("<details><summary>"):
            name = line.removeprefix("<details><summary>").split(",")[0]
            found[name] = []
        elif line.startswith("| ") and not line.startswith(("| what", "| paper")):
            cells = [c.strip().replace("\0", "|") for c in line.replace("\\|", "\0").strip("|").split("|")]
            if name is None:
                totals[cells[0]] = tuple(int(c) for c in cells[1:])
            else:
                found[name].append(cells[0])
    return found, totals


def write(path: str | Path, rows: list[Row]) -> None:
    """Write the table of rows into the README at `path`, between its markers. Raises OutputError."""
    readme.replace(path, NAME, markdown(rows))


def _cell(text):
    return text.replace("|", "\\|")
