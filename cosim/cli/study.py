"""The command `reproduce`: the papers' own experiments."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group

from cosim.cli import output as shared
from cosim.cli import tables
from cosim.cli.app import answer, app, err
from cosim.cli.output import argument, output_option, reserve
from cosim.files import columns, replace


@app.command()
def reproduce(
    paper: Annotated[str, argument("PAPER", "lu17, jay, sun13, mar10, alwi14 or all.")] = "all",
    output: Annotated[Path, output_option("DIR", "Folder of page and rows.")] = Path("logs"),
    overwrite: shared.OverwriteOption = False,
    workers: shared.WorkersOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Repeat the papers' experiments: paper says, we get, verdict.

    Exit status 1 when a row differs.
    """
    from pandas import DataFrame

    from cosim.papers import chosen, counts
    from cosim.papers import reproduce as work

    chosen(paper)
    page, table = (output / f"reproduce-{paper}.{ending}" for ending in ("html", "csv"))
    from cosim.report.page import PAGE

    listed = columns("paper", "item", "says")
    reserve(page, PAGE)
    reserve(table, listed)
    with tables.progress(err, f"reproducing {paper}", unit="rows", waiting="preparing") as progress:
        rows, drawings = work(paper, progress=progress, workers=workers)
    from cosim.report import reproduction_report

    written = str(reproduction_report(rows, drawings, page))
    found: dict = {"counts": counts(rows), "report": written, "table": str(table)}
    found["rows"] = [asdict(r) for r in rows]
    frame = DataFrame(found["rows"])
    replace(table, lambda part: frame.to_csv(part, index=False), listed)
    told = {**found, "rows": [_finite(r) for r in found["rows"]]}
    files = [tables.whole(f"{key:<7}{found[key]}, every row") for key in ("report", "table")]
    answer(json_, told, lambda _: Group(reproduced(rows, found["counts"]), *files))
    if found["counts"]["differs"]:
        raise typer.Exit(1)


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with null for a number that JSON cannot hold."""
    return row if math.isfinite(row["got"]) else {**row, "got": None}


def reproduced(found: list[Any], counts: dict[str, int]) -> Group:
    """Return the counts of the verdicts, then the rows that differ, explained or not."""
    from cosim.papers import tables as made

    total = "   ".join(f"{n} {made.VERDICTS[v][0]}" for v, n in counts.items())
    off = [row for row in found if row.verdict.startswith("differs")]
    return Group(total, *([made.rows(off, several=len({row.paper for row in off}) > 1)] if off else []))
