"""The command line: parses, prints, exits. The work is in functions that a notebook can call.

Exit status: 0 good (an alarm or a departed flight is a result), 1 a difference or a failed criterion, 2 bad input,
130 interrupted.
With --json one JSON object goes to standard output and nothing else; what goes wrong is one line on standard error.
"""

import contextlib
import itertools
import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer
from rich.console import Console
from typer.core import TyperGroup

from cosim.cli import aircraft as cli_aircraft
from cosim.cli import campaigns as cli_many
from cosim.cli import envelope as cli_envelope
from cosim.cli import false_alarms as cli_false_alarms
from cosim.cli import guests as cli_guests
from cosim.cli import score as cli_score
from cosim.cli import study as cli_study
from cosim.cli import tables
from cosim.cli.output import DetectorOption, JsonOption, log_name, named, reserve
from cosim.errors import CosimError, did_you_mean

TOLD = os.environ.get("COLUMNS", "").isdecimal() and int(os.environ["COLUMNS"]) > 0  # 0 would print nothing at all
if not TOLD:
    os.environ.pop("COLUMNS", None)
WIDE = None if sys.stdout.isatty() or TOLD else 110  # a pipe has no width: do not fold its tables


class _Whole(Console):
    """A console that cuts nothing off: a path or a command that is longer than the terminal stays whole."""

    def print(self, *objects, **how):
        super().print(*objects, **{"crop": False, **how})


out, err = _Whole(width=WIDE), _Whole(stderr=True)


_Usage = cast(type[Exception], typer.BadParameter.__mro__[2])  # of all that typer refuses; it exports no name for it


class _Group(TyperGroup):
    """Every error of a user becomes one line on standard error and exit status 2; Ctrl-C becomes 130."""

    def make_context(self, *args, **extra):
        try:
            return super().make_context(*args, **extra)
        except _Usage as error:
            if type(error).__name__ == "NoArgsIsHelpError":
                raise
            _say(_usage(error))
            raise typer.Exit(2) from None

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except _Usage as error:
            text = _usage(error)
        except CosimError as error:
            text = str(error)
        except BrokenPipeError:
            raise  # the reader of a pipe went away: click ends quietly
        except OSError as error:
            text = f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror or error)
            text = text if _somewhere() else "the current folder has been removed. Change to another one"
        except KeyboardInterrupt:
            err.print("[yellow]interrupted[/]")
            ctx.exit(130)
        _say(text)
        ctx.exit(2)


def _somewhere():
    """Tell whether there is a current folder: it may have been removed under the command."""
    try:
        return bool(os.getcwd())
    except OSError:
        return False


def _usage(error):
    """Return one line of what typer refuses: an unknown option, a value out of its range, an argument missing."""
    ctx = getattr(error, "ctx", None)
    path = ctx.command_path if ctx else "cosim"
    said = " ".join(error.format_message().split()).rstrip(".")
    stop = "" if said.endswith("?") else "."
    return f"{path}: {said.replace('Input should be', 'must be')}{stop} `{path} -h` says what there is"


def _say(text):
    err.print(f"[bold red]error:[/] {tables.escape(text)}", soft_wrap=True, highlight=False)


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ScenarioArg = Annotated[
    str, typer.Argument(metavar="[SCENARIO]", help="Built-in name (see [b]cosim list[/]) or TOML file.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", "-s", metavar="KEY=VALUE", help="Change a key: [b]--set faults.0.frequency_hz=3[/]. Repeatable."
    ),
]
SpeedOption = Annotated[
    float | None,
    typer.Option("--speed", metavar="N", min=0.01, max=1000.0, help="With --live: N times the clock's. Default: 1."),
]
PortOption = Annotated[
    int | None,
    typer.Option("--port", metavar="PORT", min=0, max=65535, help="With --live: default 8765, 0 takes a free one."),
]
DEFAULT = "liquid-ofc"
LIVE_PORT = 8765  # that Foxglove asks for by default


def _version(wanted: bool):
    if wanted:
        from importlib.metadata import version

        print(f"cosim {version('cosim-fdi')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
):
    """Fly a transport aircraft with physical elevator actuators, break something, and see which fault detector notices.

    Start with [b]cosim run[/]; [b]cosim list[/] shows what there is to fly.
    """


@app.command()
def run(
    scenario: ScenarioArg = DEFAULT,
    set_: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="LOG",
            help="Log file. Default: logs/<scenario>[+KEY=VALUE…].mcap.",
            show_default=False,
        ),
    ] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 when the flight departs.")] = False,
    report: Annotated[bool, typer.Option("--report", help="Write an HTML report beside the log.")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="Fly by the clock, for Foxglove to watch, inject and heal (README).")
    ] = False,
    speed: SpeedOption = None,
    port: PortOption = None,
    flightgear: Annotated[
        int | None,
        typer.Option("--flightgear", metavar="PORT", min=1, max=65535, help="With --live: show it in FlightGear, too."),
    ] = None,
    detector: DetectorOption = None,
    json_: JsonOption = False,
) -> Any:
    """Fly a scenario, log everything, and show who alarmed, when, and what it isolated."""
    from cosim.scenario import load_scenario

    _only_live(live, speed=speed, port=port, flightgear=flightgear)
    flown = load_scenario(scenario, set_ or ())
    if detector:
        from cosim.flight.guests import with_detectors

        flown = with_detectors(flown, detector)
    variant = [*(set_ or ()), *(f"detector={file.stem}" for file in detector or ())]
    path = output or Path("logs") / f"{log_name(scenario, variant)}.mcap"
    reserve(path, taken=scenario)
    overwritten = path.is_file()
    from cosim.flight.compiling import prepare
    from cosim.flight.conditions import resolved
    from cosim.flight.detectors import left_out
    from cosim.flight.simulate import simulate

    with named(scenario), tables.compiling(err) as tell:
        prepare(flown, tell)
    with named(scenario):
        flown = resolved(flown)
    _notes([*flown.warnings(), *(f"{name} does not run: {why}" for name, why in left_out(flown).items())])
    with named(scenario), tables.progress(err, f"flying {Path(scenario).stem}", waiting="preparing") as progress:
        if live:
            from cosim.flight.live import fly_live

            where = LIVE_PORT if port is None else port
            told: Any = {"progress": progress, "ready": _served}
            result, flown = fly_live(flown, log=path, port=where, speed=speed or 1.0, flightgear=flightgear, **told)
        else:
            result = simulate(flown, log=path, progress=progress, achieved=True)
    found = result.to_dict() | {"overwritten": overwritten}
    _notes(found.get("notes", ()))
    if report:
        from cosim.report import flight_report

        found["report"] = str(flight_report(path, path.with_suffix(".html")))
    if json_:
        print(json.dumps(found, allow_nan=False))
    else:
        out.print(tables.run(found, flown))
    if found["status"] == "interrupted":
        raise typer.Exit(130)
    if strict and found["status"] != "completed":
        raise typer.Exit(1)


def _served(server):
    """Say where Foxglove finds a flight."""
    err.print(f"in Foxglove: Open connection, {server.steer_url or server.url}", highlight=False, soft_wrap=True)
    if server.steer_url:
        err.print(f"to watch only: {server.url}", highlight=False, soft_wrap=True)


def _only_live(live, **options):
    for name, value in options.items():
        if value is not None and not live:
            raise CosimError("is for a flight by the clock", place=f"--{name}", remedy="Add --live")


def _notes(lines):
    for line in lines:
        err.print(f"[yellow]note:[/] {tables.escape(line)}", soft_wrap=True, highlight=False)


@app.command(name="list")
def list_(
    topic: Annotated[
        str | None, typer.Argument(metavar="[TOPIC]", help=f"{', '.join(tables.TOPICS)} or all.", show_default=False)
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Show what there is: scenarios, campaigns, manoeuvres, faults, detectors, signals, tolerances, keys, examples."""
    from cosim.campaign.inventory import inventory

    if topic not in (None, "all", *tables.TOPICS):
        raise CosimError(
            "is no topic",
            place=f"cosim list {topic}",
            allowed=", ".join((*tables.TOPICS, "all")),
            remedy=did_you_mean(topic, tables.TOPICS),
        )
    found = inventory()
    if json_:
        print(json.dumps(found if topic in (None, "all") else {topic: found[topic]}))
    else:
        out.print(tables.inventory(found, topic))


@app.command()
def example(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Default: list them.", show_default=False)
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Default: NAME.py here.", show_default=False)
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Copy an example program into your folder, ready to run and to change."""
    from cosim.campaign.inventory import example as source
    from cosim.files import replace_text

    if name is None:
        return list_("examples", json_)
    text, path = source(name), output or Path(f"{name}.py")
    if path.exists() and output is None:
        raise CosimError("is there already", place=str(path), remedy="Name another file with -o")
    reserve(path)
    replace_text(path, text)
    if json_:
        print(json.dumps({"example": name, "file": str(path)}))
    else:
        out.print(tables.whole(f"wrote  {path}\nnext   python {path}"))


@app.command()
def info(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log written by [b]cosim run[/].", show_default=False)],
    scenario: Annotated[
        bool, typer.Option("--scenario", help="Print the log's scenario as TOML, ready to fly again.")
    ] = False,
    json_: JsonOption = False,
) -> None:
    """Say what a log holds and whether it is complete."""
    from cosim.log.info import log_info

    found = log_info(log)
    if json_:
        print(json.dumps(found, allow_nan=False))
    elif scenario:
        print(found["scenario"], end="")
    else:
        out.print(tables.info(found))


@app.command()
def linearize(
    scenario: ScenarioArg = DEFAULT,
    set_: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write A, B, C, D to .npz or .mat.", show_default=False),
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Trim at a scenario's flight point and show the modes of the bare airframe; write A, B, C, D."""
    from cosim.scenario import load_scenario

    flown = load_scenario(scenario, set_ or ())
    if output:
        reserve(output, taken=scenario, endings=(".npz", ".mat"))
    from cosim.flight.plant.linearize import linearize as work
    from cosim.flight.plant.point import FlightPoint

    with named(scenario):
        model = work(FlightPoint.of(flown))
    if output:
        model.save(output)
    found = {**model.to_dict(), **({"file": str(output)} if output else {})}
    if json_:
        print(json.dumps(found, allow_nan=False))
    else:
        out.print(tables.linear(found, flown))


@app.command()
def bench(
    rounds: Annotated[int, typer.Option("--rounds", min=3, help="Rounds of interleaved timing.")] = 15,
    memory: Annotated[bool, typer.Option("--memory/--no-memory", help="Fly ten minutes for the peak memory.")] = True,
    campaign: Annotated[
        str | None,
        typer.Option("--campaign", metavar="NAME", help="Instead fly a campaign, twice.", show_default=False),
    ] = None,
    beside: Annotated[
        Path | None,
        typer.Option("--compare", metavar="FILE", help="Beside what --json wrote to FILE.", show_default=False),
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Measure what a tick costs, how fast a run starts and how much memory it takes."""
    from cosim.bench import bench as work
    from cosim.cli.bench import compared, read_bench

    if campaign is not None:
        from cosim.bench.campaign import compare

        with tables.progress(err, campaign, "flights", "preparing the workers") as progress:
            done = compare(campaign, progress=progress)
        print(json.dumps(done)) if json_ else out.print(tables.campaign_speed(done))
        raise typer.Exit(0 if done["equal"] and not done["crashed"] else 1)
    before = read_bench(beside) if beside else None
    with tables.progress(err, "measuring", unit="") as progress:
        found = work(rounds=rounds, memory=memory, progress=progress)
    if json_:
        print(json.dumps(found, allow_nan=False))
    else:
        out.print(compared(before, found) if before else tables.bench(found))


LogArg = Annotated[Path, typer.Argument(metavar="LOG", help="A log of [b]cosim run[/].", show_default=False)]


@app.command()
def replay(
    log: LogArg,
    detectors: Annotated[
        str | None, typer.Option("--detectors", metavar="A,B", help="Only these detectors.", show_default=False)
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set", "-s", metavar="DETECTOR.PARAMETER=VALUE", help="What if: change a parameter. Repeatable."
        ),
    ] = None,
    start: Annotated[
        float, typer.Option("--from", metavar="T", min=0.0, help="Start in the middle, at T seconds.")
    ] = 0.0,
    map_: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP.toml", help="Diagnose a foreign CSV, Parquet or MCAP by this map (README)."),
    ] = None,
    on_reset: Annotated[
        Literal["split", "offset"] | None,
        typer.Option("--on-reset", help="With --map: where the clock goes back, stretches apart or joined."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="LOG", help="Write old and new outputs to a log.", show_default=False),
    ] = None,
    live: Annotated[
        bool, typer.Option("--live", help="Run nothing: show the log in Foxglove, played and scrubbed (README).")
    ] = False,
    speed: SpeedOption = None,
    port: PortOption = None,
    detector: DetectorOption = None,
    json_: JsonOption = False,
) -> None:
    """Run the detectors of a log again and compare bit for bit. Exit status 0: exact, 1: different.

    A detector of your own that was not part of the flight is run on it as it was logged.
    """
    from cosim.cli import replay as cli_replay

    _only_live(live, speed=speed, port=port)
    if live:
        from cosim.replay.live import show

        where = LIVE_PORT if port is None else port
        with contextlib.suppress(KeyboardInterrupt):  # that is how it ends
            show(log, port=where, speed=speed or 1.0, start_s=start, ready=_served)
        return
    chosen = [name.strip() for name in detectors.split(",") if name.strip()] if detectors is not None else None
    if output:
        reserve(output, taken=log, what="the log")
    from cosim.replay.params import overrides

    if map_:
        from cosim.replay.map import diagnose

        how = {"detectors": chosen, "overrides": overrides(set_ or ()), "start_s": start, "on_reset": on_reset}
        how["guests"] = detector or ()
        stretches = []
        for part in itertools.count():
            path = output.with_stem(f"{output.stem}-{part + 1}") if output and part else output
            try:
                stretches.append(diagnose(log, map_, output=path, part=part, **how).to_dict())
            except IndexError:
                break
            if on_reset != "split":
                break
        if json_:
            print(json.dumps(stretches[0] if len(stretches) == 1 else {"stretches": stretches}, allow_nan=False))
        else:
            for told in stretches:
                out.print(cli_replay.diagnosis(told))
        return
    from cosim.replay import replay as work

    with tables.progress(err, "replaying") as progress:
        found = work(
            log,
            detectors=chosen,
            overrides=overrides(set_ or ()),
            start_s=start,
            output=output,
            progress=progress,
            guests=detector or (),
        )
    _notes(found.notes)
    if json_:
        print(json.dumps(found.to_dict(), allow_nan=False))
    else:
        out.print(cli_replay.replay(found.to_dict(), detection=chosen is not None or bool(set_ or detector)))
    raise typer.Exit(0 if found.exact or (detector and not found.values) else 1)


@app.command()
def recover(
    log: LogArg,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="LOG", help="Default: LOG with .recovered before its ending.", show_default=False
        ),
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Make a readable log of what a kill, a full disk or a damaged disk has left of one, and say what is lost."""
    from cosim.cli import replay as cli_replay
    from cosim.log import recover as work

    path = output or log.with_suffix(f".recovered{log.suffix}")
    reserve(path, taken=log, what="the log")
    found = work(log, path)
    if json_:
        print(json.dumps(found, allow_nan=False))
    else:
        out.print(cli_replay.recover(found))


for part in (cli_envelope, cli_study, cli_many, cli_score, cli_false_alarms, cli_guests, cli_aircraft):
    part.add(app, out, err)


def main() -> Any:
    """Run the command line."""
    app(prog_name="cosim")


if __name__ == "__main__":
    sys.exit(main())
