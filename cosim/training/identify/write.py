"""Files of what was identified: a block for each actuator's response, and a table for scenario and map beside it."""

import math
from pathlib import Path

from cosim.training.identify import Identification
from cosim.training.identify.response import MEANINGS, UNITS

BLOCK = '''"""Actuator of {segment}, identified by `cosim identify` from {recording}.

{lines}
Fit {fit:.1f} %. A scenario names it [actuators.{name}] file = "{file}", with {segment} = "{name}" in [elevator].
"""

from actuators.simple import identified
from actuators.simple.identified import INPUTS, OUTPUTS, PARAMS, STATE, init_at, rollout

__all__ = ["INPUTS", "OUTPUTS", "PARAMS", "STATE", "init_at", "params", "rollout"]
VALUES = {values}


def params(**others):
    """Return PARAMS (1,) with what was identified; `others` replace values."""
    return identified.params(**{{**VALUES, **others}})
'''


def texts(found: Identification, folder: Path, stem: str) -> dict[Path, str]:
    """Return {file: text} of what `found` writes into `folder`: STEM.toml, and STEM_SEGMENT.py for each response."""
    out: dict[Path, str] = {}
    actuators, elevator = [], []
    for segment, fitted in found.responses.items():
        name = f"{stem}_{segment}"
        file = folder / f"{name}.py"
        told = "\n".join(_line(n, p, found.level) for n, p in fitted.parameters.items())
        values = {n: float(f"{v:.6g}") for n, v in fitted.values().items()}
        out[file] = BLOCK.format(segment=segment, recording=Path(found.recording).name, lines=told, name=name,
                                 fit=fitted.fit_pct, file=file.name, values=values)  # fmt: skip
        actuators += [f"[actuators.{name}]", f'file = "{file.name}"', ""]
        elevator.append(f'{segment} = "{name}"')
    lines = [f"# Written by `cosim identify` from {Path(found.recording).name}.", ""]
    if elevator:
        lines += ["# for a scenario:", *actuators, "[elevator]", *elevator, ""]
    flows = [row for row in found.actuators if row["kind"] == "flow" and row["parameters"]]
    for row in flows:
        own = (f"{n} {p['value']:.4g} {p['unit']} ({p['low']:.4g} to {p['high']:.4g})"
               for n, p in row["parameters"].items())  # fmt: skip
        lines += [f"# {row['segment']}: {', '.join(own)}"]
    for t in found.thresholds:
        if t.parameters:
            held = f"{t.alarms} alarms in {t.held_back_s:.0f} s held back, {t.expected:.2g} expected"
            lines += [f"# for a scenario or the map: {t.factor:.3g} times the shipped ones; {held}"]
            lines += [f"# {t.note}"] * bool(t.note)
            lines += [f"[detectors.{t.id}]", *(f"{_key(n)} = {v!r}" for n, v in t.parameters.items()), ""]
    out[folder / f"{stem}.toml"] = "\n".join([*lines, ""])
    return out


def _line(name, p, level):
    if not math.isfinite(p.value):
        return f"    {MEANINGS[name]}: at least {p.low:.5g} {UNITS[name]}, not reached; below stands the nominal one"
    note = f"; {p.note}" if p.note else ""
    return f"    {MEANINGS[name]}: {p.value:.5g} {UNITS[name]}, {100.0 * level:g} %: {p.low:.5g} to {p.high:.5g}{note}"


def _key(name):
    return f'"{name}"' if "[" in name else name
