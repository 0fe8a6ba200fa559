"""Commands about many flights and their pages: `campaign`, `report`, `compare`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group
from rich.text import Text

from cosim.cli import flight, tables
from cosim.cli import output as shared
from cosim.cli.app import answer, app, err, notes, out
from cosim.cli.output import argument, flag, option, output_option, reserve
from cosim.errors import CosimError


def _left_out(damaged, what):
    notes(f"damaged and left out: {path}; {what}" for path in damaged)


@app.command()
def campaign(
    campaign: shared.CampaignArg,
    workers: shared.WorkersOption = None,
    scheduler: Annotated[str | None, option("ADDRESS", "Fly on a Dask cluster: tcp://host:8786.")] = None,
    resume: Annotated[bool, flag("--resume", "Go on in this folder; failed runs fly again.")] = False,
    anew: Annotated[bool, flag("--anew", "Go on; runs of a file of yours that has changed fly again.")] = False,
    output: Annotated[Path | None, output_option("DIR", "Default: logs/<campaign>.")] = None,
    overwrite: shared.OverwriteOption = False,
    again: Annotated[str | None, option("ID", "Fly one run again, with a log, and compare its row.", "--rerun")] = None,
    detector: shared.DetectorOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Fly grids and draws of scenarios, a row per flight.

    Exit status 1: a run ended in an error, or none could be flown.
    """
    from cosim.campaign.run import run_campaign

    if again:
        _rerun(campaign, again, json_, out=output, guests=detector or ())
    with tables.progress(err, f"flying {Path(campaign).stem}", "runs", "preparing the workers") as progress:
        done = run_campaign(
            campaign, workers=workers, scheduler=scheduler, out=output, resume=resume, anew=anew, progress=progress,
            guests=detector or (),
        )  # fmt: skip
    from cosim.cli import campaign as cli_campaign

    _left_out(done.damaged, "their runs were flown again")
    notes(done.notes)
    answer(json_, {**done.to_dict(), "errors": cli_campaign.errors(done.frame)}, lambda _: cli_campaign.campaign(done))
    raise typer.Exit(cli_campaign.exit_status(done.frame))


def _rerun(campaign, run, json_, **how):
    """Fly one run again, print it and whether its row repeats, and exit."""
    from cosim.campaign.run import rerun

    flown, result, repeats, same_code = rerun(campaign, run, **how)
    found = {**result.to_dict(), "run": run, "repeats": repeats, "same_code": same_code}
    answer(json_, found, lambda _: flight.shown(found, flown))
    if repeats is not None and not json_:
        other = "" if same_code else ": the campaign was flown with other code, designs or libraries"
        out.print("its row repeats exactly" if repeats else f"[bold red]its row does not repeat[/]{other}")
    raise typer.Exit(1 if repeats is False else 0)


@app.command()
def dataset(
    campaign: shared.CampaignArg,
    output: Annotated[Path | None, output_option("DIR", "Default: logs/<campaign>-dataset.")] = None,
    signal: Annotated[list[str] | None, option("WORD", "`cosim list signals`. Default: all.")] = None,
    rate: Annotated[float, option("HZ", "Samples a second.")] = 50.0,
    limit: Annotated[int | None, option(None, "The first flights only.", min=1)] = None,
    anew: Annotated[bool, flag("--anew", "Fly again what a file of yours flew that has changed since.")] = False,
    workers: shared.WorkersOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Fly a campaign into a labelled data set.

    Parquet, Croissant, splits, a datasheet. Goes on after a kill.
    """
    from cosim.campaign.dataset import make
    from cosim.campaign.run import folder

    out_dir = output or folder(campaign).with_name(f"{Path(campaign).stem}-dataset")
    with tables.progress(err, f"flying {Path(campaign).stem}", "flights", "preparing the workers") as progress:
        made = make(
            campaign, out_dir, signals=signal or (), rate_hz=rate, limit=limit, anew=anew, workers=workers,
            progress=progress,
        )  # fmt: skip
    lost = f", {made['failed']} without a steady flight" if made["failed"] else ""
    size = f"{made['bytes'] / 1e6:.1f} MB, {made['bytes_per_flight'] / 1e3:.0f} kB each"
    told = f"{made['flights']} flights{lost}: {made['samples']} samples, {size}\ndata   {made['folder']}"
    notes(made["notes"])
    answer(json_, made, lambda _: tables.whole(told))


@app.command()
def report(
    log: Annotated[Path, argument("LOG|DIR", "A log; a campaign's folder, or one of logs.")],
    output: Annotated[Path | None, output_option("HTML", "Default: beside the log.")] = None,
    overwrite: shared.OverwriteOption = False,
    light: Annotated[
        bool, flag("--light", "Of one log: figures as SVG, under 500 kB, without cursor and zoom.")
    ] = False,
    json_: shared.JsonOption = False,
) -> None:
    """Write one HTML page of a flight, a recording or a folder.

    It opens offline. Of a recording: what `cosim replay --map -o` made of it. Of a folder: its logs, compared.
    """
    if light and log.is_dir():
        raise CosimError("is for the page of one log", place="--light", remedy="Name a log, or leave --light out")
    path = output or (log / "compare.html" if log.is_dir() else log.with_suffix(".html"))
    from cosim.report.page import PAGE

    reserve(path, PAGE, taken={"the log": [log]}, endings=(".html", ".htm"))
    if log.is_dir():
        from cosim.compare import compare as work
        from cosim.report import comparison_report

        with tables.progress(err, "reading", unit="logs") as progress:
            made = comparison_report(work([log], progress=progress), path)
    else:
        from cosim.log import open_log
        from cosim.report import diagnosis_report, flight_report

        foreign = "map.toml" in open_log(log, tolerant=True).attachments
        made = (diagnosis_report if foreign else flight_report)(log, path, light=light)
    answer(json_, {"report": str(made)}, lambda _: tables.whole(f"report {made}"))


@app.command()
def compare(
    sources: Annotated[
        list[Path] | None,
        argument(
            "LOG|DIR", "Logs, a campaign's folder, or two of them side by side. Default: a small built-in matrix."
        ),
    ] = None,
    output: Annotated[Path | None, output_option("DIR", "Folder for report and tables. Default: write none.")] = None,
    overwrite: shared.OverwriteOption = False,
    workers: shared.WorkersOption = None,
    readme: shared.ReadmeOption = None,
    detector: shared.DetectorOption = None,
    fault_rate: Annotated[
        list[float] | None, option("PER_HOUR", "What an alarm is worth at so many faults per flight hour.")
    ] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Compare detectors on the same flights: who sees what, when."""
    from cosim.compare import compare as work
    from cosim.judge.result import plain
    from cosim.report import write_comparison
    from cosim.report.compare_page import SIGNS

    if output:
        for name, sign in SIGNS.items():
            reserve(output / name, sign)
    if readme:
        if len(sources or ()) > 1:
            raise CosimError("is for one campaign", place="--readme", remedy="Leave it out")
        from cosim.report.compare_markdown import targets, write

        for path in targets(readme):  # before a flight is flown
            reserve(path, None)
    with tables.progress(err, "flying" if not sources else "reading", unit="flights", waiting="preparing") as progress:
        made = work(sources or (), workers=workers, progress=progress, guests=detector or ())
        if output:
            write_comparison(made, output)
    _left_out(made.damaged, "`cosim campaign --resume` flies their runs again")
    if readme:
        write(made, readme)
    found = made.to_dict() | {"predictive": plain(made.predictive(fault_rate or ()))}
    answer(json_, found, compared)


def compared(found: dict) -> Group:
    """Return the table of a comparison: `found` is the JSON of `cosim compare`."""
    from cosim.compare.tables import by_level, detectors, pairs, predictive  # `--help` needs no pandas

    lost = f"; {found['failed']} could not be flown" if found["failed"] else ""
    mute = [d for d in found["detectors"] if d["not_valid"] and d["why_not_valid"]]
    why = [f"{d['id']} not valid: {d['why_not_valid']}" for d in mute]
    files = [Text(f"{key:<7}{found[key]}") for key in ("report", "table") if found[key]]
    head = Text(f"{found['runs']} flights, {found['source']}{lost}")
    beside = [pairs(found["pairs"])] if found.get("pairs") else []
    joint = found.get("levels") and any(d["level"] == "both" for d in found["detectors"])
    more = [by_level(found["levels"])] if joint else []
    more += [predictive(found["predictive"])] if found.get("predictive") else []
    why_not = (Text(line, "dim") for line in why)
    return Group(head, *beside, detectors(found["detectors"]), *why_not, *more, *files)
