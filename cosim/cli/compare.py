"""The tables of `cosim compare`, built from the same plain data that --json prints. Nothing here prints."""

from rich.console import Group
from rich.text import Text

from cosim.cli.tables import NOTHING, number, table
from cosim.judge import coverage


def compare(found):
    """Return the table of a comparison: `found` is the JSON of `cosim compare`."""
    t = table(
        "",
        "detector",
        "draws on",
        "seen>",
        "named>",
        "misnamed>",
        "median s>",
        "false alarms>",
        "per hour>",
        "µs>",
    )
    for d in found["detectors"]:
        seen = f"{d['detected']}/{d['designed']}" if d["designed"] else NOTHING
        free = Text(
            f"{d['fault_free_alarmed']}/{d['fault_free_runs']}", style="red" if d["fault_free_alarmed"] else "dim"
        )
        style = "" if d["detected"] else "dim"
        t.add_row(
            d["id"],
            coverage.group(d["id"], d["level"]),
            seen,
            str(d["named"]),
            str(d["misnamed"]),
            number(d["delay_s"]),
            free,
            number(d["false_alarms_per_hour"], 1),
            number(d["step_us"]),
            style=style,
        )
    t.caption, t.caption_justify = (
        "seen: faults of those it was designed for; delays count a missed one as endless; false alarms: "
        "fault-free flights with one",
        "left",
    )
    flown = f"{found['runs']} flights, {found['source']}" + (
        f"; {found['failed']} could not be flown" if found["failed"] else ""
    )
    lines = [Text(flown), t]
    for key in ("report", "table"):
        if found[key]:
            lines.append(Text(f"{key:<7}{found[key]}"))
    return Group(*lines)
