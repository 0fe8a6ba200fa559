"""What a fault-free recording says of its sensors, its actuators and the detectors' thresholds.

    found = identify("flight.csv", "map.toml")
    found.channels, found.actuators, found.thresholds

Noise and delay of each channel (channels.py); of an actuator with command and position its response (response.py), with
valve command and rod its flow (flow.py); thresholds that fit (thresholds.py).
"""

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from cosim.judge.result import plain
from cosim.replay.log_schema import ReplayError
from cosim.replay.map import Prepared, prepare
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.training.identify import channels, flow, response, thresholds
from cosim.training.identify.channels import on_grid
from cosim.training.identify.response import unknown

LEVEL = 0.95  # of the intervals
NO_COMMAND = "not identifiable: no command channel"
COMMAND = "de_cmd"
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


@dataclass
class Identification:
    """What was found. SI units; intervals at LEVEL."""

    recording: str
    map: str
    level: float = LEVEL
    duration_s: float = 0.0
    channels: list = field(default_factory=list)  # a row for each channel: noise and delay
    actuators: list = field(default_factory=list)  # a row for each segment and kind of fit
    thresholds: list = field(default_factory=list)  # thresholds.Fitted
    caveats: list = field(default_factory=list)  # sentences
    responses: dict = field(default_factory=dict, repr=False)  # segment -> response.Response that flies

    def to_dict(self) -> Any:
        """Return what `cosim identify --json` prints."""
        rows = {k: v for k, v in vars(self).items() if k != "responses"}
        return plain(rows | {"thresholds": [asdict(t) for t in self.thresholds]})


def identify(
    path: str | Path, map_path: str | Path, *, time: str | None = None, level: float = LEVEL, detectors: bool = True
) -> Identification:
    """Identify the recording at `path`, file or folder, by the map at `map_path`; `time` names its time column.

    Without `detectors` no threshold is fitted. Raises ReplayError, LogError, ScenarioError.
    """
    if not 0.5 <= level < 1.0:
        raise ReplayError(f"{level:g} is no level of an interval", place="--level", allowed="0.5 to below 1")
    made = prepare(path, map_path, time=time)
    out = Identification(str(path), str(map_path), level, made.n * made.dt)
    out.caveats = [text for frame in made.tables.values() for text in frame.attrs.get("oddities", ())]
    out.channels = channels.rows(made, level)
    segments = made.scenario.elevator.technology
    named = [s for s in segments if any(n.startswith(f"{s}.") for n in made.map.signals)]
    for segment in named:
        for kind, found, units in _fits(made, segment, level):
            own = {n: {"unit": units[n], **asdict(p)} for n, p in found.parameters.items()}
            about = {"fit_pct": found.fit_pct, "residual": found.residual, "correlation": found.correlation}
            out.actuators.append({"segment": segment, "kind": kind, "parameters": own, "note": found.note, **about})
            if kind == "response" and own:
                out.responses[segment] = found
    if not named:
        out.actuators.append({"segment": "-", "kind": "response", "parameters": {},
                              "note": f"{NO_COMMAND} and no position of an actuator in the map"})  # fmt: skip
    out.thresholds = thresholds.fit(made) if detectors else []
    return out


def _fits(made: Prepared, segment: str, level: float):
    """Yield (kind, Response, units) of one segment: its response to the command, its valve's flow."""
    signals = {n for n, s in made.map.signals.items() if n in made.channels and s.channel}
    position = next((n for n in (f"{segment}.surface", f"{segment}.rod") if n in signals), "")
    if not position:
        found = unknown("no position of it in the map")
    elif COMMAND not in signals or made.map.signals[COMMAND].stands_on:
        found = response.Response(note=NO_COMMAND)
    else:
        (asked, moved), dt = on_grid(made, [COMMAND, position])
        own = made.scenario.elevator.technology[segment]
        arm = TECHNOLOGIES[own].design(made.scenario.aircraft.own(own)).arm if position.endswith(".rod") else 1.0
        never = unknown("command and position are never valid together")
        found = response.respond(asked, moved / arm, dt, level) if len(asked) else never
    yield "response", found, response.UNITS
    sent, rod, pressure = (f"{segment}.{w}" for w in ("valve_command", "rod", "pressure"))
    if sent in signals and rod in signals:
        (u, q, *x3), dt = on_grid(made, [sent, rod, *({pressure} & signals)])
        found = unknown("too few samples valid together")
        if len(u) > 100:  # a tick's value has acted until then: it was sent a tick before
            found = flow.flow(u[1:], q[:-1], x3[0][:-1] if x3 else None, dt, level)
        yield "flow", found, flow.UNITS


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
            keys = {f'"{n}"' if "[" in n else n: v for n, v in t.parameters.items()}
            lines += [f"[detectors.{t.id}]", *(f"{n} = {v!r}" for n, v in keys.items()), ""]
    out[folder / f"{stem}.toml"] = "\n".join([*lines, ""])
    return out


def _line(name, p, level):
    meaning, unit = response.MEANINGS[name], response.UNITS[name]
    if not math.isfinite(p.value):
        return f"    {meaning}: at least {p.low:.5g} {unit}, not reached; below stands the nominal one"
    note = f"; {p.note}" if p.note else ""
    return f"    {meaning}: {p.value:.5g} {unit}, {100.0 * level:g} %: {p.low:.5g} to {p.high:.5g}{note}"
