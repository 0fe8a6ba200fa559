"""Commands for what a user brings: a detector or an aircraft (`new`, `check`), a recording (`map`)."""

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.cli import output as shared
from cosim.cli import tables
from cosim.cli.app import answer, app, err, only_with, out
from cosim.cli.output import argument, option, output_option, reserve
from cosim.table import Cell, Table


def edited(path: Path) -> bool:
    """Tell of no file that it is the project's: what was drafted is there to be edited."""
    return False


@app.command()
def new(
    what: Annotated[str, argument("KIND", "detector, law, actuator, aircraft, campaign or example.")],
    name: Annotated[str, argument("NAME", "Lower-case letters, digits and _; of an example its name.")],
    numbers: Annotated[Path | None, option("FILE", "Of an aircraft: numbers.toml; writes its JSBSim files.")] = None,
    output: Annotated[Path, output_option("DIR", "Folder of the files.")] = Path("."),
    overwrite: shared.OverwriteOption = False,
    json_: shared.JsonOption = False,
) -> None:
    """Write a detector, law, actuator, aircraft, campaign or example.

    It runs as it is, and so does its test: test_NAME.py. An aircraft is first a template of its numbers to fill in.
    """
    only_with("aircraft", what == "aircraft", numbers=numbers)
    from cosim.campaign.inventory import example
    from cosim.files import replace_text
    from cosim.flight.new import KINDS, texts

    if what == "example":
        path = output / f"{name}.py"
        text = example(name)
        reserve(path, edited)
        replace_text(path, text, edited)
        said = f"wrote  {path}\nnext   python {tables.word(path)}"
        return answer(json_, {"files": [str(path)]}, lambda _: tables.whole(said))

    written = {output / file: text for file, text in texts(name, what, numbers).items()}
    made = {path: text for path, text in written.items() if not (numbers and _holds(path, text))}
    for path in made:
        reserve(path, edited)
    for path, text in made.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_text(path, text, edited)
    test = output / f"test_{name}.py"
    main = output / name if what == "aircraft" else next(path for path in written if path != test)
    told, steps = [f"wrote  {main}"], [step.format(file=tables.word(main), name=name) for step in KINDS[what]]
    if test in written:
        told, steps = [*told, f"wrote  {test}"], [*steps, f"pytest {tables.word(test)}"]
    else:
        where = "" if output == Path(".") else f" -o {tables.word(output)}"
        steps = [f"cosim new aircraft {name} --numbers {tables.word(main / 'numbers.toml')}{where}"]
    told += [f"{'      ' if i else 'next  '} {step}" for i, step in enumerate(steps)]
    answer(json_, {"files": [str(path) for path in written]}, lambda _: tables.whole("\n".join(told)))


def _holds(path, text):
    """Return whether a file is there that needs no writing: the two that the numbers of an aircraft come from."""
    return path.is_file() and path.read_text("utf-8") == text


@app.command("map")
def map_(
    recording: Annotated[Path, argument("FILE", "A table (text, Parquet) or an MCAP file.")],
    aircraft: Annotated[str | None, option("NAME", "Whose detectors judge.")] = None,
    output: Annotated[Path | None, output_option("MAP.toml", "Default: print it.")] = None,
    overwrite: shared.OverwriteOption = False,
    json_: shared.JsonOption = False,
) -> None:
    """Draft a map of a recording: which column is which signal.

    By the columns' names: what they do not say, a unit or a sign, stands as a comment and does not fly.
    """
    from cosim.files import replace_text
    from cosim.replay.map_draft import draft

    if output:
        reserve(output, edited, taken={"the recording": [recording]}, endings=(".toml",))
    text = draft(recording, aircraft=aircraft)
    if output:
        replace_text(output, text, edited)
    if json_:
        print(json.dumps({"map": str(output) if output else None, "toml": text}))
    elif output:
        command = f"cosim replay {tables.word(recording)} --map {tables.word(output)}"
        out.print(tables.whole(f"wrote  {output}\nnext   {command}"))
    else:
        print(text, end="")


@app.command()
def check(
    what: Annotated[str, argument("FILE.py|NAME|DIR", "A detector, a law; an aircraft.")],
    json_: shared.JsonOption = False,
) -> None:
    """Say whether a detector, law or aircraft keeps its contract.

    A detector: runs, deterministic, causal, live as in replay, lost samples. A law: runs, deterministic, lost samples.
    An aircraft: what is missing, signs, trim, hinge moments, effectors. Exit status 1: it does not.
    """
    from cosim.scenario.aircraft import ships

    marks = {"good": Cell("✓", "good"), "bad": Cell("✗", "bad"), "note": Cell("!", "warn")}
    if ships(what) or os.path.isdir(what):
        from cosim.flight.plant.check import check as of_aircraft

        points = of_aircraft(what)
        found: dict[str, Any] = {"aircraft": what, "keeps": all(p.good for p in points)}
        found["findings"] = [vars(p) for p in points]
        t = Table("", "", "point", "found")
        rows = [(marks["good" if p.good else "bad"], p.point, p.found) for p in points]
    else:
        from cosim.flight.check import check as of_detector

        with tables.progress(err, "checking", unit="") as progress:
            found = of_detector(what, progress=progress)
        t = Table(f"{found['id']}, {found['file']}", "", "question", "answer")
        rows = [(marks[line["result"]], line["question"], line["answer"]) for line in found["checks"]]
    for row in rows:
        t.add(*row)
    answer(json_, found, lambda _: t)
    raise typer.Exit(0 if found["keeps"] else 1)
