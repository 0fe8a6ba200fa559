"""What a fault-free recording says of its sensors, its actuators and the detectors' thresholds.

    found = identify("flight.csv", "map.toml")
    found.channels, found.actuators, found.thresholds

Noise (noise.py) and delay (delay.py) of each channel; of an actuator with command and position its
response (response.py), with valve command and rod its flow (flow.py); thresholds that fit (thresholds.py).
"""

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cosim.judge.result import plain
from cosim.replay import clock
from cosim.replay.log_schema import ReplayError
from cosim.replay.map import Prepared, prepare
from cosim.replay.map_signals import sampled, shares
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.training.identify import flow as valve
from cosim.training.identify import response, thresholds
from cosim.training.identify.delay import PAIRS, Delay, lag
from cosim.training.identify.noise import white

LEVEL = 0.95  # of the intervals
NO_COMMAND = "not identifiable: no command channel"
COMMAND = "de_cmd"


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
    out.channels = [_channel(made, name, level) for name in _recorded(made)]
    segments = made.scenario.elevator.technology
    named = [s for s in segments if any(n.startswith(f"{s}.") for n in made.map.signals)]
    for segment in named:
        out.actuators += _actuator(made, segment, level, out.responses)
    if not named:
        out.actuators.append({"segment": "-", "kind": "response", "parameters": {},
                              "note": f"{NO_COMMAND} and no position of an actuator in the map"})  # fmt: skip
    out.thresholds = thresholds.fit(made) if detectors else []
    return out


def _recorded(made):
    """Return the signals that have a channel of their own, the first of those that share one."""
    seen: dict[str, str] = {}
    for name, signal in made.map.signals.items():
        if signal.channel and name in made.channels and name in made.sources and made.sources[name].kind != "model":
            seen.setdefault(signal.channel, name)
    return list(seen.values())


def on_grid(made: Prepared, names: list[str]) -> tuple[list[np.ndarray], float]:
    """Return (samples of each of the signals [SI], interval [s]) on ticks of the slowest of them, over the longest time
    in which all are valid."""
    rate = [clock.interval(made.channels[n][0]) for n in names]
    dt = max(made.dt, *rate) if rate else made.dt
    n = max(1, int(made.n * made.dt / dt))
    got = [
        sampled(made.map.signals[name], made.sources[name], made.channels[name], made.t_0, dt, n,
                shares(made.scenario, name, made.sources[name]))
        for name in names
    ]  # fmt: skip
    on = np.all([np.isfinite(v) & (valid > 0.0) for v, valid in got], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    spans = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2])]
    a, b = max(spans, key=lambda s: s[1] - s[0], default=(0, 0))
    return [v[a:b] for v, _ in got], dt


def _channel(made, name, level):
    """Return the row of one channel."""
    signal, source = made.map.signals[name], made.sources[name]
    t, y, flags = made.channels[name]
    factor = signal.factor(source.unit, shares(made.scenario, name, source))
    y = np.where(np.isfinite(y), factor * y, np.nan)
    if flags is not None and len(flags[1]) == len(y):
        y = np.where(flags[1] > 0.5, y, np.nan)
    step = clock.interval(t)
    gap = np.flatnonzero(np.diff(t) > 1.5 * step)
    whole = np.insert(y, gap + 1, np.nan)
    noise = white(whole, level)
    held = float(np.mean(np.diff(y[np.isfinite(y)]) == 0.0)) if np.isfinite(y).sum() > 1 else 1.0
    row = {"name": name, "channel": signal.channel, "unit": source.unit, "rate_hz": 1.0 / step if step else math.nan}
    row |= {"repeated_pct": 100.0 * held}
    if noise is None:
        constant = np.ptp(y[np.isfinite(y)]) == 0.0 if np.isfinite(y).any() else False
        few = "no finite sample" if not np.isfinite(y).any() else "is constant" if constant else "too few samples"
        row |= {"noise": None, "noise_note": few}
    else:
        row |= {"noise": noise.sigma, "noise_low": noise.low, "noise_high": noise.high}
        row |= {"resolution": noise.resolution, "noise_note": noise.note}
    return row | {"delay": asdict(_delay(made, name, level))}


def _delay(made, name, level):
    """Return the Delay of a channel behind one that physics ties to it: the most certain where there are several."""
    recorded, found = _recorded(made), []
    for later, other, n in PAIRS:
        if name in (later, other) and later in recorded and other in recorded:
            of, power = (other, n) if name == later else (later, -n)
            (y, x), dt = on_grid(made, [name, of])
            if len(y) and np.ptp(y) > 0.0 and np.ptp(x) > 0.0:
                found.append(lag(y, x, power, dt, of, level))
    none = Delay("", note="delay not identifiable: tied to no channel")
    return min(found, key=lambda d: d.high - d.low if d.high == d.high else math.inf, default=none)


def _actuator(made, segment, level, responses):
    """Return the rows of one segment: its response to the command, its valve's flow."""
    signals = {n: s for n, s in made.map.signals.items() if n in made.channels and s.channel}
    command = COMMAND in signals and not made.map.signals[COMMAND].stands_on
    position = next((n for n in (f"{segment}.surface", f"{segment}.rod") if n in signals), "")
    rows = []

    def row(kind, found, units):
        own = {n: {"unit": units[n], **asdict(p)} for n, p in found.parameters.items()}
        about = {"fit_pct": found.fit_pct, "residual": found.residual, "correlation": found.correlation}
        rows.append({"segment": segment, "kind": kind, "parameters": own, "note": found.note, **about})

    if not position:
        row("response", response.Response(note="not identifiable: no position of it in the map"), {})
    elif not command:
        row("response", response.Response(note=NO_COMMAND), {})
    else:
        (asked, moved), dt = on_grid(made, [COMMAND, position])
        arm = _arm(made, segment) if position.endswith(".rod") else 1.0
        found = response.respond(asked, moved / arm, dt, level) if len(asked) else response.Response(
            note="not identifiable: command and position are never valid together")  # fmt: skip
        row("response", found, response.UNITS)
        if found.parameters:
            responses[segment] = found
    sent, rod, pressure = (f"{segment}.{w}" for w in ("valve_command", "rod", "pressure"))
    if sent in signals and rod in signals:
        names = [sent, rod, *([pressure] if pressure in signals else [])]
        (u, q, *x3), dt = on_grid(made, names)
        if len(u) > 100:  # a tick's value has acted until then: it was sent a tick before
            row("flow", valve.flow(u[1:], q[:-1], x3[0][:-1] if x3 else None, dt, level), valve.UNITS)
        else:
            row("flow", response.Response(note="not identifiable: too few samples valid together"), {})
    return rows


def _arm(made, segment):
    own = made.scenario.elevator.technology[segment]
    return TECHNOLOGIES[own].design(made.scenario.aircraft.own(own)).arm
