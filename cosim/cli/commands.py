"""The commands. Each parses, prints, exits; the work is in functions that a notebook can call, and imported where it
is needed: the help needs none of it."""

import contextlib
import hashlib
import math
import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Exit, Option

import cosim
from cosim.cli import app as shared
from cosim.cli import tables
from cosim.cli.app import answer, app, command, err, named, notes, only_with, out, output_option, reserve, whole, word
from cosim.errors import CosimError, did_you_mean
from cosim.files import LEFT, LOG, PAGE, columns, left_by, marked, replace, replace_text
from cosim.progress import Compiling, Progress
from cosim.table import Cell, Row, Table

__all__ = ["app"]
DEFAULT = "liquid-ofc"
LONGEST = 100  # characters of the name of a log; a file system takes 255 with what follows them
LIVE_PORT = 8765  # that Foxglove asks for by default
LAYOUT = marked(b"{", b'"content"', b'"type": "tabs"')  # the sign of our layouts
MARKS = {"good": Cell("✓", "good"), "bad": Cell("✗", "bad"), "note": Cell("!", "warn")}


@command("Start")
def run(
    scenario: shared.Scenario = DEFAULT,
    set_: shared.Set = None,
    output: Annotated[Path | None, output_option("LOG", "Default: logs/SCENARIO+KEY=VALUE.mcap.")] = None,
    strict: Annotated[bool, Option("--strict", help="Exit with 1 when the flight departs.")] = False,
    report: Annotated[bool, Option("--report", help="Write an HTML report beside the log.")] = False,
    details: Annotated[
        bool, Option("--details", help="Show every detector and column, and what the aircraft did.")
    ] = False,
    live: Annotated[
        bool, Option("--live", help="Fly by the clock: watch, inject and heal in Foxglove (layout beside the log).")
    ] = False,
    speed: shared.Speed = None,
    port: shared.Port = None,
    detector: shared.Detector = None,
    json_: shared.Json = False,
) -> None:
    """Fly a scenario, log it, show who alarmed, when, and for what."""
    only_with("--live", live, speed=speed, port=port)
    flown = loaded(scenario, set_ or (), detector or ())
    variant = [*(set_ or ()), *(f"detector={file.stem}" for file in detector or ())]
    path = output or Path("logs") / f"{log_name(scenario, variant)}.mcap"
    reserve(path, LOG, log=True, endings=(".mcap",))
    page, layout = path.with_suffix(".html"), path.with_suffix(".foxglove.json")
    reserve(page if report else None, PAGE)
    reserve(layout if live else None, LAYOUT)
    overwritten = path.is_file()
    with named(scenario):
        flown = _prepared(flown)
        with Progress(f"flying {Path(scenario).stem}", "s", waiting="preparing", console=err) as tell:
            if live:
                from cosim.flight.interactive.live import fly_live

                result, flown = fly_live(
                    flown, log=path, port=LIVE_PORT if port is None else port, speed=speed or 1.0, progress=tell,
                    ready=lambda server: served(server, layout),
                )  # fmt: skip
            else:
                result = cosim.simulate(flown, log=path, progress=tell, achieved=True)
    found = result.to_dict() | {"overwritten": overwritten}
    notes(found.get("notes", ()))
    if report:
        from cosim.report import flight_report

        found["report"] = str(flight_report(found["log"], page))
    answer(json_, found, lambda _: tables.run(found, flown, details))
    cut = found["status"] == "interrupted"
    raise Exit(shared.INTERRUPTED if cut else int(strict and found["status"] != "completed"))


def loaded(scenario: str, overrides: Any, detectors: Any = ()) -> Any:
    """Return the Scenario of a command; of a campaign's file say which command flies it. Raises CosimError."""
    from cosim import parts
    from cosim.scenario.user_parts import identified
    from cosim.texts import read, toml

    parts.loaded(detectors)  # the scenario may set their parameters
    try:
        flown = cosim.load_scenario(scenario, overrides)
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
    digest = hashlib.sha256("\0".join(overrides).encode("utf-8", "surrogateescape")).hexdigest()
    return f"{Path(scenario).stem[:LONGEST]}+{digest[:8]}"


def served(server: Any, layout: Path | None = None) -> None:
    """Say where Foxglove finds a flight, and write its `layout` for that flight."""
    told = [f"in Foxglove: Open connection, {server.url}"]
    if layout:
        replace_text(layout, server.layout.decode(), LAYOUT)
        told.insert(0, f"layout {layout}: in Foxglove, Import from file")
    err.print(whole("\n".join(told)), highlight=False)


@command("Start", "list")
def list_(
    topic: Annotated[str | None, Argument(metavar="TOPIC", help=f"{', '.join(tables.TOPICS)} or all.")] = None,
    json_: shared.Json = False,
) -> None:
    """Show what there is to fly, to break, to read and to enable."""
    from cosim.campaign.inventory import inventory

    if topic not in (None, "all", *tables.TOPICS):
        raise CosimError("is no topic", place=f"cosim list {topic}", allowed=", ".join((*tables.TOPICS, "all")),
                         remedy=did_you_mean(topic, tables.TOPICS))  # fmt: skip
    found = inventory()
    answer(json_, found if topic in (None, "all") else {topic: found[topic]}, lambda _: tables.inventory(found, topic))


@command("Start")
def info(
    log: shared.Log,
    scenario: Annotated[
        bool, Option("--scenario", help="Print the log's scenario as TOML, ready to fly again.")
    ] = False,
    output: Annotated[
        Path | None, output_option("DIR", "With --scenario: write it, and the sources attached, to fly there.")
    ] = None,
    json_: shared.Json = False,
) -> None:
    """Say what a log holds and whether it is complete."""
    from cosim.log import log_info

    only_with("--scenario", scenario, output=output)
    if output:
        _write_sources(log, output)
    elif scenario and not json_:
        print(log_info(log)["scenario"], end="")
    else:
        answer(json_, log_info(log), tables.log)


def _write_sources(log, folder):
    """Write the scenario of a log and what is attached to it; say what is not."""
    from cosim.replay import log_schema
    from cosim.scenario.user_parts import write

    found = cosim.open_log(log)
    missing = write(log_schema.scenario_tables(found), found.attachments, folder)
    notes(f"{key}: the log does not hold its file" for key in missing)
    path = folder / "scenario.toml"
    out.print(whole(f"wrote  {path}\nnext   cosim run {word(path)}"))


@command("Start")
def report(
    log: Annotated[Path, Argument(metavar="LOG|DIR", help="A log; a campaign's folder, or one of logs.")],
    output: Annotated[Path | None, output_option("HTML", "Default: beside the log.")] = None,
    json_: shared.Json = False,
) -> None:
    """Write one HTML page of a flight, a recording or a folder.

    It opens offline. Of a recording: what `cosim replay --map -o` made of it. Of a folder: its logs, compared.
    """
    path = output or (log / "compare.html" if log.is_dir() else log.with_suffix(".html"))
    reserve(path, PAGE, endings=(".html",))
    from cosim import report as pages  # each brings what it needs: that of a flight neither pandas nor SciPy

    if log.is_dir():
        from cosim.compare import compare

        with Progress("reading", "logs", console=err) as tell:
            made = pages.comparison_report(compare([log], progress=tell), path)
    else:
        foreign = "map.toml" in cosim.open_log(log, tolerant=True).attachments
        made = (pages.diagnosis_report if foreign else pages.flight_report)(log, path)
    answer(json_, {"report": str(made)}, lambda _: whole(f"report {made}"))


@command("Start")
def replay(
    log: shared.Log,
    detectors: Annotated[str | None, Option(metavar="A,B", help="Only these detectors.")] = None,
    set_: Annotated[
        list[str] | None,
        Option("--set", "-s", metavar="DETECTOR.PARAMETER=VALUE", help="What if: change a parameter. Repeatable."),
    ] = None,
    start: Annotated[float, Option("--from", metavar="T", help="Start in the middle, at T seconds.", min=0.0)] = 0.0,
    map_: Annotated[
        Path | None, Option("--map", metavar="MAP.toml", help="Diagnose a recording by this map of [b]cosim map[/].")
    ] = None,
    output: Annotated[Path | None, output_option("LOG", "Write old and new outputs to a log.")] = None,
    live: Annotated[bool, Option("--live", help="Run nothing: play and scrub the log in Foxglove.")] = False,
    speed: shared.Speed = None,
    port: shared.Port = None,
    detector: shared.Detector = None,
    json_: shared.Json = False,
) -> None:
    """Run the detectors of a log again and compare bit for bit.

    Exit status 0: exact, 1: different. A detector of your own that was not part of the flight is run on it as it was
    logged.
    """
    only_with("--live", live, speed=speed, port=port)
    if live:
        from cosim.replay.live import show

        with contextlib.suppress(KeyboardInterrupt):  # that is how it ends
            show(log, port=LIVE_PORT if port is None else port, speed=speed or 1.0, start_s=start, ready=served)
        return
    from cosim.replay import replay as work
    from cosim.replay.log_schema import overrides

    reserve(output, LOG, log=True, source=log, endings=(".mcap",))
    overwritten = {"overwritten": output is not None and output.is_file()}
    chosen = [name.strip() for name in detectors.split(",") if name.strip()] if detectors is not None else None
    how: dict[str, Any] = {"detectors": chosen, "overrides": overrides(set_ or ()), "start_s": start,
                           "user_detectors": detector or (), "output": output}  # fmt: skip
    if map_:
        from cosim.replay.map import diagnose

        return answer(json_, diagnose(log, map_, **how).to_dict() | overwritten, tables.recording)
    with Progress("replaying", "s", console=err) as tell:
        made = work(log, progress=tell, **how)
    notes(made.notes)
    detection = chosen is not None or bool(set_ or detector)
    answer(json_, made.to_dict() | overwritten, lambda found: tables.replay(found, detection))
    raise Exit(0 if made.exact or (detector and not made.values) else 1)


@command("Start")
def recover(
    log: shared.Log,
    output: Annotated[
        Path | None, output_option("LOG", "Default: LOG, or LOG with .recovered before its ending if there is one.")
    ] = None,
    json_: shared.Json = False,
) -> None:
    """Make a readable log of what a kill or a full disk left."""
    from cosim.log import recover as work

    asked, log = log, Path(str(log).removesuffix(LEFT))
    part, changed = left_by(log), Path(f"{log}.flown.toml")
    source = part if part.is_file() else asked
    if not source.exists() and changed.is_file():
        remedy = f"`cosim run {changed} -o {log}` flies it again"
        raise CosimError("the flight was killed before it wrote its log", place=str(log), remedy=remedy)
    path = output or (log.parent / f"{log.stem}.recovered{log.suffix}" if log.exists() else log)
    reserve(path, LOG, source=log, endings=(".mcap",) * (output is not None))
    found = work(source, path)
    if source == part and found["cut"]:  # all but its open end is in the new log
        part.unlink()
    answer(json_, found, tables.recovered)


@command("Start")
def linearize(
    scenario: shared.Scenario = DEFAULT,
    set_: shared.Set = None,
    output: Annotated[Path | None, output_option("FILE", "Write A, B, C, D to .npz or .mat.")] = None,
    json_: shared.Json = False,
) -> None:
    """Show trim and modes at a flight point; write A, B, C, D."""
    flown = loaded(scenario, set_ or ())
    from cosim.flight.plant.linearize import model_file
    from cosim.flight.plant.point import FlightPoint

    reserve(output, model_file, endings=(".npz", ".mat"))
    with named(scenario):
        model = cosim.linearize(FlightPoint.of(flown))
    if output:
        model.save(output)
    found = {**model.to_dict(), **({"file": str(output)} if output else {})}
    answer(json_, found, lambda _: tables.model(found, flown))


def edited(path: Path) -> bool:
    """Tell of no file that it is the project's: what was drafted is there to be edited."""
    return False


@command("Yours")
def new(
    what: Annotated[str, Argument(metavar="KIND", help="detector, law, actuator, aircraft, campaign or example.")],
    name: Annotated[str, Argument(metavar="NAME", help="Lower-case letters, digits and _; of an example its name.")],
    numbers: Annotated[
        Path | None, Option(metavar="FILE", help="Of an aircraft: numbers.toml; writes its JSBSim files.")
    ] = None,
    output: Annotated[Path, output_option("DIR", "Folder of the files.")] = Path("."),
    json_: shared.Json = False,
) -> None:
    """Write a detector, law, actuator, aircraft, campaign or example.

    It runs as it is, and so does its test: test_NAME.py. An aircraft is first a template of its numbers to fill in.
    """
    only_with("aircraft", what == "aircraft", numbers=numbers)
    from cosim.campaign.inventory import example
    from cosim.flight.new import KINDS, texts

    made = {f"{name}.py": example(name)} if what == "example" else texts(name, what, numbers)
    written = {output / file: text for file, text in made.items()}
    # of an aircraft the two files that its numbers come from stay as they are
    missing = {path: text for path, text in written.items()
               if not (numbers and path.is_file() and path.read_text("utf-8") == text)}  # fmt: skip
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


@command("Yours")
def check(
    what: Annotated[str, Argument(metavar="FILE.py|NAME|DIR", help="A detector, a law; an aircraft.")],
    json_: shared.Json = False,
) -> None:
    """Say whether a detector, law or aircraft keeps its contract.

    A detector: runs, deterministic, causal, live as in replay, lost samples. A law: runs, deterministic, lost samples.
    An aircraft: what is missing, signs, trim, hinge moments, effectors. Exit status 1: it does not.
    """
    from cosim.flight.check import check as checked

    with Progress("checking", console=err) as tell:
        found = checked(what, progress=tell)
    told = [Row((MARKS[line["result"]], line["question"], line["answer"])) for line in found["checks"]]
    answer(json_, found, lambda _: Table(what, "", "question", "answer", rows=told))
    raise Exit(0 if found["keeps"] else 1)


@command("Yours", "map")
def map_(
    recording: Annotated[Path, Argument(metavar="FILE", help="A table (text, Parquet) or an MCAP file.")],
    aircraft: Annotated[str | None, Option(metavar="NAME", help="Whose detectors judge.")] = None,
    output: Annotated[Path | None, output_option("MAP.toml", "Default: print it.")] = None,
    json_: shared.Json = False,
) -> None:
    """Draft a map of a recording: which column is which signal.

    By the columns' names: what they do not say, a unit or a sign, stands as a comment and does not fly.
    """
    from cosim.replay.map_draft import NONE, draft

    reserve(output, edited, endings=(".toml",))
    text = draft(recording, aircraft=aircraft)
    if output:
        replace_text(output, text, edited)
    if not (output or json_):
        return print(text, end="")  # for a file, too: no line of it may be folded
    flies = "edit it: no signal flies yet" if NONE in text else f"cosim replay {word(recording)} --map {word(output)}"
    told = f"wrote  {output}\nnext   {flies}"
    answer(json_, {"map": str(output) if output else None, "toml": text}, lambda _: whole(told))


@command("Many flights")
def campaign(
    campaign: Annotated[str, Argument(metavar="CAMPAIGN", help="Built-in name or file.")],
    workers: Annotated[int | None, Option(metavar="N", help="Processes. Default: one per core.", min=1)] = None,
    scheduler: Annotated[str | None, Option(metavar="ADDRESS", help="Fly on a Dask cluster: tcp://host:8786.")] = None,
    resume: Annotated[bool, Option("--resume", help="Go on in this folder; failed runs fly again.")] = False,
    output: Annotated[Path | None, output_option("DIR", "Default: logs/<campaign>.")] = None,
    signals: Annotated[
        list[str] | None,
        Option(metavar="WORD",
               help="Write this signal of every flight, with labels: `cosim list signals`, or all. Repeatable."),
    ] = None,
    rate: Annotated[float | None, Option(metavar="HZ", help="With --signals: samples a second. Default: 50.")] = None,
    again: Annotated[
        str | None, Option("--rerun", metavar="ID", help="Fly one run again, with a log, and compare its row.")
    ] = None,
    detector: shared.Detector = None,
    json_: shared.Json = False,
) -> None:  # fmt: skip
    """Fly grids and draws of scenarios, a row per flight.

    Exit status 1: a run ended in an error, or none could be flown.
    """
    from cosim.campaign.engine import run_campaign

    only_with("--signals", signals, rate=rate)
    if again:
        _rerun(campaign, again, json_, out=output, user_detectors=detector or ())
    with Progress(f"flying {Path(campaign).stem}", "runs", waiting="preparing the workers", console=err) as tell:
        done = run_campaign(
            campaign, workers=workers, scheduler=scheduler, out=output, resume=resume, progress=tell,
            user_detectors=detector or (), signals=signals and [w for w in signals if w != "all"], rate_hz=rate or 50.0,
        )  # fmt: skip
    failed = errors(done.frame)
    notes(dropped(done.frame))
    answer(json_, {**done.to_dict(), "errors": failed}, lambda _: tables.campaign(done, failed))
    raise Exit(int(done.failed == done.done or any(r["status"] != "infeasible" for r in failed)))


def _rerun(campaign, run, json_, **how):
    """Fly one run again, print it and whether its row repeats, and exit."""
    from cosim.campaign.engine import rerun

    flown, result, repeats, same_code = rerun(campaign, run, **how)
    found = {**result.to_dict(), "run": run, "repeats": repeats, "same_code": same_code}
    answer(json_, found, lambda _: tables.run(found, flown))
    if repeats is not None and not json_:
        other = "" if same_code else ": the campaign was flown with other code, designs or libraries"
        out.print("its row repeats exactly" if repeats else f"[bold red]its row does not repeat[/]{other}")
    raise Exit(1 if repeats is False else 0)


def errors(frame: Any) -> list[dict]:
    """Return [{status, error, runs}] of the runs without a flight, the most frequent first."""
    from cosim.campaign.worker import FAILED

    runs = frame.drop_duplicates("run")
    counts = runs[runs["status"].isin(FAILED)].value_counts(["status", "error"])
    return [{"status": status, "error": text, "runs": int(n)} for (status, text), n in counts.items()]


def dropped(frame: Any) -> list[str]:
    """Return a sentence for each user detector that was dropped in some runs: in how many, and the first time why."""
    runs = frame.drop_duplicates("run")
    said = runs.set_index("run")["error"].fillna("").str.split(r"; (?=\w+ is dropped on )", regex=True).explode()
    said = said[said.str.contains(" is dropped on ")]
    each = said.groupby(said.str.split().str[0], sort=False)
    return [f"{own.iloc[0]}; it is dropped in {own.index.nunique()} of {len(runs)} runs" for _, own in each]


@command("Many flights")
def compare(
    sources: Annotated[
        list[Path], Argument(metavar="PATH", help="Logs, a campaign's folder, or two of them side by side.")
    ],
    output: Annotated[Path | None, output_option("DIR", "Folder for report and tables. Default: write none.")] = None,
    detector: shared.Detector = None,
    fault_rate: Annotated[
        list[float] | None,
        Option(metavar="PER_HOUR", help="What an alarm is worth at so many faults per flight hour.", min=1e-9, max=1e3),
    ] = None,
    json_: shared.Json = False,
) -> None:
    """Compare detectors on the same flights: who sees what, when."""
    from cosim.compare import compare as work
    from cosim.report import write_comparison
    from cosim.report.compare_page import SIGNS

    for name, sign in SIGNS.items():
        reserve(output / name if output else None, sign)
    with Progress("reading", "flights", waiting="preparing", console=err) as tell:
        made = work(sources, progress=tell, user_detectors=detector or ())
    if output:
        write_comparison(made, output)
    answer(json_, made.to_dict(fault_rate or ()), tables.compared)


@command("Papers")
def reproduce(
    paper: Annotated[str, Argument(metavar="PAPER", help="lu17, jay, sun13, mar10, alwi14 or all.")] = "all",
    output: Annotated[Path, output_option("DIR", "Folder of page and rows.")] = Path("logs"),
    json_: shared.Json = False,
) -> None:
    """Repeat the papers' experiments: paper says, we get, verdict.

    Exit status 1 when a row differs.
    """
    from pandas import DataFrame

    from cosim.papers import chosen, counts
    from cosim.papers import reproduce as work
    from cosim.report import reproduction_report

    chosen(paper)
    page, table = (output / f"reproduce-{paper}.{ending}" for ending in ("html", "csv"))
    listed = columns("paper", "item", "says")
    reserve(page, PAGE)
    reserve(table, listed)
    with Progress(f"reproducing {paper}", "rows", waiting="preparing", console=err) as tell:
        rows, drawings = work(paper, progress=tell)
    reproduction_report(rows, drawings, page)
    frame = DataFrame(map(asdict, rows))
    replace(table, lambda part: frame.to_csv(part, index=False), listed)
    found: dict[str, Any] = {"counts": counts(rows), "report": str(page), "table": str(table)}
    plain = [asdict(r) | {"got": r.got if math.isfinite(r.got) else None} for r in rows]
    answer(json_, {**found, "rows": plain}, lambda _: tables.reproduced(rows, found))
    raise Exit(int(found["counts"]["differs"] > 0))
