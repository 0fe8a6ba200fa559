"""Commands that measure a detector: false alarms per hour over the threshold, how far what it believes may be off."""

import dataclasses
import json
from pathlib import Path
from typing import Annotated

from rich.console import Group
from rich.text import Text

from cosim.cli import tables
from cosim.cli.app import answer, app, err
from cosim.cli.output import JsonOption, OverwriteOption, WorkersOption, argument, flag, option, output_option, reserve


@app.command(name="false-alarms")
def false_alarms(
    detectors: Annotated[
        list[str] | None, argument("DETECTOR", "That ship, or files of your own. Default: all that ship.")
    ] = None,
    hours: Annotated[float, option(None, "Flight hours; more go on from there.", min=0.0, max=1e6)] = 100.0,
    campaign: Annotated[str, option("NAME", "Fault-free campaign to fly: built-in name or file.")] = "fault-free",
    output: Annotated[Path, output_option("DIR", "Folder of flights, page and table.")] = Path("logs/false-alarms"),
    overwrite: OverwriteOption = False,
    workers: WorkersOption = None,
    json_: JsonOption = False,
) -> None:
    """Count false alarms per flight hour, over the threshold.

    Flights are kept in DIR: a killed measurement goes on, and more --hours add to it.
    """
    from cosim.compare.false_alarms import false_alarms as work
    from cosim.files import marked, replace_text
    from cosim.judge.result import plain
    from cosim.report import false_alarms_report
    from cosim.report.page import PAGE

    paths = {"report": output / "false-alarms.html", "table": output / "false-alarms.json"}
    measured = marked(b'{"campaign": ', b'"infeasible": ')
    reserve(paths["report"], PAGE)
    reserve(paths["table"], measured)
    with tables.progress(err, "flying", unit="flights", waiting="preparing the workers") as progress:
        found = work(hours=hours, campaign=campaign, detectors=detectors or (), folder=output, workers=workers,
                     progress=progress)  # fmt: skip
    false_alarms_report(found, paths["report"])
    replace_text(paths["table"], json.dumps(plain(found), allow_nan=False) + "\n", measured)
    told = {key: str(path) for key, path in paths.items()}
    answer(json_, plain(found | told), lambda _: shown(found, told))


def shown(found: dict, files: dict) -> Group:
    """Return the table of a measurement from its plain data."""
    from cosim.compare.tables import rates

    flown = Text(f"{found['flights']} flights, {found['hours']:.1f} h of {found['campaign']}", style="dim")
    lines = (tables.whole(f"{key:<8}{path}") for key, path in files.items())
    against = [Text(f"{d['id']}: {'; '.join(d['against'])}") for d in found["detectors"] if d["against"]]
    return Group(rates(found["detectors"], against=False), flown, *against, *lines)


@app.command()
def margins(
    detector: Annotated[str, argument("DETECTOR", "One that ships.")],
    flights: Annotated[int, option(None, "Without a fault, and with one, per rung.", min=1)] = 2,
    markdown: Annotated[bool, flag("--markdown", "Print the table as Markdown.")] = False,
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
