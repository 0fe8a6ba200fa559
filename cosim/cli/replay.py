"""What `cosim replay` and `cosim recover` show: tables built from the same plain data that `--json` prints."""

from typing import Any

from rich.console import Group
from rich.markup import escape
from rich.text import Text

from cosim.cli.tables import NOTHING, number, table

SHOWN = 12  # differences in the table; all of them are in --json
MISSING = 6  # signals of a detector that was not run


def replay(found: Any, detection: Any) -> Any:
    """Return the outcome of a replay: what differs, how much was compared; with `detection`, who alarmed when."""
    parts = [_differences(found)] if found["differences"] else []
    parts.append(_verdict(found))
    if detection:
        parts.append(_detection(found["detectors"], found["changed"]))
    if found["output"]:
        parts.append(Text(f"log    {found['output']}: the new outputs stand under /replay"))
    return Group(*parts)


def _differences(found):
    t = table("Differences, bit for bit", "field", "differ>", "first tick>", "at s>", "largest>")
    for d in found["differences"][:SHOWN]:
        gap = NOTHING if d["max_abs"] is None else f"{d['max_abs']:.3g}"
        t.add_row(
            escape(d["field"]), str(d["count"]), str(d["first_tick"]), f"{d['first_tick'] * found['dt_s']:.3f}", gap
        )
    if len(found["differences"]) > SHOWN:
        t.caption, t.caption_justify = f"and {len(found['differences']) - SHOWN} fields more (--json has all)", "left"
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
    shown = [r for r in rows if not changed or r["id"] in changed]
    t = table(
        "Detection, as logged and as replayed",
        "detector",
        "watches",
        "at s>",
        "now>",
        "isolated",
        "now",
        "false>",
        "now>",
    )
    for r in shown:
        old, new = r["logged"], r["replayed"]
        t.add_row(
            r["id"],
            r["target"].removeprefix("elevator.").replace("_", " "),
            number(old["detected_at_s"]) if old else NOTHING,
            number(new["detected_at_s"]),
            _isolated(old) if old else "was not there",
            _isolated(new),
            str(old["false_alarms"]) if old else NOTHING,
            str(new["false_alarms"]),
            style="" if (old and old["alarm"]) or new["alarm"] else "dim",
        )
    return t


def _isolated(entry):
    return entry["isolated"]["class"] if entry["isolated"] else NOTHING


def diagnosis(found: Any) -> Any:
    """Return what the detectors say about foreign data, and what the others lack."""
    t = table("Verdicts", "detector", "watches", "first alarm s>", "alarms>", "isolated", "largest |r|>", "valid %>")
    for r in found["detectors"]:
        where = r["target"].removeprefix("elevator.").replace("_", " ")
        figures = number(r["r_max"]), number(r["valid_pct"], 0)
        alarm = number(r["first_alarm_s"]), str(r["alarms"]), _isolated(r)
        t.add_row(r["id"], where, *alarm, *figures, style="" if r["alarm"] else "dim")
    end = found["start_s"] + found["duration_s"]
    head = Text(f"{found['start_s']:.12g} to {end:.12g} s of {found['recording']} at {found['rate_hz']} Hz")
    parts = [head, t, *(Text(c, style="yellow") for c in found["caveats"])]
    if found["not_run"]:
        parts.append(_not_run(found["not_run"], {s["name"].partition(".")[0] for s in found["signals"]}))
    if found["output"]:
        parts.append(Text(f"log    {found['output']}: inputs stand under /input, outputs under /replay"))
    return Group(*parts)


def _not_run(rows, named):
    """Return what lacks signals: of segments that the map names nothing of a word, of the others what is missing."""
    lack = table("Not run", "detector", "watches", "signals that the map lacks")
    away: dict[str, list] = {}
    for r in rows:
        lane = r["target"].removeprefix("elevator.")
        if lane != "aircraft" and lane not in named:
            away.setdefault(lane, []).append(r["id"])
            continue
        shown = r["missing"][:MISSING]
        more = f" and {len(r['missing']) - MISSING} more" if len(r["missing"]) > MISSING else ""
        lack.add_row(r["id"], lane.replace("_", " "), escape(", ".join(shown)) + more)
    if away:
        which = ", ".join(lane.replace("_", " ") for lane in away)
        lack.caption, lack.caption_justify = f"nor any of {which}: the map names no signal of theirs", "left"
    return lack


def recover(found: Any) -> Any:
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
    parts = [head]
    if found["lost"]:
        t = table("Lost", "at byte>", "bytes>", "why")
        for d in found["lost"][:SHOWN]:
            t.add_row(str(d["offset"]), str(d["bytes"]), escape(d["reason"]))
        if len(found["lost"]) > SHOWN:
            t.caption, t.caption_justify = f"and {len(found['lost']) - SHOWN} places more (--json has all)", "left"
        parts.append(t)
    return Group(*parts, Text(f"log    {found['out']}"))
