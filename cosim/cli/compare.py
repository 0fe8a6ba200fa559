"""The tables of `cosim compare`, built from the same plain data that --json prints. Nothing here prints."""

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.tables import NOTHING, number, table

COUNTS = ("designed", "detected", "named", "ambiguous", "misnamed", "idle", "not_excited")


def false_alarms(d: dict) -> tuple[str, Text | str, Text | str]:
    """Return the cells of a detector's false alarms: how many, in how many valid hours, per hour."""
    return str(d["false_alarms"]), number(d["hours"], 1), number(d["false_alarms_per_hour"], 1)


def compare(found: dict) -> Group:
    """Return the table of a comparison: `found` is the JSON of `cosim compare`."""
    t = table("", "detector", "valid>", "of>", "seen>", "right>", "amb.>", "wrong>", "n. v.>", "n. e.>", "alarm s>",
              "right s>", "stands>", "false>", "in h>", "per h>", "free>")  # fmt: skip
    notes = []
    for d in found["detectors"]:
        free = Text(
            f"{d['fault_free_alarmed']}/{d['fault_free_runs']}", style="red" if d["fault_free_alarmed"] else "dim"
        )
        counts = [str(d[k]) if d["designed"] else NOTHING for k in COUNTS]
        valid = NOTHING if d["availability"] is None else f"{d['availability']:.0%}"
        times = number(d["delay_s"]), number(d["right_s"]), number(d["standing_s"], 0)
        style = "" if d["detected"] else "dim"
        t.add_row(d["id"], valid, *counts, *times, *false_alarms(d), free, style=style)
        if d["idle"] and d["why_not_valid"]:
            notes.append(Text(f"{d['id']} not valid: {d['why_not_valid']}", style="dim"))
    t.caption, t.caption_justify = (
        "of: faults that it was designed for, on parts that it watches: named right, ambiguous, wrong, not valid (n. v."
        "), not excited (n. e.: a jam or runaway that never showed), else missed; alarm, right: median time to the "
        "first alarm and to the right name, a missed one is endless; stands: alarm seconds without a fault; false, in "
        "h: false alarms, and the hours in which one would count (valid, without a fault that concerns it); free: "
        "fault-free flights with one",
        "left",
    )
    flown = f"{found['runs']} flights, {found['source']}" + (
        f"; {found['failed']} could not be flown" if found["failed"] else ""
    )
    lines: list[RenderableType] = [Text(flown), t, *notes]
    for key in ("report", "table"):
        if found[key]:
            lines.append(Text(f"{key:<7}{found[key]}"))
    return Group(*lines)
