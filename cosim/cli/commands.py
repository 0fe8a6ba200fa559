"""The commands, each parses, prints, exits. The work is in functions that a notebook can call."""

import importlib
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Group
from rich.text import Text

from cosim.cli import flight, inventory, tables
from cosim.cli import output as shared
from cosim.cli.app import LAYOUT, LIVE_PORT, answer, app, err, notes, only_with, out, served
from cosim.cli.output import argument, flag, loaded, log_name, named, option, output_option, reserve
from cosim.errors import CosimError, did_you_mean
from cosim.progress import Compiling
from cosim.table import Cell, Column, Table

if TYPE_CHECKING:  # `--help` needs no scenario
    from cosim.scenario import Scenario

DEFAULT = "liquid-ofc"
ARRAYS = (".npy", ".npz")
# as `cosim -h` shows them: a flight, many flights, what is your own, what stands behind the detectors
ORDER = (
    "run list example info report replay recover campaign compare "
    "new check map linearize reproduce"
).split()


@app.command()
def run(
    scenario: shared.ScenarioArg = DEFAULT,
    set_: shared.SetOption = None,
    output: Annotated[
        Path | None,
        output_option(
            "LOG",
            "Default: logs/SCENARIO.mcap, of a variant logs/SCENARIO+KEY=VALUE.mcap, with a digest where that is long.",
        ),
    ] = None,
    overwrite: shared.OverwriteOption = False,
    strict: Annotated[bool, flag("--strict", "Exit with 1 when the flight departs.")] = False,
    report: Annotated[bool, flag("--report", "Write an HTML report beside the log.")] = False,
    live: Annotated[
        bool, flag("--live", "Fly by the clock: watch, inject and heal in Foxglove (layout beside the log).")
    ] = False,
    speed: shared.SpeedOption = None,
    port: shared.PortOption = None,
    flightgear: Annotated[
        int | None, option("PORT", "With --live: show it in FlightGear, too.", min=1, max=65535)
    ] = None,
    detector: shared.DetectorOption = None,
    json_: shared.JsonOption = False,
) -> Any:
    """Fly a scenario, log it, show who alarmed, when, and for what."""
    from cosim.scenario.user_parts import identified

    only_with("--live", live, speed=speed, port=port, flightgear=flightgear)
    flown = loaded(scenario, set_ or ())
    if detector:
        from cosim.parts import with_detectors

        flown = with_detectors(flown, detector)
    with named(scenario):
        flown = identified(flown)
    variant = [*(set_ or ()), *(f"detector={file.stem}" for file in detector or ())]
    path = output or Path("logs") / f"{log_name(scenario, variant)}.mcap"
    from cosim.log.format import OURS

    taken = {"the scenario": [scenario], "a detector": detector or ()}
    reserve(path, OURS, taken=taken, log=True)
    page = path.with_suffix(".html")
    if report:
        from cosim.report.page import PAGE

        reserve(page, PAGE, taken=taken)
    layout = path.with_suffix(".foxglove.json")
    if live:
        reserve(layout, LAYOUT, taken=taken)
    overwritten = path.is_file()
    from cosim.flight.detection.detectors import left_out
    from cosim.flight.faults.conditions import resolved
    from cosim.flight.loop.compiling import prepare
    from cosim.flight.simulate import simulate

    with named(scenario), Compiling(err) as tell:
        prepare(flown, tell)
    with named(scenario):
        flown = resolved(flown)
    notes([*flown.warnings(), *(f"{name} does not run: {why}" for name, why in left_out(flown).items())])
    with named(scenario), tables.progress(err, f"flying {Path(scenario).stem}", waiting="preparing") as progress:
        if live:
            from cosim.flight.interactive.live import fly_live

            where = LIVE_PORT if port is None else port
            told: Any = {"progress": progress, "ready": lambda server: served(server, layout)}
            result, flown = fly_live(flown, log=path, port=where, speed=speed or 1.0, flightgear=flightgear, **told)
        else:
            result = simulate(flown, log=path, progress=progress, achieved=True)
    found = result.to_dict() | {"overwritten": overwritten}
    notes(found.get("notes", ()))
    if report:
        from cosim.report import flight_report

        found["report"] = str(flight_report(found["log"], page))
    answer(json_, found, lambda _: flight.shown(found, flown))
    if found["status"] == "interrupted":
        raise typer.Exit(130)
    if strict and found["status"] != "completed":
        raise typer.Exit(1)


@app.command(name="list")
def list_(
    topic: Annotated[str | None, argument("TOPIC", f"{', '.join(inventory.TOPICS)} or all.")] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Show what there is to fly, to break, to read and to enable."""
    from cosim.campaign.inventory import inventory as everything

    if topic not in (None, "all", *inventory.TOPICS):
        raise CosimError(
            "is no topic",
            place=f"cosim list {topic}",
            allowed=", ".join((*inventory.TOPICS, "all")),
            remedy=did_you_mean(topic, inventory.TOPICS),
        )
    found = everything()
    answer(json_, found if topic in (None, "all") else {topic: found[topic]}, lambda _: inventory.shown(found, topic))


@app.command()
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

    if output:
        _write_sources(log, scenario, output)
        return
    found = log_info(log)
    if json_:
        print(json.dumps(found, allow_nan=False))
    elif scenario:
        print(found["scenario"], end="")
    else:
        out.print(contents(found))


def _write_sources(log, scenario, folder):
    """Write the scenario of a log and what is attached to it; say what is not."""
    from cosim.log import open_log
    from cosim.replay import log_schema
    from cosim.scenario.user_parts import write

    if not scenario:
        raise CosimError("writes the scenario", place=f"-o {folder}", remedy="Add --scenario")
    found = open_log(log)
    missing = write(log_schema.scenario_tables(found), found.attachments, folder)
    notes(f"{key}: the log does not hold its file" for key in missing)
    path = folder / "scenario.toml"
    out.print(tables.whole(f"wrote  {path}\nnext   cosim run {tables.word(path)}"))


@app.command()
def linearize(
    scenario: shared.ScenarioArg = DEFAULT,
    set_: shared.SetOption = None,
    output: Annotated[Path | None, output_option("FILE", "Write A, B, C, D to .npz or .mat.")] = None,
    overwrite: shared.OverwriteOption = False,
    json_: shared.JsonOption = False,
) -> None:
    """Show trim and modes at a flight point; write A, B, C, D."""

    flown = loaded(scenario, set_ or ())
    from cosim.flight.plant.linearize import linearize as work
    from cosim.flight.plant.linearize import model_file
    from cosim.flight.plant.point import FlightPoint

    if output:
        reserve(output, model_file, taken={"the scenario": [scenario]}, endings=(".npz", ".mat"))
    with named(scenario):
        model = work(FlightPoint.of(flown))
    if output:
        model.save(output)
    found = {**model.to_dict(), **({"file": str(output)} if output else {})}
    answer(json_, found, lambda _: trim_and_modes(found, flown))


# the modules of the other commands
PARTS = ("replay", "campaigns", "user_files", "study")
for part in PARTS:
    importlib.import_module(f"cosim.cli.{part}")
names = {str(c.name or getattr(c.callback, "__name__", "")).replace("_", "-"): c for c in app.registered_commands}
app.registered_commands[:] = [names[name] for name in sorted(names, key=ORDER.index)]


def main() -> Any:
    """Run the command line."""
    app(prog_name="cosim")


if __name__ == "__main__":
    sys.exit(main())


def contents(found: dict[str, Any]) -> Group:
    """Return the tables of `cosim info`."""
    state = Cell("complete", "good") if found["complete"] else Cell("incomplete: the run did not end by itself", "warn")
    head = Table(found["log"], "", "", heads=False)
    for name in ("title", "status", "duration_s", "rate_hz", "ticks", "size_mb"):
        if found.get(name) not in (None, ""):
            head.add(name, str(found[name]))
    head.add("log", state)
    for name in ("gaps", "problem"):
        if found.get(name):
            head.add(name, f"{found[name]} ticks are missing" if name == "gaps" else found[name])
    for name, value in found["versions"].items():
        head.add(name, value)
    for name, why in json.loads(found["result"].get("not_run", "{}")).items():
        head.add(f"{name} not run", why)
    t = Table("Topics", "topic", "rows>", "fields>", "every>", Column("first fields", rank=1, right=False))
    for r in found["topics"]:
        more = ", ..." if len(r["fields"]) > 6 else ""
        t.add(r["name"], r["rows"], len(r["fields"]), r["every"], ", ".join(r["fields"][:6]) + more)
    kept = [name for name in found["attachments"] if not name.endswith(ARRAYS)]
    arrays = len(found["attachments"]) - len(kept)
    kept += [f"{arrays} arrays of parameters and initial states"] if arrays else []
    return Group(head, t, Text(f"attachments: {', '.join(kept) or 'none'}"))


def trim_and_modes(found: dict[str, Any], scenario: "Scenario") -> Group:
    """Return trim and modes of `cosim linearize`."""
    from cosim.judge.narrator import point

    trim = found["trim"]
    t = Table("Trim", "", ">", "", heads=False)
    for name, unit in (("alpha_deg", "deg"), ("stabilizer_deg", "deg"), ("throttle", ""), ("residual", "m/s², rad/s²")):
        t.add(name.removesuffix("_deg"), f"{trim[name]:.3g}" if name == "residual" else f"{trim[name]:.4f}", unit)
    heads = ("wn, rad/s>", "damping>", "period or tau, s>", "eigenvalue, 1/s>")
    m = Table("Modes of the bare airframe, height and heading held; height free: the phugoid of A", "mode", *heads)
    for r in (*found["modes"], found["phugoid_height_free"]):
        real, imag = r["eigenvalue"]
        swings = abs(imag) > 1e-9
        time = 2 * math.pi / abs(imag) if swings else 1 / abs(real)
        value = f"{real:.4f}" + (f" ± {abs(imag):.4f}i" if swings else "")
        m.add(r["name"].replace("_", " "), f"{r['wn_rad_s']:.4f}", f"{r['zeta']:.3f}", f"{time:.2f}", value)
    size = f"{len(found['states'])} states, {len(found['inputs'])} inputs, {len(found['outputs'])} outputs"
    where = f"\nA, B, C, D in {found['file']}" if "file" in found else "; write A, B, C, D with -o model.npz or .mat"
    return Group(Text(point(scenario)), t, m, Text(size + where))
