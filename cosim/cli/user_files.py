"""Commands for what a user brings: a detector or an aircraft (`new`, `check`), a recording (`map`)."""

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from cosim.cli import app as shared
from cosim.cli.app import answer, argument, command, only_with, option, output_option, progress, reserve, whole, word
from cosim.errors import CosimError
from cosim.table import Cell, Table

MARKS = {"good": Cell("✓", "good"), "bad": Cell("✗", "bad"), "note": Cell("!", "warn")}


def edited(path: Path) -> bool:
    """Tell of no file that it is the project's: what was drafted is there to be edited."""
    return False


@command("Yours")
def new(
    what: Annotated[str, argument("KIND", "detector, law, actuator, aircraft, campaign or example.")],
    name: Annotated[str, argument("NAME", "Lower-case letters, digits and _; of an example its name.")],
    numbers: Annotated[Path | None, option("FILE", "Of an aircraft: numbers.toml; writes its JSBSim files.")] = None,
    output: Annotated[Path, output_option("DIR", "Folder of the files.")] = Path("."),
    json_: shared.JsonOption = False,
) -> None:
    """Write a detector, law, actuator, aircraft, campaign or example.

    It runs as it is, and so does its test: test_NAME.py. An aircraft is first a template of its numbers to fill in.
    """
    only_with("aircraft", what == "aircraft", numbers=numbers)
    from cosim.campaign.inventory import example
    from cosim.files import replace_text
    from cosim.flight.new import KINDS, texts

    made = {f"{name}.py": example(name)} if what == "example" else texts(name, what, numbers)
    written = {output / file: text for file, text in made.items()}
    # of an aircraft the two files that its numbers come from stay as they are
    missing = {path: text for path, text in written.items() if not (numbers and _holds(path, text))}
    for path in missing:
        reserve(path, edited)
    for path, text in missing.items():
        replace_text(path, text, edited)
    test = output / f"test_{name}.py"
    main = output / name if what == "aircraft" else next(path for path in written if path != test)
    steps = [step.format(file=word(main), name=name) for step in KINDS.get(what, ("python {file}",))]
    steps += [f"pytest {word(test)}"] if test in written else []
    if what == "aircraft" and not numbers:
        steps = [f"cosim new aircraft {name} --numbers {word(main / 'numbers.toml')} -o {word(output)}"]
    told = [f"wrote  {path}" for path in (main, test) if path == main or path in written]
    told += [f"{'      ' if i else 'next  '} {step}" for i, step in enumerate(steps)]
    answer(json_, {"files": [str(path) for path in written]}, lambda _: whole("\n".join(told)))


def _holds(path, text):
    return path.is_file() and path.read_text("utf-8") == text


@command("Yours")
def check(
    what: Annotated[str, argument("FILE.py|NAME|DIR", "A detector, a law; an aircraft.")],
    json_: shared.JsonOption = False,
) -> None:
    """Say whether a detector, law or aircraft keeps its contract.

    A detector: runs, deterministic, causal, live as in replay, lost samples. A law: runs, deterministic, lost samples.
    An aircraft: what is missing, signs, trim, hinge moments, effectors. Exit status 1: it does not.
    """
    from cosim.flight.check import check as checked

    with progress("checking", unit="") as tell:
        found = checked(what, progress=tell)
    t = Table(what, "", "question", "answer")
    for line in found["checks"]:
        t.add(MARKS[line["result"]], line["question"], line["answer"])
    answer(json_, found, lambda _: t)
    raise typer.Exit(0 if found["keeps"] else 1)


@command("Yours", "map")
def map_(
    recording: Annotated[Path, argument("FILE", "A table (text, Parquet) or an MCAP file.")],
    aircraft: Annotated[str | None, option("NAME", "Whose detectors judge.")] = None,
    output: Annotated[Path | None, output_option("MAP.toml", "Default: print it.")] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Draft a map of a recording: which column is which signal.

    By the columns' names: what they do not say, a unit or a sign, stands as a comment and does not fly.
    """
    from cosim.files import replace_text
    from cosim.replay.map_draft import draft

    if output and output.suffix != ".toml":
        raise CosimError("its ending says no known format", place=str(output), allowed=".toml")
    if output:
        reserve(output, edited)
    text = draft(recording, aircraft=aircraft)
    if output:
        replace_text(output, text, edited)
    if not (output or json_):
        return print(text, end="")  # for a file, too: no line of it may be folded
    told = f"wrote  {output}\nnext   cosim replay {word(recording)} --map {word(output)}"
    answer(json_, {"map": str(output) if output else None, "toml": text}, lambda _: whole(Text(told)))
