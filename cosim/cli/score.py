"""The command that scores detectors on the benchmark, and its tables, from the same plain data that --json prints."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group
from rich.text import Text

from cosim.cli import output as shared
from cosim.cli import tables
from cosim.cli.app import answer, app, err
from cosim.cli.output import argument, flag, option, output_option, reserve

FEW = 3  # detectors, up to which every family is shown
MOST = 12  # pairs that are shown


@app.command()
def score(
    detectors: Annotated[
        list[str] | None,
        argument("DETECTOR", "Detectors that ship, files of your own, installed ones by name. Default: all that ship."),
    ] = None,
    output: Annotated[Path, output_option("DIR", "Folder of page and table.")] = Path("logs/score"),
    overwrite: shared.OverwriteOption = False,
    seeds: Annotated[Path | None, option("FILE", "A sealed set: seed, first_seed.")] = None,
    limit: Annotated[int | None, option("N", "Only N flights, evenly over the families.", min=1)] = None,
    quick: Annotated[bool, flag("--quick", "A look in a minute: 40 flights, no sizes.")] = False,
    recordings: Annotated[Path | None, option("DIR", "Default: in your cache.")] = None,
    verify: Annotated[Path | None, option("TABLE", "Repeat rows of a score.json, or benchmark-1.")] = None,
    readme: shared.ReadmeOption = None,
    workers: shared.WorkersOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Score detectors on the 642 flights of the benchmark.

    They are flown and kept on first use; a new detector is a replay of minutes. With --verify exit status 1 when a
    row does not repeat.
    """
    from cosim.compare.score import board, stored
    from cosim.compare.score import score as work
    from cosim.compare.score.flights import QUICK
    from cosim.compare.score.rows import differences
    from cosim.report import markdown
    from cosim.report.score_page import SIGNS

    chosen = list(detectors or ())
    held = stored(verify, chosen, seeds) if verify else None
    if not held:
        for name, sign in SIGNS.items():
            reserve(output / name, sign)
        if readme:
            markdown.read(readme)
    limit = held.limit if held else QUICK if quick and limit is None else limit
    with tables.progress(err, "flying the benchmark, once on a machine", "flights", "preparing") as flying:
        with tables.progress(err, "scoring", "flights", "reading") as running:
            made = work(
                held.detectors if held else chosen, seeds=seeds, limit=limit, recordings=recordings,
                workers=workers, flying=flying, running=running,
            )  # fmt: skip
    if held:
        wrong = differences(held.table, made.table, ids(made.table))
        told = "\n".join(wrong or ["every row repeats"])
        answer(json_, {"repeats": not wrong, "differences": wrong}, lambda _: tables.whole(told))
        raise typer.Exit(1 if wrong else 0)
    from cosim.report import write_score
    from cosim.report.score_page import write_readme

    beside = [] if seeds else [d for d in board(made.table) if d["id"] not in ids(made.table)]
    write_score(made.table, made.found.rows, output, beside)
    if readme:
        write_readme(made.table, readme)
    answer(json_, made.table, shown)


def ids(found: dict) -> list[str]:
    """Return the ids of the detectors of a score's JSON."""
    return [d["id"] for d in found["detectors"]]


def shown(found: dict) -> Group:
    """Return the tables of a score: `found` is its JSON."""
    from cosim.compare import tables as made
    from cosim.report.score_page import flights

    each, gone = found["detectors"], found.get("lost", ())
    lines = [Text(f"not scored: {g['file']}: {g['why']}") for g in gone]
    lines += [Text(f"{key:<7}{found[key]}") for key in ("report", "table") if key in found]
    families = [made.scored_families(each)] if len(each) <= FEW else []
    pairs = [made.pairs(found["pairs"])] if 0 < len(found["pairs"]) <= MOST else []
    flown = f"{found['benchmark']}: {flights(found)}, content {found['content']}"
    clock = f"flown or found in {found['flying_s']:.0f} s, scored in {found['scoring_s']:.0f} s"
    return Group(Text(flown), made.detectors(each, scored=True), *families, *pairs, Text(clock), *lines)
