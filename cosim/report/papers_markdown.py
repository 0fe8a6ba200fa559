"""The tables in cosim/papers/README.md: what `cosim reproduce all --readme FILE` writes between its markers."""

from collections.abc import Iterable
from pathlib import Path

from cosim.papers.broken import Broken
from cosim.papers.row import Row, counts
from cosim.papers.tables import proof, rows
from cosim.report import markdown as readme
from cosim.table import Table

NAME, PROOF = "reproduce", "broken"  # of the markers
def markdown(found: Iterable[Row], held: str = "") -> str:
    """Return the counts per paper, then every row folded, as Markdown; papers without rows stay as `held` has them."""
    found = list(found)
    own = {name: [r for r in found if r.paper == name] for name in dict.fromkeys(r.paper for r in found)}
    _, totals = parsed(held)
    blocks = {name: _block(held, name) for name in totals if name != "all"}
    folded = "<details><summary>{}, row by row</summary>\n\n{}\n\n</details>".format
    blocks |= {name: folded(name, rows(each).markdown()) for name, each in own.items()}
    totals |= {name: (len(each), *counts(each).values()) for name, each in own.items()}
    totals["all"] = tuple(sum(column) for column in zip(*(totals[name] for name in blocks)))
    made = Table("", "paper", "rows", "agree", "differ, explained", "differ", "ours, no claim", "beyond")
    for name in (*blocks, "all"):
        made.add(name, *totals[name])
    return "\n".join([made.markdown(), *("\n" + block for block in blocks.values())])


def _block(text, name):
    start = text.index(f"<details><summary>{name}, row by row")
    return text[start : text.index("</details>", start) + len("</details>")]


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


def write(path: str | Path, found: Iterable[Row]) -> None:
    """Write rows `found` into the page at `path`, between its markers; papers without rows stay. Raises OutputError."""
    path = Path(path)
    held = readme.part(readme.read(path), NAME) if path.is_file() else None
    readme.replace(path, NAME, markdown(found, held or ""))


def write_proof(path: str | Path, found: Iterable[Broken]) -> None:
    """Write the list of broken methods into the page at `path`, between its markers. Raises OutputError."""
    readme.replace(path, PROOF, proof(found).markdown())
