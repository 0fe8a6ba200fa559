"""`cosim check-aircraft`: does a folder keep the contract of an aircraft?"""

import json
from typing import Annotated

import typer

from cosim.cli.app import app, out
from cosim.cli.output import JsonOption
from cosim.table import Cell, Table


@app.command("check-aircraft")
def check_aircraft(
    aircraft: Annotated[str, typer.Argument(metavar="NAME|DIR", help="A bundled aircraft, or a folder.")],
    json_: JsonOption = False,
) -> None:
    """Does an aircraft's folder keep its contract: what is missing, signs, trim, hinge moments, effectors?"""
    from cosim.flight.plant.check import check

    found = check(aircraft)
    if json_:
        print(json.dumps({"aircraft": aircraft, "findings": [vars(f) for f in found]}, allow_nan=False))
    else:
        t = Table("", "", "point", "found")
        for f in found:
            t.add(Cell("good", "good") if f.good else Cell("wrong", "bad"), f.point, f.found)
        out.print(t)
    if not all(f.good for f in found):
        raise typer.Exit(1)
