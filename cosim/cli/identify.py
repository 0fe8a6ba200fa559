"""The command `identify`: what a fault-free recording says of sensors, actuators and thresholds."""

import math
import re
from pathlib import Path
from typing import Annotated, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.app import answer, app
from cosim.cli.output import JsonOption, OverwriteOption, argument, option, output_option, reserve
from cosim.cli.tables import whole
from cosim.cli.user_files import edited
from cosim.table import DASH, Table


@app.command()
def identify(
    recording: Annotated[Path, argument("RECORDING", "Fault-free: a file or a folder.")],
    map_: Annotated[Path, option("MAP.toml", "What is which signal (cosim map).", "--map")],
    time: Annotated[str | None, option("COLUMN", "The time column.")] = None,
    level: Annotated[float, option("P", "Level of the intervals.")] = 0.95,
    output: Annotated[Path | None, output_option("DIR", "Write actuator files and a table there.")] = None,
    overwrite: OverwriteOption = False,
    json_: JsonOption = False,
) -> None:
    """Identify noise, delays and actuators from a recording.

    It must be fault-free. Thresholds that fit it are told, too.
    """
    from cosim.files import replace_text
    from cosim.training.identify import identify as work
    from cosim.training.identify import texts

    found = work(recording, map_, time=time, level=level)
    files: list[str] = []
    if output is not None:
        stem = re.sub(r"\W+", "_", recording.stem).strip("_").lower() or "recording"
        made = texts(found, output, stem if stem[0].isalpha() else f"r_{stem}")
        for path in made:
            reserve(path, edited, taken={"the recording": [recording], "the map": [map_]})
        for path, text in made.items():
            replace_text(path, text, edited)
        files = [str(path) for path in made]
    answer(json_, found.to_dict() | {"files": files}, shown)


def shown(found: dict[str, Any]) -> Group:
    """Return the tables of an identification."""
    percent = f"{100.0 * found['level']:g} %"
    c = Table("Channels", "signal", "rate Hz>", "noise>", f"{percent}>", "lags", f"by ms, {percent}>", "remark")
    for row in found["channels"]:
        noise, lag = row.get("noise"), row["delay"]
        late: Text | str = DASH
        if lag["tau"] is not None:
            late = f"{1e3 * lag['tau']:.1f} ({1e3 * lag['low']:.1f} to {1e3 * lag['high']:.1f})"
        value = DASH if noise is None else f"{noise:.3g} {row['unit']}"
        spread = DASH if noise is None else f"{row['noise_low']:.3g} to {row['noise_high']:.3g}"
        remark = "; ".join(text for text in (row["noise_note"], lag["note"]) if text)
        c.add(row["name"], f"{row['rate_hz'] or math.nan:.4g}", value, spread, lag["of"] or DASH, late, remark)
    a = Table("Actuators", "segment", "fit of", "parameter", "value>", f"{percent}>", "remark")
    for row in found["actuators"]:
        segment = row["segment"].replace("_", " ")
        if not row["parameters"]:
            a.add(segment, row["kind"], DASH, DASH, DASH, row["note"])
        for name, p in row["parameters"].items():
            value = DASH if p["value"] is None else f"{p['value']:.5g} {p['unit']}"
            high = "no end" if p["high"] is None else f"{p['high']:.5g}"
            a.add(segment, row["kind"], name.replace("_", " "), value, f"{p['low']:.5g} to {high}", p["note"])
        if row["parameters"]:
            a.add(segment, row["kind"], "fit", f"{row['fit_pct']:.1f} %", "", "")
    parts: list[RenderableType] = [*(Text(text, style="yellow") for text in found["caveats"]), c, a]
    if found["thresholds"]:
        parts.append(_thresholds(found["thresholds"]))
    parts += [whole(f"wrote  {file}") for file in found["files"]]
    return Group(*parts)


def _thresholds(rows):
    t = Table("Thresholds", "detector", "times the shipped>", "held back s>", "alarms>", "expected>", "remark")
    for row in rows:
        figures = f"{row['held_back_s']:.0f}", str(row["alarms"]), f"{row['expected']:.2g}"
        t.add(row["id"], f"{row['factor']:.3g}", *figures, row["note"])
    return t
