"""The tables in cosim/papers/README.md: what `cosim reproduce all --readme FILE` writes between its markers."""

from collections.abc import Iterable
from pathlib import Path

from cosim.papers.broken import Broken
from cosim.papers.row import Row, counts
from cosim.report import markdown as readme

NAME, PROOF = "reproduce", "broken"  # of the markers
WORDS = {
    "agrees": "agrees",
    "differs_explained": "explained",
    "differs": "**differs**",
    "ours": "ours",
    "beyond": "beyond",
}


def markdown(rows: Iterable[Row], held: str = "") -> str:
    """Return the counts per paper, then every row folded, as Markdown; papers without rows stay as `held` has them."""
    rows = list(rows)
    own = {name: [r for r in rows if r.paper == name] for name in dict.fromkeys(r.paper for r in rows)}
    _, totals = parsed(held)
    blocks = {name: _block(held, name) for name in totals if name != "all"}
    blocks |= {name: _folded(name, found) for name, found in own.items()}
    totals |= {name: (len(found), *counts(found).values()) for name, found in own.items()}
    totals["all"] = tuple(sum(column) for column in zip(*(totals[name] for name in blocks)))
    lines = [
        "| paper | rows | agree | differ, explained | differ | ours, no claim | beyond |",
        "|---|---|---|---|---|---|---|",
        *(f"| {name} | {' | '.join(map(str, totals[name]))} |" for name in (*blocks, "all")),
    ]
    return "\n".join([*lines, *("\n" + block for block in blocks.values())])


def _folded(name, rows):
    """Return the rows of a paper, folded."""
    lines = [f"<details><summary>{name}, row by row</summary>", ""]
    lines += [
        "| what | paper says | we get | band | verdict | why, and what came with it |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {_cell(r.item)} | {_cell(r.says)} | {r.got:.3g} | {r.tolerance} | {WORDS[r.verdict]} | "
        f"{_cell('; '.join(filter(None, (r.reason, r.note))))} |"
        for r in rows
    ]
    return "\n".join([*lines, "", "</details>"])


def _block(text, name):
    """Return the folded rows of a paper as they stand in a written table."""
    start = text.index(f"<details><summary>{name}, row by row")
    return text[start : text.index("</details>", start) + len("</details>")]


def proof(found: Iterable[Broken]) -> str:
    """Return the list of broken methods as Markdown: row, what was broken, value then."""
    unseen = (" (**not seen**)", "")
    lines = ["| paper | row | what was broken | kind | value then | band |", "|---|---|---|---|---|---|"]
    lines += [
        f"| {b.paper} | {_cell(b.item)} | {_cell(b.what)} | {b.kind} | {b.got:.3g}{unseen[b.seen]} | {b.band} |"
        for b in found
    ]
    return "\n".join(lines)


def parsed(table: str) -> tuple[dict, dict]:
    """Return ({paper: [row]}, {paper: (rows, five counts)}) of a written table."""
    found: dict = {}
    totals: dict = {}
    name = None
    for line in table.splitlines():
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


def write(path: str | Path, rows: Iterable[Row]) -> None:
    """Write rows into the page at `path`, between its markers; papers without rows stay. Raises OutputError."""
    path = Path(path)
    held = readme.part(readme.read(path), NAME) if path.is_file() else None
    readme.replace(path, NAME, markdown(rows, held or ""))


def write_proof(path: str | Path, found: Iterable[Broken]) -> None:
    """Write the list of broken methods into the page at `path`, between its markers. Raises OutputError."""
    readme.replace(path, PROOF, proof(found))


def _cell(text):
    return text.replace("|", "\\|")
