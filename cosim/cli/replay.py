"""The commands `replay` and `recover`, and their tables, from the same plain data that `--json` prints."""

import contextlib
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli import output as shared
from cosim.cli.app import LIVE_PORT, answer, app, err, notes, only_with, served
from cosim.cli.flight import before
from cosim.cli.output import flag, option, output_option, reserve
from cosim.cli.tables import progress as bar
from cosim.cli.tables import whole
from cosim.errors import LogError
from cosim.files import LEFT
from cosim.table import DASH, Table

SHOWN = 12  # differences in the table; all of them are in --json
MISSING = 6  # signals of a detector that was not run


@app.command()
def replay(
    ctx: typer.Context,
    log: shared.LogArg,
    detectors: Annotated[str | None, option("A,B", "Only these detectors.")] = None,
    set_: Annotated[
        list[str] | None, option("DETECTOR.PARAMETER=VALUE", "What if: change a parameter. Repeatable.", "--set", "-s")
    ] = None,
    start: Annotated[float, option("T", "Start in the middle, at T seconds.", "--from", min=0.0)] = 0.0,
    map_: Annotated[
        Path | None,
        option("MAP.toml", "Diagnose a recording by this map of [b]cosim map[/].", "--map"),
    ] = None,
    output: Annotated[Path | None, output_option("LOG", "Write old and new outputs to a log.")] = None,
    overwrite: shared.OverwriteOption = False,
    live: Annotated[
        bool, flag("--live", "Run nothing: play and scrub the log in Foxglove, at the address printed.")
    ] = False,
    speed: shared.SpeedOption = None,
    port: shared.PortOption = None,
    detector: shared.DetectorOption = None,
    trust: Annotated[bool, flag("--trust", "Run the code attached to the log: its flight's own detectors.")] = False,
    json_: shared.JsonOption = False,
) -> None:
    """Run the detectors of a log again and compare bit for bit.

    Exit status 0: exact, 1: different. A detector of your own that was not part of the flight is run on it as it was
    logged.
    """

    only_with("--live", live, speed=speed, port=port)
    if live:
        from cosim.replay.live import show

        where = LIVE_PORT if port is None else port
        with contextlib.suppress(KeyboardInterrupt):  # that is how it ends
            show(log, port=where, speed=speed or 1.0, start_s=start, ready=served)
        return
    chosen = [name.strip() for name in detectors.split(",") if name.strip()] if detectors is not None else None
    if trust:
        aside = ctx.with_resource(tempfile.TemporaryDirectory(prefix="cosim-trusted-"))
        detector = [*(detector or ()), *_attached(log, Path(aside))]
    taken = {"the log": [log], "a detector": detector or (), "the map": [map_] if map_ else ()}
    if output:
        from cosim.log.format import OURS

        reserve(output, OURS, taken=taken, log=True)
    overwritten = output is not None and output.is_file()
    from cosim.replay.log_schema import overrides

    how: dict[str, Any] = {"detectors": chosen, "overrides": overrides(set_ or ()), "start_s": start}
    how["guests"] = detector or ()
    if map_:
        from cosim.replay.map import diagnose

        done = diagnose(log, map_, output=output, **how).to_dict()
        answer(json_, done | {"overwritten": overwritten}, diagnosis)
        return
    from cosim.replay import replay as work

    with bar(err, "replaying") as progress:
        made = work(log, output=output, progress=progress, **how)
    notes(made.notes)
    detection = chosen is not None or bool(set_ or detector)
    answer(json_, made.to_dict() | {"overwritten": overwritten}, lambda found: shown(found, detection))
    raise typer.Exit(0 if (made.exact and not made.left_out) or (detector and not made.values) else 1)


def _attached(log, folder):
    """Write the sources of a log into `folder`; return the files of its detectors."""
    from cosim.log import open_log
    from cosim.replay import log_schema
    from cosim.scenario.user_parts import identity, places, write

    found = open_log(log)
    tables = log_schema.scenario_tables(found)
    missing = write(tables, found.attachments, folder)
    own = [at for at in places(tables) if at.name.startswith("detectors.") and at.name not in missing]
    for at in own:
        if identity(folder / at.table[at.key]).sha256 != at.table.get(at.digest):
            said = "what is attached is not the code that flew: its digest differs, or a file of it is not attached"
            raise LogError(said, place=f"{log}: {at.name}", remedy="Give it by --detector")
    return [folder / at.table[at.key] for at in own]


@app.command()
def recover(
    log: shared.LogArg,
    output: Annotated[
        Path | None, output_option("LOG", "Default: LOG, or LOG with .recovered before its ending if there is one.")
    ] = None,
    overwrite: shared.OverwriteOption = False,
    trust: Annotated[bool, flag("--trust", "Run the code that the journal of a killed flight names.")] = False,
    json_: shared.JsonOption = False,
) -> None:
    """Make a readable log of what a kill or a full disk has left.

    It says what is lost. Of a flight by hand or live that was killed, which writes its log at its end, fly again what
    it had come to.
    """
    from cosim.files import left_by
    from cosim.flight.interactive import journal
    from cosim.log import recover as work
    from cosim.log.format import OURS

    asked = str(log).endswith(LEFT)
    log = Path(str(log).removesuffix(".flown.toml").removesuffix(LEFT))
    path = output or (log.with_suffix(f".recovered{log.suffix}") if log.exists() else log)
    if journal.beside(log).is_file():
        reserve(path, OURS, log=path.resolve() != log.resolve())
        with bar(err, f"flying {log.stem} again", waiting="preparing") as progress:
            again = journal.recover(log, path, trust=trust, progress=progress)
        answer(json_, again, lambda _: whole(flown_again(again)))
        return
    left = left_by(log)
    from_part = asked or left.is_file()
    if not from_part:
        path = output or log.with_suffix(f".recovered{log.suffix}")
    reserve(path, OURS, taken={"the log": [left if from_part else log]}, log=path.resolve() != log.resolve())
    found = work(left if from_part else log, path)
    if from_part and found["cut"]:  # all but its open end is in the new log
        left.unlink()
    answer(json_, found, recovered)


def shown(found: dict[str, Any], detection: bool) -> Group:
    """Return the outcome of a replay: what differs, how much was compared; with `detection`, who alarmed when."""
    parts = [_differences(found)] if found["differences"] else []
    parts.append(_verdict(found))
    if detection:
        parts.append(_detection(found["detectors"], found["changed"]))
    if found["output"]:
        parts.append(whole(f"log    {found['output']}{before(found)}: the new outputs stand under /replay"))
    return Group(*parts)


def _differences(found):
    t = Table("Differences, bit for bit", "field", "differ>", "first tick>", "at s>", "largest>")
    for d in found["differences"][:SHOWN]:
        at = f"{d['first_tick'] * found['dt_s']:.3f}"
        t.add(d["field"], d["count"], d["first_tick"], at, d["max_abs"])
    if len(found["differences"]) > SHOWN:
        t.caption = f"and {len(found['differences']) - SHOWN} fields more (--json has all)"
    return t


def _verdict(found):
    compared = f"{found['values']:,} values of {found['rows']:,} steps compared"
    if not found["values"]:
        return Text("no detector of the log was run again")
    word = ("exact", "green") if found["exact"] else ("different", "yellow" if found["changed"] else "red")
    text = Text.assemble(word, f": {compared}")
    if found["skipped"]:
        text.append(f"; {found['skipped']:,} steps after gaps of the log could not be replayed")
    return text


def _detection(rows, changed):
    from cosim.judge.lanes import part, seconds

    t = Table("Detection, as logged and as replayed", "detector", "watches", "at, s>", "now, s>", "isolated", "now",
              "false alarms>", "now>", keys=2,
              caption="left of each `now` what the log holds, under `now` what this build finds")  # fmt: skip
    for r in (r for r in rows if not changed or r["id"] in changed):
        old, new = r["logged"], r["replayed"]
        was = (seconds(old["detected_at_s"]), _isolated(old), old["false_alarms"]) if old else (
            DASH, "was not there", DASH)  # fmt: skip
        tone = "" if (old and old["alarm"]) or new["alarm"] else "muted"
        t.add(r["id"], part(r), was[0], seconds(new["detected_at_s"]), was[1], _isolated(new), was[2],
              new["false_alarms"], tone=tone)  # fmt: skip
    return t


def _isolated(entry):
    return entry["isolated"]["class"] if entry["isolated"] else DASH


def diagnosis(found: dict[str, Any]) -> Group:
    """Return what the detectors say about foreign data, and what the others lack."""
    from cosim.judge.lanes import verdicts  # `--help` needs no detectors

    t = verdicts(found["detectors"])
    end = found["start_s"] + found["duration_s"]
    head = Text(f"{found['start_s']:.12g} to {end:.12g} s of {found['recording']} at {found['rate_hz']} Hz")
    first = Text(found["clock"])
    parts: list[RenderableType] = [first, head, *(Text(c, style="yellow") for c in found["caveats"]), t]
    if found["not_run"]:
        parts.append(_not_run(found["not_run"], {s["name"].partition(".")[0] for s in found["signals"]}))
    if found["output"]:
        told = f"{found['output']}{before(found)}"
        parts.append(whole(f"log    {told}: inputs stand under /input, outputs under /replay"))
    return Group(*parts)


def _not_run(rows, named):
    """Return what lacks signals: of segments that the map names nothing of a word, of the others what is missing."""
    from cosim.replay.map_signals import in_map

    lack = Table("Not run", "detector", "watches", "signals that the map lacks")
    away: dict[str, list] = {}
    for r in rows:
        lane = r["target"].removeprefix("elevator.")
        if lane != "aircraft" and lane not in named:
            away.setdefault(lane, []).append(r["id"])
            continue
        words = in_map(r["missing"])
        shown = words[:MISSING]
        more = f" and {len(words) - MISSING} more" if len(words) > MISSING else ""
        lack.add(r["id"], lane.replace("_", " "), ", ".join(shown) + more)
    if away:
        which = ", ".join(lane.replace("_", " ") for lane in away)
        lack.caption = f"nothing runs on {which}: the map names no signal of these segments"
    return lack


def flown_again(found: dict[str, Any]) -> str:
    """Return what came back of a flight that was killed before it wrote its log."""
    told = [f"{f['kind']} on {f['target']} from {f['start_s']:g} s" for f in found["faults"]]
    lines = [f"{found['ticks']:,} ticks ({found['duration_s']:g} s) flown again, {', '.join(told) or 'no fault'}",
             f"log    {found['out']}"]  # fmt: skip
    return "\n".join(lines)


def recovered(found: dict[str, Any]) -> Group:
    """Return what came back of a damaged log, and what is lost."""
    head = Text.assemble(
        (f"{found['ticks']:,} ticks", "bold"), f" ({found['duration_s']:g} s) in {found['chunks']} whole chunks\n"
    )
    if found["complete"]:
        head.append("nothing of the run is lost", "green")
    else:
        head.append("the run is incomplete: it holds no result", "yellow")
    if not found["parameters_intact"]:
        head.append("\nscenario or parameters are not as they were written: replay may differ", "red")
    parts: list[RenderableType] = [head]
    if found["lost"]:
        t = Table("Lost", "at byte>", "bytes>", "why")
        for d in found["lost"][:SHOWN]:
            t.add(d["offset"], d["bytes"], d["reason"])
        if len(found["lost"]) > SHOWN:
            t.caption = f"and {len(found['lost']) - SHOWN} places more (--json has all)"
        parts.append(t)
    return Group(*parts, Text(f"log    {found['out']}"))
