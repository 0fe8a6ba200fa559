"""Commands about an aircraft's folder: does it keep its contract; write its JSBSim files from its dimensions."""

import json
from typing import Annotated

import typer

from cosim.cli.app import answer, app, out
from cosim.cli.output import JsonOption
from cosim.files import replace_text
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


@app.command()
def estimate(
    aircraft: Annotated[str, typer.Argument(metavar="NAME|DIR", help="A folder with aircraft.toml and numbers.toml.")],
    check: Annotated[bool, typer.Option("--check", help="Only tell whether the files are what this makes.")] = False,
    json_: JsonOption = False,
) -> None:
    """Write an aircraft's JSBSim files from its dimensions, by handbook formulas."""
    from cosim.flight.plant.aero.estimate import build
    from cosim.scenario.aircraft import load_aircraft

    made = build(load_aircraft(aircraft))
    stale = [path for path, text in made.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    for path in () if check else stale:
        path.parent.mkdir(exist_ok=True)
        replace_text(path, made[path])
    names = [path.name for path in stale]
    word = "differ from what the numbers give" if check else "written"
    answer(json_, {"files": len(made), "changed": names}, lambda _: f"{', '.join(names) or 'no file'} {word}")
    if check and stale:
        raise typer.Exit(1)
