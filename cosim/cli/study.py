"""Commands about the detectors' grounds: the papers' experiments, stored designs and thresholds."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group

from cosim.cli import output as shared
from cosim.cli import tables
from cosim.cli.app import answer, app, err, only_with
from cosim.cli.output import argument, flag, option, output_option, reserve
from cosim.files import columns, replace
from cosim.table import Cell, Row, Table
from cosim.training import TRAINERS


@app.command()
def reproduce(
    paper: Annotated[str, argument("PAPER", "lu17, jay, sun13, mar10, alwi14 or all.")] = "all",
    output: Annotated[Path, output_option("DIR", "Folder of page and rows.")] = Path("logs"),
    overwrite: shared.OverwriteOption = False,
    readme: shared.ReadmeOption = None,
    break_: Annotated[bool, flag("--break", "Instead break the methods and see which rows notice.")] = False,
    workers: shared.WorkersOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Repeat the papers' experiments: paper says, we get, verdict.

    Exit status 1 when a row differs.
    """
    from pandas import DataFrame

    from cosim.papers import chosen, counts, proof
    from cosim.papers import reproduce as work
    from cosim.report import markdown

    chosen(paper)
    if readme:
        markdown.read(readme)
    if break_:
        with tables.progress(err, f"breaking {paper}", unit="papers", waiting="preparing") as progress:
            seen = proof(paper, progress=progress, workers=workers)
        if readme:
            from cosim.report.papers_markdown import write_proof

            write_proof(readme, seen)
        from cosim.papers.tables import proof as made

        answer(json_, {"broken": [_finite(asdict(b)) for b in seen]}, lambda _: made(seen))
        raise typer.Exit(0 if all(b.seen for b in seen) else 1)
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
    if readme:
        from cosim.report.papers_markdown import write
        from cosim.report.reproduce_page import write_pictures

        write(readme, rows)
        write_pictures(readme.parent, drawings)
    told = {**found, "rows": [_finite(r) for r in found["rows"]]}
    files = [tables.whole(f"{key:<7}{found[key]}, every row") for key in ("report", "table")]
    answer(json_, told, lambda _: Group(reproduced(rows, found["counts"]), *files))
    if found["counts"]["differs"]:
        raise typer.Exit(1)


def _own(aircraft, names, check, flights, output, workers):
    """Make, unless only to be checked, designs and thresholds of another aircraft; return {detector: problem}."""
    from cosim.errors import DesignError
    from cosim.scenario.aircraft import load_aircraft
    from cosim.training import aircraft_designs as work

    if names:
        raise DesignError("--aircraft makes all of them", place=names[0], remedy="Leave the name out")
    if not check:
        folder = output or Path("logs") / f"design-{load_aircraft(aircraft).name}"
        tell = lambda text: err.print(text, soft_wrap=True, highlight=False)  # noqa: E731
        with tables.progress(err, "designing", unit="jobs", waiting="preparing") as progress:
            work.make(aircraft, flights=flights or work.FLIGHTS, folder=folder, workers=workers,
                      progress=progress, tell=tell)  # fmt: skip
    return work.check(aircraft)


@app.command()
def design(
    names: Annotated[list[str] | None, argument("DESIGN", "Designs to make; default: all.")] = None,
    check: Annotated[bool, flag("--check", "Only say whether the stored designs belong to this aircraft.")] = False,
    aircraft: Annotated[str, option("NAME|DIR", "Another aircraft's, and its thresholds.")] = "",
    flights: Annotated[int | None, option(None, "Fault-free, with --aircraft: 128.", min=32)] = None,
    output: Annotated[Path | None, output_option("DIR", "Of results; goes on there.")] = None,
    workers: shared.WorkersOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Make the detectors' stored designs anew, or check them.

    From the aircraft that flies. Exit status 1: a stored one is stale.
    """
    from cosim.training import designs as work

    if aircraft:
        found = _own(aircraft, names, check, flights, output, workers)
    else:
        chosen = names or list(work.DESIGNS)
        for name in chosen:
            work.known(name)
        for name in () if check else chosen:
            work.build(name, progress=lambda text: err.print(text, soft_wrap=True, highlight=False))
        found = {name: work.check(name) for name in chosen}
    about = {name: (aircraft or work.DESIGNS[name].what, problem) for name, problem in found.items()}
    answer(json_, {"designs": found, "ok": not any(found.values())}, lambda _: designs(about))
    if any(found.values()):
        raise typer.Exit(1)


@app.command()
def train(
    name: Annotated[str, argument("NAME", f"{', '.join(TRAINERS)}; with --tune a detector.")],
    check: Annotated[bool, flag("--check", "Write nothing.")] = False,
    tune: Annotated[list[str] | None, option("FIELD=LOW:HIGH", "Search this number; store nothing.")] = None,
    campaign: Annotated[str | None, option("CAMPAIGN", "With --tune: whose flights. Default: aircraft-faults.")] = None,
    false_alarms: Annotated[
        float | None, option("N", "With --tune: at most, per valid hour. Default: 0.", min=0.0)
    ] = None,
    flights: Annotated[
        int | None, option("N", "With --tune: faulty ones, and as many without. Default: 24.", min=2)
    ] = None,
    first_seed: Annotated[int | None, option(None, "Of the training flights.", min=0)] = None,
    output: Annotated[Path | None, output_option("DIR", "Of results; goes on there.")] = None,
    workers: shared.WorkersOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Train thresholds on fault-free flights, or tune a detector."""
    from cosim.judge.result import plain
    from cosim.training import load

    only_with("--tune", tune, campaign=campaign, false_alarms=false_alarms, flights=flights)
    if tune:
        how = {"campaign": campaign or "aircraft-faults", "false_per_hour": false_alarms or 0.0, "most": flights or 24}
        _tune(name, tune, json_, **how, **({} if first_seed is None else {"first_seed": first_seed}))
        return
    training = load(name)
    how = {"folder": output or Path("logs") / f"train-{name}", "workers": workers}
    with tables.progress(err, "training", unit="flights", waiting="preparing") as progress:
        made = training.train(**how, progress=progress, **({} if first_seed is None else {"first_seed": first_seed}))
    heads, changes = ("file", "set", "threshold", "stored>", "trained>"), training.changes(made)
    found = {"changes": [dict(zip((h.strip(">") for h in heads), plain(row))) for row in changes]}
    title = "The entry of each threshold that changes most"
    answer(json_, found, lambda _: Table(title, *heads, rows=map(Row, changes)))
    if not check:
        training.store(made)


def _tune(name, asked, json_, **how):
    """Print the numbers that `cosim.training.tune` finds, beside those in use."""
    from cosim.errors import DesignError
    from cosim.training import tune as work

    spans = {}
    for text in asked:
        field, _, span = text.partition("=")
        try:
            low, high = map(float, span.split(":"))
        except ValueError:
            raise DesignError(f"{span!r} is no span", place=f"--tune {text}", allowed="FIELD=LOW:HIGH") from None
        spans[field] = (low, high)
    with tables.progress(err, f"tuning {name}", unit="sets", waiting="flying") as progress:
        found, scores = work.tune(name, spans, progress=progress, **how)
    numbers = Table("Numbers of the least mean delay", "number", "tuned>", rows=map(Row, found.items()))
    rows = [Row((words, *score.cells)) for words, score in scores]
    flown = Table("Flights", "flights, numbers", "seen>", "mean delay>", "false alarms>", rows=rows)
    told = {"numbers": found, "flights": [{"flights": words, **score._asdict()} for words, score in scores]}
    answer(json_, told, lambda _: Group(numbers, flown))


def _finite(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with null for a number that JSON cannot hold."""
    return row if math.isfinite(row["got"]) else {**row, "got": None}


def reproduced(found: list[Any], counts: dict[str, int]) -> Group:
    """Return the counts of the verdicts, then the rows that differ, explained or not."""
    from cosim.papers import tables as made

    words = {"ours": "ours (the paper gives no number)", "beyond": "beyond the paper"}
    total = "   ".join(f"{n} {words.get(v, made.VERDICTS[v][0])}" for v, n in counts.items())
    off = [row for row in found if row.verdict.startswith("differs")]
    return Group(total, *([made.rows(off, several=len({row.paper for row in off}) > 1)] if off else []))


def designs(found: dict[str, tuple[str, str]]) -> Table:
    """Return a table of {design: (what it is, problem or "")}."""
    t = Table("Stored designs", "design", "what", "state")
    for name, (what, problem) in found.items():
        t.add(name, what, Cell(problem, "bad") if problem else Cell("belongs to this aircraft", "good"))
    return t
