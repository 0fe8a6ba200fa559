"""Diagnose foreign data: map its channels to the detectors' inputs, run every detector whose inputs are complete,
name what is missing.

A detector's inputs are wired to names of our bus (cosim/flight/detection/detectors.py); a map file
(cosim/replay/map_file.py) says which channel stands for each.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.flight.detection import detectors as table
from cosim.judge.result import plain
from cosim.log import LogWriter, TopicInfo, viewer_layouts
from cosim.parts import load, with_detectors
from cosim.replay import clock
from cosim.replay import map_signals as signals_of
from cosim.replay.caveats import caveats
from cosim.replay.detector_replay import elements, flat, judgement, output_names, replay_lane, unlogged
from cosim.replay.foreign import read_channels
from cosim.replay.lane_inputs import delays, in_time, lane_inputs
from cosim.replay.log_schema import ReplayError, check_start, chosen_overrides, override
from cosim.replay.map_file import load_map
from cosim.replay.write import stacked
from cosim.scenario import parse, vocabulary
from cosim.scenario.user_parts import locate

NEAREST = 4  # detectors of which it is said what they lack
MOST_TICKS = 4_000_000  # five and a half hours at 200 Hz: all inputs of a recording are in memory


@dataclass
class Diagnosis:
    """What the detectors say about a recording; `not_run` names the missing signals of the others."""

    recording: str  # its file
    map: str  # file of the map
    rate_hz: int  # of the detectors' ticks [Hz]
    start_s: float  # of the first tick, in the recording's time
    duration_s: float
    signals: list = field(default_factory=list)  # a dict per mapped signal: name, channel, unit, sign
    detectors: list = field(default_factory=list)  # a dict per lane that ran, as of a flight
    not_run: list = field(default_factory=list)  # a dict per lane that did not: id, target, missing signals
    caveats: list = field(default_factory=list)  # sentences
    output: str | None = None  # the log that was written

    def to_dict(self) -> Any:
        """Return what `cosim replay --map --json` prints."""
        return plain(vars(self))


@dataclass
class Prepared:
    """A recording brought to the detectors' ticks: signals by name, and the detectors with what each of them reads."""

    map: Any  # cosim/replay/map_file.py
    text: str  # of the map
    scenario: Any  # cosim.scenario.Scenario
    tables: dict
    channels: dict  # signal -> (times, samples, flags or None), as recorded
    sources: dict  # signal -> vocabulary.Signal
    values: dict  # signal -> (values (n,), valid (n,)), SI
    found: list  # detectors
    wires: dict  # (detector, lane) -> its Wires
    t_0: float  # [s]
    n: int  # ticks
    dt: float  # [s]
    delays: dict = field(default_factory=dict)  # of valve commands against what answers them [ticks]

    def params(self, d: Any) -> Any:
        """Return PARAMS of the lanes of detector `d`."""
        return d.params(self.scenario, self.dt)


def prepare(
    path: str | Path, map_path: Any, *, detectors: Any = None, start_s: float = 0.0, on_reset: Any = None,
    part: int = 0, guests: Sequence[Any] = (), time: str | None = None
) -> Prepared:  # fmt: skip
    """Return the recording at `path` as the map at `map_path` has it; arguments and errors as of `diagnose`."""
    made = [load(g).DETECTOR.id for g in guests]
    check_start(start_s)
    m, text = load_map(map_path)
    scenario = with_detectors(_scenario(m, detectors, map_path), guests)
    detectors = [*detectors, *made] if detectors else detectors
    m = signals_of.with_hinge(m)
    dt = 1.0 / m.rate_hz
    used = [name for s in m.signals.values() for name in (s.channel, s.valid) if name]
    how: dict[str, Any] = {"time": time or m.time, "columns": m.columns, "on_reset": on_reset, "part": part}
    found = [d for d in table.chosen(scenario) if not detectors or d.id in detectors]
    wires = {(d.id, lane): d.inputs(lane) for d in found for lane in d.lanes}
    sources = {w.signal.word: w.signal for own in wires.values() for w in own if w.signal.kind != "detector"}
    signals_of.check(m, map_path, scenario)
    tables = read_channels(path, wanted=lambda topic: signals_of.named(topic, used), **how)
    recorded = signals_of.channels_of(m, tables, path, map_path)
    channels = signals_of.acting(m, sources, signals_of.derived(m, recorded, map_path), dt)
    spans = [(t[0], t[-1]) for t, *_ in channels.values() if len(t)]
    if not spans:
        raise ReplayError("no signal has a channel with samples", place=str(map_path))
    t_0, n = signals_of.ticks(spans, dt, start_s or None)
    if n > MOST_TICKS:
        allowed = f"{MOST_TICKS * dt:.3g} s at {m.rate_hz} Hz"
        what = f"the channels last {n * dt:.3g} s"
        raise ReplayError(what, place=str(path), allowed=allowed, remedy=clock.IN_SECONDS)
    if n < 2:
        once = all(len(frame) and frame.index[0] == frame.index[-1] for frame in tables.values())
        said = "holds a single time" if once else "the channels have no time in common"
        raise ReplayError(said, place=str(path), allowed=_spans(m, channels))
    values = {}
    for name, source in ((name, source) for name, source in sources.items() if name in m.signals):
        share = signals_of.shares(scenario, name, source)
        values[name] = signals_of.sampled(m.signals[name], source, channels.get(name), t_0, dt, n, share)
    return Prepared(m, text, scenario, tables, channels, sources, values, found, wires, float(t_0), n, dt)


def diagnose(
    path: str | Path, map_path: Any, *, detectors: Any = None, overrides: Mapping[str, Any] | None = None,
    start_s: float = 0.0, output: str | Path | None = None, on_reset: Any = None, part: int = 0,
    guests: Sequence[Any] = (), time: str | None = None
) -> Diagnosis:  # fmt: skip
    """Run the detectors on the recording at `path`, file or folder, by the map at `map_path`; return a Diagnosis.

    `detectors` chooses some (default: all), `overrides` {detector: {parameter: value}} changes parameters, `start_s`
    is a time of the recording, `output` the log to write: inputs under /input, outputs under /replay. `on_reset` and
    `part` say what becomes of a clock that goes back (cosim/replay/clock.py), `guests` are files of further detectors
    (cosim/parts), `time` names the time column in place of the map. Raises ReplayError, LogError,
    ScenarioError, GuestError, and IndexError when there is no stretch of that number.
    """
    chosen_overrides(detectors, overrides)
    how: dict[str, Any] = {"on_reset": on_reset, "part": part, "guests": guests, "time": time}
    made = prepare(path, map_path, detectors=detectors, start_s=start_s, **how)
    m, values, sources, t_0, n, dt = made.map, made.values, made.sources, made.t_0, made.n, made.dt
    out = Diagnosis(str(path), str(map_path), m.rate_hz, float(t_0), n * dt, output=str(output) if output else None)
    out.signals = []
    for name, (_, valid) in values.items():
        s, share = m.signals[name], 100.0 * float(valid.mean())
        told = {"name": name, "channel": s.channel or s.stands_on or None, "unit": s.unit or sources[name].unit}
        out.signals.append({**told, "valid_pct": share})
    odd = [text for frame in made.tables.values() for text in frame.attrs.get("oddities", ())]
    done, out.not_run = run_all(made, overrides or {})
    if not done:
        remedy = _nearest(out.not_run, m.signals)
        raise ReplayError("no detector has all its inputs", place=str(map_path), remedy=remedy)
    out.detectors = [_verdict(d, lane, again, dt, t_0) for d, lane, _, again in done]
    out.caveats = [*odd, *signals_of.slow(sources, made.channels, dt).values(), *caveats(made, done)]
    if output:
        _write(output, done, out, made.text, dt)
    return out


def _nearest(not_run: list, signals: Mapping[str, Any]) -> str:
    """Return what the detectors lack that need the fewest signals more, each on the segment that needs the fewest."""
    best: dict[str, tuple[int, bool, str, str]] = {}
    named = {name.partition(".")[0] for name in signals}
    for r in not_run:
        lacks = signals_of.in_map(r["missing"])
        alone = ", and with it this one runs" if len(lacks) == 1 else ""
        away = r["target"].removeprefix("elevator.") not in named
        row = (len(lacks), away, r["id"], f"{r['id']} of {r['target']}: {', '.join(lacks)}{alone}")
        best[r["id"]] = min(best.get(r["id"], row), row, key=lambda row: row[:2])
    near = sorted(best.values(), key=lambda row: row[0])[:NEAREST]
    told = f"Missing: {'; '.join(text for *_, text in near)}"
    base = next((name for name in ("cas", "mach") if name in signals), "cas")
    if any("tas" in r["missing"] for r in not_run if any(r["id"] == name for *_, name, _ in near)):
        needs = "" if {base, "h_baro"} <= signals.keys() else ", where the map has them"
        told += f'. tas = {{ speed_of = "{base}" }} makes tas of {base} and h_baro in the standard atmosphere{needs}'
    return told


def run_all(made: Prepared, overrides: Mapping[str, Any], only: str = "") -> tuple[list, list]:
    """Return ([(detector, lane, inputs, outputs)] of the lanes whose inputs are complete, what the others lack); of all
    detectors or `only` one."""
    wires, n, dt = made.wires, made.n, made.dt
    slow = signals_of.slow(made.sources, made.channels, dt)
    made.delays = delays(made.scenario, {k: v for k, v in made.values.items() if k not in slow}, n, dt)
    values = in_time(made.values, made.delays)
    read = {w.source.split(".")[0] for own in wires.values() for w in own if w.signal.kind == "detector"}
    done: list = []
    not_run: list = []
    for d in (d for d in made.found if not only or d.id == only):
        words = {lane: dict.fromkeys(w.signal.word for w in wires[d.id, lane]) for lane in d.lanes}
        spare = {w.source for lane in d.lanes for w in wires[d.id, lane] if d.record.may_lack}
        missing = {lane: [w for w in own if w not in values and w not in spare] for lane, own in words.items()}
        not_run += [{"id": d.id, "target": d.target(lane), "missing": lack} for lane, lack in missing.items() if lack]
        ready = replace(d, lanes=tuple(lane for lane in d.lanes if not missing[lane]))
        if ready.lanes:
            p = made.params(ready)
            for i, lane in enumerate(ready.lanes):
                if any(w.signal.word in slow for w in wires[d.id, lane]):
                    for name, value in d.record.slow.items():
                        p[name][i] = value
            override(d.record, d.module, p, overrides.get(d.id, {}), dt)
            for i, lane in enumerate(ready.lanes):
                u = lane_inputs(d.module, wires[d.id, lane], values, n)
                again = run(ready, lane, u, p[i : i + 1], dt)
                done.append((ready, lane, u, again))
                if d.id in read:
                    outputs = zip(vocabulary.outputs(d.module), np.repeat(again, d.every, axis=0)[:n].T)
                    values |= {f"{d.id}.{lane}.{name}": (y, np.ones(n)) for name, y in outputs}
    return done, not_run


def _scenario(m, chosen, place):
    """Return the Scenario of which the detectors take lanes and parameters; its tables are those of the map."""
    own = {"flight": m.flight, "elevator": m.elevator}
    own["detectors"] = {**m.detectors, **({"enabled": list(chosen)} if chosen else {})}
    tables = {"duration_s": 1.0, "rate_hz": m.rate_hz, **own}
    return parse(locate(tables, Path(place).parent, str(place)), place=str(place))


def _spans(m, channels):
    some = [(m.signals[name].channel, t) for name, (t, *_) in list(channels.items())[:6] if len(t)]
    return ", ".join(f"{channel} {t[0]:.12g} to {t[-1]:.12g} s" for channel, t in some)


def run(d: Any, lane: str, u: np.ndarray, p: np.ndarray, dt: float) -> np.ndarray:
    """Return the outputs (n, fields) of one lane."""
    return replay_lane(unlogged(d, lane, d.module, u, p), dt)[0]


def _verdict(d, lane, again, dt, t_0):
    """Return one row of the verdict table; times are the recording's."""
    names = output_names(d)
    found = judgement(d, lane, d.module.CULPRITS, names, again, dt, [])
    at, valid = found["detected_at_s"], again[:, names.index("valid")] > 0.5
    return {
        **{name: found[name] for name in ("id", "level", "target", "alarm")},
        "alarms": found["false_alarms"],
        "first_alarm_s": None if at is None else at + t_0,
        "isolated": found["isolated"],
        "r_max": found["r_max_before"],
        "valid_pct": 100.0 * float(valid.mean()),
        "alarm_pct": 100.0 * float((again[valid, names.index("alarm")] > 0.5).mean()) if valid.any() else 0.0,
    }


def _write(path, done, out, text, dt):
    """Write inputs and outputs of every lane that ran to a log."""
    infos, parts = [], []
    for d, lane, u, again in done:
        module = d.module
        read = flat(np.ascontiguousarray(u))[0]
        for name, own, values, every in (
            (f"/input/{d.id}/{lane}", elements(module.INPUTS, module.INPUTS.names), read, 1),
            (f"/replay/detectors/{d.id}/{lane}", elements(module.STATE, module.OUTPUTS), again, d.every),
        ):
            fields, units = zip(*own)
            infos.append((name, TopicInfo(name, fields, units, every, channel=name.rpartition("/")[0]), "detectors"))
            parts.append(np.zeros((u.shape[1], len(own))))
            parts[-1][::every] = values
    topics, n = stacked(infos)
    attachments = {"map.toml": ("application/toml", text.encode()), **viewer_layouts(topics)}
    metadata = {"run": {"title": f"diagnosis of {Path(out.recording).name}", "start_s": repr(out.start_s)}}
    kept: dict[str, Any] = {"metadata": metadata, "attachments": attachments, "rows_per_chunk": 500, "kept": False}
    with LogWriter(path, topics, n_values=n, dt_ns=round(dt * 1e9), **kept) as log:
        for row in np.concatenate(parts, axis=1):
            log.append(row)
        told = {n: json.dumps(plain(getattr(out, n)), sort_keys=True) for n in ("detectors", "caveats", "not_run")}
        log.close(result={"status": "diagnosed", **told})
