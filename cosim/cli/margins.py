"""The command that measures how far what a detector believes may be off."""

import dataclasses
from typing import Annotated

import typer

from cosim.cli import tables
from cosim.cli.app import answer, app, err
from cosim.cli.output import JsonOption, WorkersOption


@app.command()
def margins(
    detector: Annotated[str, typer.Argument(metavar="DETECTOR", help="One that ships.", show_default=False)],
    flights: Annotated[int, typer.Option("--flights", min=1, help="Without a fault, and with one, per rung.")] = 2,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print the table as Markdown.")] = False,
    workers: WorkersOption = None,
    json_: JsonOption = False,
) -> None:
    """Find how wrong a detector's numbers may be until it fails.

    Symbols, coefficients, mass, CG, delay, rate and air are set off until it raises a false alarm or loses a fault.
    """
    from cosim.campaign import margins as work

    with tables.progress(err, "flying", unit="flights", waiting="preparing the workers") as progress:
        found = work.margins(detector, flights=flights, workers=workers, progress=progress)
    told = {"detector": detector, "flights": flights, "margins": [dataclasses.asdict(m) for m in found]}
    made = work.table(found)
    made.title = f"Margins of {detector}"
    answer(json_, told, lambda _: tables.whole(made.markdown()) if markdown else made)
