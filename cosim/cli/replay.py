"""The commands `replay` and `recover`, and their tables, from the same plain data that `--json` prints."""

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.text import Text

from cosim.cli import app as shared
from cosim.cli.app import (
    LIVE_PORT,
    answer,
    command,
    flag,
    notes,
    only_with,
    option,
    output_option,
    progress,
    reserve,
    served,
    whole,
)
from cosim.cli.flight import before
from cosim.errors import CosimError
from cosim.files import LEFT
from cosim.table import DASH, Table

SHOWN = 12  # differences in the table; all of them are in --json


@command("Start")
def replay(
    log: shared.LogArg,
    detectors: Annotated[str | None, option("A,B", "Only these detectors.")] = None,
    set_: Annotated[
        list[str] | None, option("DETECTOR.PARAMETER=VALUE", "What if: change a parameter. Repeatable.", "--set", "-s")
    ] = None,
    start: Annotated[float, option("T", "Start in the middle, at T seconds.", "--from", min=0.0)] = 0.0,
    map_: Annotated[
        Path | None, option("MAP.toml", "Diagnose a recording by this map of [b]cosim map[/].", "--map")
    ] = None,
    output: Annotated[Path | None, output_option("LOG", "Write old and new outputs to a log.")] = None,
    live: Annotated[bool, flag("--live", "Run nothing: play and scrub the log in Foxglove.")] = False,
    speed: shared.SpeedOption = None,
    port: shared.PortOption = None,
    detector: shared.DetectorOption = None,
    json_: shared.JsonOption = False,
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
    from cosim.replay.log_schema import overrides

    if output:
        from cosim.log.format import OURS

        reserve(output, OURS, log=True)
    overwritten = {"overwritten": output is not None and output.is_file()}
    chosen = [name.strip() for name in detectors.split(",") if name.strip()] if detectors is not None else None
    how: dict[str, Any] = {"detectors": chosen, "overrides": overrides(set_ or ()), "start_s": start,
                           "user_detectors": detector or (), "output": output}  # fmt: skip
    if map_:
        from cosim.replay.map import diagnose

        return answer(json_, diagnose(log, map_, **how).to_dict() | overwritten, diagnosis)
    from cosim.replay import replay as work

    with progress("replaying") as tell:
        made = work(log, progress=tell, **how)
    notes(made.notes)
    detection = chosen is not None or bool(set_ or detector)
    answer(json_, made.to_dict() | overwritten, lambda found: shown(found, detection))
    raise typer.Exit(0 if made.exact or (detector and not made.values) else 1)


@command("Start")
def recover(
    log: shared.LogArg,
    output: Annotated[
        Path | None, output_option("LOG", "Default: LOG, or LOG with .recovered before its ending if there is one.")
    ] = None,
    json_: shared.JsonOption = False,
) -> None:
    """Make a readable log of what a kill or a full disk left."""
    from cosim.files import left_by
    from cosim.log import recover as work
    from cosim.log.format import OURS

    asked, log = log, Path(str(log).removesuffix(LEFT))
    part, changed = left_by(log), Path(f"{log}.flown.toml")
    source = part if part.is_file() else asked
    if not source.exists() and changed.is_file():
        remedy = f"`cosim run {changed} -o {log}` flies it again"
        raise CosimError("the flight was killed before it wrote its log", place=str(log), remedy=remedy)
    path = output or (log.parent / f"{log.stem}.recovered{log.suffix}" if log.exists() else log)
    reserve(path, OURS)
    found = work(source, path)
    if source == part and found["cut"]:  # all but its open end is in the new log
        part.unlink()
    answer(json_, found, recovered)


def shown(found: dict[str, Any], detection: bool) -> Group:
    """Return the outcome of a replay: what differs, how much was compared; with `detection`, who alarmed when."""
    parts: list[Any] = [_differences(found)] if found["differences"] else []
    word = ("exact", "green") if found["exact"] else ("different", "yellow" if found["changed"] else "red")
    compared = f": {found['values']:,} values of {found['rows']:,} steps compared"
    gaps = f"; {found['skipped']:,} steps after gaps of the log could not be replayed" if found["skipped"] else ""
    parts.append(Text.assemble(word, compared, gaps) if found["values"] else "no detector of the log was run again")
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


def _detection(rows, changed):
    from cosim.judge.lanes import part, seconds

    t = Table("Detection, as logged and as replayed", "detector", "watches", "at, s>", "now, s>", "isolated", "now",
              "false alarms>", "now>", keys=2,
              caption="left of each `now` what the log holds, under `now` what this build finds")  # fmt: skip
    none: dict[str, Any] = {
        "detected_at_s": None,
        "isolated": {"class": "was not there"},
        "false_alarms": DASH,
        "alarm": False,
    }
    for r in (r for r in rows if not changed or r["id"] in changed):
        old, new = r["logged"] or none, r["replayed"]
        at, said, false = zip(*((seconds(e["detected_at_s"]), e["isolated"]["class"] if e["isolated"] else DASH,
                                 e["false_alarms"]) for e in (old, new)))  # fmt: skip
        t.add(r["id"], part(r), *at, *said, *false, tone="" if old["alarm"] or new["alarm"] else "muted")
    return t


def diagnosis(found: dict[str, Any]) -> Group:
    """Return what the detectors say about foreign data, and what the others lack."""
    from cosim.judge.lanes import verdicts  # `--help` needs no detectors
    from cosim.replay.map_signals import in_map

    end = found["start_s"] + found["duration_s"]
    head = Text(f"{found['start_s']:.12g} to {end:.12g} s of {found['recording']} at {found['rate_hz']} Hz")
    parts: list[Any] = [Text(found["clock"]), head, *(Text(c, style="yellow") for c in found["caveats"])]
    lack = Table("Not run", "detector", "watches", "signals that the map lacks",
                 caption="of the aircraft and of the segments of which the map names a signal")  # fmt: skip
    named = {"aircraft", *(s["name"].partition(".")[0] for s in found["signals"])}
    for r in found["not_run"]:
        lane = r["target"].removeprefix("elevator.")
        if lane in named:
            lack.add(r["id"], lane.replace("_", " "), ", ".join(in_map(r["missing"])))
    parts += [verdicts(found["detectors"]), *([lack] if lack.rows else [])]
    if found["output"]:
        parts.append(whole(f"log    {found['output']}{before(found)}: inputs under /input, outputs under /replay"))
    return Group(*parts)


def recovered(found: dict[str, Any]) -> Group:
    """Return what came back of a damaged log, and what is lost."""
    whole_ = ("nothing of the run is lost", "green")
    cut = ("the run is incomplete: it holds no result", "yellow")
    parts = [Text(f"{found['ticks']:,} ticks ({found['duration_s']:g} s) in {found['chunks']} whole chunks", "bold"),
             Text(*(whole_ if found["complete"] else cut))]  # fmt: skip
    parts += [Text(f"lost   {d['bytes']} bytes at {d['offset']}: {d['reason']}") for d in found["lost"][:SHOWN]]
    if len(found["lost"]) > SHOWN:
        parts.append(Text(f"and {len(found['lost']) - SHOWN} places more (--json has all)"))
    return Group(*parts, whole(f"log    {found['out']}"))
