"""The commands of a flight: `run`, `list`, `info`, `report`, `linearize`. Each parses, prints, exits; the work is in
functions that a notebook can call."""

import hashlib
import importlib
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.cli import app as shared
from cosim.cli import flight, inventory
from cosim.cli.app import (
    LAYOUT,
    LIVE_PORT,
    answer,
    app,  # noqa: F401 - with the commands below
    argument,
    command,
    err,
    flag,
    named,
    notes,
    only_with,
    out,
    output_option,
    progress,
    reserve,
    served,
    whole,
    word,
)
from cosim.errors import CosimError, did_you_mean
from cosim.progress import Compiling

DEFAULT = "liquid-ofc"
LONGEST = 100  # characters of a log's name


@command("Start")
def run(
    scenario: shared.ScenarioArg = DEFAULT,
    set_: shared.SetOption = None,
    output: Annotated[Path | None, output_option("LOG", "Default: logs/SCENARIO+KEY=VALUE.mcap.")] = None,
    strict: Annotated[bool, flag("--strict", "Exit with 1 when the flight departs.")] = False,
    report: Annotated[bool, flag("--report", "Write an HTML report beside the log.")] = False,
    details: Annotated[bool, flag("--details", "Show every detector and column, and what the aircraft did.")] = False,
    live: Annotated[
        bool, flag("--live", "Fly by the clock: watch, inject and heal in Foxglove (layout beside the log).")
    ] = False,
    speed: shared.SpeedOption = None,
    port: shared.PortOption = None,
    detector: shared.DetectorOption = None,
    json_: shared.JsonOption = False,
) -> None:
    """Fly a scenario, log it, show who alarmed, when, and for what."""
    only_with("--live", live, speed=speed, port=port)
    flown = loaded(scenario, set_ or (), detector or ())
    variant = [*(set_ or ()), *(f"detector={file.stem}" for file in detector or ())]
    path = output or Path("logs") / f"{log_name(scenario, variant)}.mcap"
    from cosim.log.format import OURS

    reserve(path, OURS, log=True)
    page, layout = path.with_suffix(".html"), path.with_suffix(".foxglove.json")
    if report:
        from cosim.report.page import PAGE

        reserve(page, PAGE)
    if live:
        reserve(layout, LAYOUT)
    overwritten = path.is_file()
    with named(scenario):
        flown = _prepared(flown)
        with progress(f"flying {Path(scenario).stem}", waiting="preparing") as tell:
            if live:
                from cosim.flight.interactive.live import fly_live

                told: Any = {"progress": tell, "ready": lambda server: served(server, layout)}
                where = LIVE_PORT if port is None else port
                result, flown = fly_live(flown, log=path, port=where, speed=speed or 1.0, **told)
            else:
                from cosim.flight.simulate import simulate

                result = simulate(flown, log=path, progress=tell, achieved=True)
    found = result.to_dict() | {"overwritten": overwritten}
    notes(found.get("notes", ()))
    if report:
        from cosim.report import flight_report

        found["report"] = str(flight_report(found["log"], page))
    answer(json_, found, lambda _: flight.shown(found, flown, details))
    if found["status"] == "interrupted":
        raise typer.Exit(130)
    if strict and found["status"] != "completed":
        raise typer.Exit(1)


def loaded(scenario: str, overrides: Any, detectors: Any = ()) -> Any:
    """Return the Scenario of a command; of a campaign's file say which command flies it. Raises CosimError."""
    from cosim import parts
    from cosim.scenario import load_scenario
    from cosim.scenario.user_parts import identified
    from cosim.texts import read, toml

    parts.loaded(detectors)  # the scenario may set their parameters
    try:
        flown = load_scenario(scenario, overrides)
    except CosimError:
        if Path(scenario).is_file() and {"base", "part"} & set(toml(read(scenario), place=scenario)):
            remedy = f"cosim campaign {scenario} flies it"
            raise CosimError("is the file of a campaign, no scenario", place=scenario, remedy=remedy) from None
        raise
    with named(scenario):
        return identified(parts.with_detectors(flown, detectors) if detectors else flown)


def _prepared(flown):
    """Return the scenario with its conditions resolved and its kernels compiled; tell what does not run."""
    from cosim.flight.detection.detectors import left_out
    from cosim.flight.faults.conditions import resolved
    from cosim.flight.loop.compiling import prepare

    with Compiling(err) as tell:
        prepare(flown, tell)
    flown = resolved(flown)
    notes([*flown.warnings(), *(f"{name} does not run: {why}" for name, why in left_out(flown).items())])
    return flown


def log_name(scenario: str, overrides: Any = ()) -> str:
    """Return the name of a run's log without its ending: the scenario's, and what was set, so that a variant gets a
    file of its own; a digest of what was set where that is long."""
    told = [re.sub(r"[^A-Za-z0-9._=-]+", "_", text.strip()).strip("_") for text in overrides]
    name = "+".join([Path(scenario).stem, *told])
    if len(name) <= LONGEST:
        return name
    return f"{Path(scenario).stem[:LONGEST]}+{hashlib.sha256(chr(0).join(overrides).encode()).hexdigest()[:8]}"


@command("Start", "list")
def list_(
    topic: Annotated[str | None, argument("TOPIC", f"{', '.join(inventory.TOPICS)} or all.")] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Show what there is to fly, to break, to read and to enable."""
    from cosim.campaign.inventory import inventory as everything

    if topic not in (None, "all", *inventory.TOPICS):
        raise CosimError("is no topic", place=f"cosim list {topic}", allowed=", ".join((*inventory.TOPICS, "all")),
                         remedy=did_you_mean(topic, inventory.TOPICS))  # fmt: skip
    found = everything()
    answer(json_, found if topic in (None, "all") else {topic: found[topic]}, lambda _: inventory.shown(found, topic))


@command("Start")
def info(
    log: Annotated[Path, argument("LOG", "A log written by [b]cosim run[/].")],
    scenario: Annotated[bool, flag("--scenario", "Print the log's scenario as TOML, ready to fly again.")] = False,
    output: Annotated[
        Path | None, output_option("DIR", "With --scenario: write it, and the sources attached, to fly there.")
    ] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Say what a log holds and whether it is complete."""
    from cosim.log.overview import log_info

    only_with("--scenario", scenario, output=output)
    if output:
        _write_sources(log, output)
    elif scenario and not json_:
        print(log_info(log)["scenario"], end="")
    else:
        answer(json_, log_info(log), flight.contents)


def _write_sources(log, folder):
    """Write the scenario of a log and what is attached to it; say what is not."""
    from cosim.log import open_log
    from cosim.replay import log_schema
    from cosim.scenario.user_parts import write

    found = open_log(log)
    missing = write(log_schema.scenario_tables(found), found.attachments, folder)
    notes(f"{key}: the log does not hold its file" for key in missing)
    path = folder / "scenario.toml"
    out.print(whole(f"wrote  {path}\nnext   cosim run {word(path)}"))


@command("Start")
def report(
    log: Annotated[Path, argument("LOG|DIR", "A log; a campaign's folder, or one of logs.")],
    output: Annotated[Path | None, output_option("HTML", "Default: beside the log.")] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Write one HTML page of a flight, a recording or a folder.

    It opens offline. Of a recording: what `cosim replay --map -o` made of it. Of a folder: its logs, compared.
    """
    path = output or (log / "compare.html" if log.is_dir() else log.with_suffix(".html"))
    from cosim.report.page import PAGE

    reserve(path, PAGE)
    if log.is_dir():
        from cosim.compare import compare as work
        from cosim.report import comparison_report

        with progress("reading", unit="logs") as tell:
            made = comparison_report(work([log], progress=tell), path)
    else:
        from cosim.log import open_log
        from cosim.report import diagnosis_report, flight_report

        foreign = "map.toml" in open_log(log, tolerant=True).attachments
        made = (diagnosis_report if foreign else flight_report)(log, path)
    answer(json_, {"report": str(made)}, lambda _: whole(f"report {made}"))


@command("Start")
def linearize(
    scenario: shared.ScenarioArg = DEFAULT,
    set_: shared.SetOption = None,
    output: Annotated[Path | None, output_option("FILE", "Write A, B, C, D to .npz or .mat.")] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Show trim and modes at a flight point; write A, B, C, D."""
    flown = loaded(scenario, set_ or ())
    from cosim.flight.plant.linearize import linearize as work
    from cosim.flight.plant.linearize import model_file
    from cosim.flight.plant.point import FlightPoint

    if output and output.suffix not in (".npz", ".mat"):
        raise CosimError("its ending says no known format", place=str(output), allowed=".npz, .mat")
    if output:
        reserve(output, model_file)
    with named(scenario):
        model = work(FlightPoint.of(flown))
    if output:
        model.save(output)
    found = {**model.to_dict(), **({"file": str(output)} if output else {})}
    answer(json_, found, lambda _: flight.trim_and_modes(found, flown))


for part in ("replay", "user_files", "campaigns"):  # the modules of the other commands
    importlib.import_module(f"cosim.cli.{part}")
