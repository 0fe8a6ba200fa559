"""Commands about many flights and their pages: `campaign`, `report`, `compare`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group
from rich.text import Text

from cosim.cli import flight, tables
from cosim.cli import output as shared
from cosim.cli.app import answer, app, err, notes, only_with, out
from cosim.cli.output import argument, flag, option, output_option, reserve


@app.command()
def campaign(
    campaign: shared.CampaignArg,
    workers: shared.WorkersOption = None,
    scheduler: Annotated[str | None, option("ADDRESS", "Fly on a Dask cluster: tcp://host:8786.")] = None,
    resume: Annotated[bool, flag("--resume", "Go on in this folder; failed runs fly again.")] = False,
    output: Annotated[Path | None, output_option("DIR", "Default: logs/<campaign>.")] = None,
    signals: Annotated[
        list[str] | None,
        option("WORD", "Write this signal of every flight, with labels: `cosim list signals`, or all. Repeatable."),
    ] = None,
    rate: Annotated[float | None, option("HZ", "With --signals: samples a second. Default: 50.")] = None,
    again: Annotated[str | None, option("ID", "Fly one run again, with a log, and compare its row.", "--rerun")] = None,
    detector: shared.DetectorOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Fly grids and draws of scenarios, a row per flight.

    Exit status 1: a run ended in an error, or none could be flown.
    """
    from cosim.campaign.engine import run_campaign

    only_with("--signals", signals, rate=rate)
    if again:
        _rerun(campaign, again, json_, out=output, guests=detector or ())
    with tables.progress(err, f"flying {Path(campaign).stem}", "runs", "preparing the workers") as progress:
        done = run_campaign(
            campaign, workers=workers, scheduler=scheduler, out=output, resume=resume, progress=progress,
            guests=detector or (), signals=signals and [w for w in signals if w != "all"], rate_hz=rate or 50.0,
        )  # fmt: skip
    from cosim.cli import campaign as cli_campaign

    notes(done.notes)
    answer(json_, {**done.to_dict(), "errors": cli_campaign.errors(done.frame)}, lambda _: cli_campaign.campaign(done))
    raise typer.Exit(cli_campaign.exit_status(done.frame))


def _rerun(campaign, run, json_, **how):
    """Fly one run again, print it and whether its row repeats, and exit."""
    from cosim.campaign.engine import rerun

    flown, result, repeats, same_code = rerun(campaign, run, **how)
    found = {**result.to_dict(), "run": run, "repeats": repeats, "same_code": same_code}
    answer(json_, found, lambda _: flight.shown(found, flown))
    if repeats is not None and not json_:
        other = "" if same_code else ": the campaign was flown with other code, designs or libraries"
        out.print("its row repeats exactly" if repeats else f"[bold red]its row does not repeat[/]{other}")
    raise typer.Exit(1 if repeats is False else 0)


@app.command()
def report(
    log: Annotated[Path, argument("LOG|DIR", "A log; a campaign's folder, or one of logs.")],
    output: Annotated[Path | None, output_option("HTML", "Default: beside the log.")] = None,
    overwrite: shared.OverwriteOption = False,
    json_: shared.JsonOption = False,
) -> None:
    """Write one HTML page of a flight, a recording or a folder.

    It opens offline. Of a recording: what `cosim replay --map -o` made of it. Of a folder: its logs, compared.
    """
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
        made = (diagnosis_report if foreign else flight_report)(log, path)
    answer(json_, {"report": str(made)}, lambda _: tables.whole(f"report {made}"))


@app.command()
def compare(
    sources: Annotated[list[Path], argument("PATH", "Logs, a campaign's folder, or two of them side by side.")],
    output: Annotated[Path | None, output_option("DIR", "Folder for report and tables. Default: write none.")] = None,
    overwrite: shared.OverwriteOption = False,
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
    with tables.progress(err, "reading", unit="flights", waiting="preparing") as progress:
        made = work(sources, progress=progress, guests=detector or ())
        if output:
            write_comparison(made, output)
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
