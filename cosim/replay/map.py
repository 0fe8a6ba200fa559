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
from cosim.judge.result import judge, plain
from cosim.log import LogWriter, Topic, viewer_layouts
from cosim.parts import loaded, with_detectors
from cosim.replay import clock
from cosim.replay import map_signals as signals_of
from cosim.replay.caveats import caveats, lost
from cosim.replay.detector_replay import SPAN, Lane, elements, flat, inputs, judged_lane
from cosim.replay.foreign import read_recording
from cosim.replay.log_schema import ReplayError, check_start, chosen_overrides, override
from cosim.replay.map_file import load_map
from cosim.replay.write import append, stacked
from cosim.scenario import parse, vocabulary
from cosim.scenario.user_parts import locate

MOST_TICKS = 4_000_000  # five and a half hours at 200 Hz: all inputs of a recording are in memory


@dataclass
class Diagnosis:
    """What the detectors say about a recording; `not_run` names the missing signals of the others."""

    recording: str  # its file
    map: str  # file of the map
    clock: str  # sentence: which field is the time, its zero, how regular, how samples became ticks
    rate_hz: int  # of the detectors' ticks [Hz]
    start_s: float  # of the first tick, in the recording's time
    duration_s: float
    signals: list = field(default_factory=list)  # a dict per mapped signal: name, channel, unit, valid_pct
    detectors: list = field(default_factory=list)  # a dict per lane that ran, as of a flight
    not_run: list = field(default_factory=list)  # a dict per lane that did not: id, target, missing signals
    caveats: list = field(default_factory=list)  # sentences
    output: str | None = None  # the log that was written

    def to_dict(self) -> Any:
        """Return what `cosim replay --map --json` prints."""
        return plain(vars(self))


class Prepared:
    """A recording on the detectors' ticks: signals by name, and the detectors with what each of them reads.

    `map` and its `text`, `scenario`, `found` detectors, `wires` {(detector, lane): its Wires}, `at` ticks (n,) [s] that
    are `dt` [s] apart, `clock` and `notes` sentences about the time and what is cut or lost, `values` {signal: (values
    (n,), valid (n,)) in SI}, `unsure` {command of which not every tick's is known: sentence}.
    """

    def __init__(self, path: str | Path, map_path: Any, detectors: Any, start_s: float, user_detectors: Sequence[Any]):
        """Read the recording at `path` as the map at `map_path` has it; arguments and errors as of `diagnose`."""
        own = [part.DETECTOR.id for part in loaded(user_detectors)]
        check_start(start_s)
        m, self.text = load_map(map_path)
        self.scenario = with_detectors(_scenario(m, detectors, map_path), user_detectors)
        self.map, self.dt = signals_of.with_hinge(m), 1.0 / m.rate_hz
        factors = signals_of.factors(self.map, map_path, self.scenario)
        self.found = [d for d in table.chosen(self.scenario) if not detectors or d.id in (*detectors, *own)]
        self.wires = {(d.id, lane): d.inputs[lane] for d in self.found for lane in d.lanes}
        mapped = [s for s in self.map.signals.values() if s.channel]
        if not mapped:
            raise ReplayError("no signal has a channel", place=str(map_path),
                              remedy="Take the # from a line of [signals], or write one")  # fmt: skip
        names = dict.fromkeys(name for s in mapped for name in (s.channel, s.valid) if name)
        read = read_recording(path, tuple(names), m.time)
        self.notes = list(read.notes)
        told = self._make_ticks(path, {s.channel: read.times[read.channels[s.channel][0]] for s in mapped}, start_s)
        self.clock = f"clock: {read.clock}; {told}"
        self._sample(read, factors)

    def _make_ticks(self, path, used, start_s):
        """Set the ticks that the channels {name: times (rows,) [s]} have in common; return how they take samples."""
        dt, rate = self.dt, self.map.rate_hz
        self.at = signals_of.ticks(list(used.values()), dt, start_s or None)
        if not 2 <= len(self.at) <= MOST_TICKS:
            spans = ", ".join(f"{name} {t[0]:.12g} to {t[-1]:.12g} s" for name, t in list(used.items())[:6])
            said = f"the channels have {len(self.at)} ticks of {rate} Hz in common"
            raise ReplayError(said, place=str(path), allowed=f"2 to {MOST_TICKS}; {spans}", remedy=clock.UNSAID)
        between = "; between samples a sensor is interpolated and a command held"
        slower = any(clock.interval(t) > 1.01 * dt for t in used.values())
        return f"each tick ({rate} Hz) has the sample nearest to it, within {500 * dt:.3g} ms{between * slower}"

    def _sample(self, read, factors):
        """Set the values of the signals that the detectors read, of a Recording's channels."""
        sources = {w.signal.word: w.signal for own in self.wires.values() for w in own if w.signal.kind != "detector"}
        self.values: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        kept = {}
        for name, signal in ((n, s) for n, s in self.map.signals.items() if n in sources):
            if not signal.channel:
                value = np.nan if signal.absent else signal.constant
                self.values[name] = np.full(len(self.at), value), np.full(len(self.at), float(not signal.absent))
                continue
            where, y = read.channels[signal.channel]
            flags = read.channels.get(signal.valid or "")
            on = (read.times[flags[0]], flags[1]) if flags else None
            t, y = signals_of.samples(signal, read.times[where], y, on)
            self.values[name] = _on_ticks(signal, sources[name], factors[name], t, y, self.at, self.dt)
            kept[name] = t, read.times[where], self.values[name][1]
        self.notes += lost(kept)
        self.unsure = signals_of.unsure({n: t for n, (t, *_) in kept.items() if sources[n].kind == "sent"}, self.dt)


def _on_ticks(signal, source, factor, t, y, at, dt):
    """Return (values in SI, valid) on the ticks `at` of samples `y` of a channel at times `t`."""
    if source.kind == "sent" and not signal.held:
        t, y = signals_of.acting(t, y, dt)
    y = y if factor == 1.0 else factor * y
    y = y if signal.offset == 0.0 else y + signal.offset
    linear = (signal.resample or ("linear" if source.kind in ("sensor", "model") else "hold")) == "linear"
    turns = source.word in signals_of.TURNS
    return signals_of.resample(t, y, at, dt, linear=linear, max_gap=signal.max_gap_s, turns=turns)


def diagnose(
    path: str | Path, map_path: Any, *, detectors: Any = None, overrides: Mapping[str, Any] | None = None,
    start_s: float = 0.0, output: str | Path | None = None, user_detectors: Sequence[Any] = ()
) -> Diagnosis:  # fmt: skip
    """Run the detectors on the recording at `path` by the map at `map_path`; return a Diagnosis.

    `detectors` chooses some (default: all), `overrides` {detector: {parameter: value}} changes parameters, `start_s`
    is a time of the recording, `output` the log to write: inputs under /input, outputs under /replay; `user_detectors`
    are files of further detectors (cosim/parts). Raises ReplayError, LogError, ScenarioError, PartError.
    """
    chosen_overrides(detectors, overrides)
    made = Prepared(path, map_path, detectors, start_s, user_detectors)
    m = made.map
    out = Diagnosis(str(path), str(map_path), made.clock, m.rate_hz, float(made.at[0]), len(made.at) * made.dt,
                    output=str(output) if output else None)  # fmt: skip
    for name, (_, valid) in made.values.items():
        s, share = m.signals[name], 100.0 * float(valid.mean())
        unit = s.unit or signals_of.readable(made.scenario.aircraft)[name].unit
        out.signals.append({"name": name, "channel": s.channel, "unit": unit, "valid_pct": share})
    done, out.not_run = run_all(made, overrides or {})
    if not done:
        raise ReplayError("no detector has all its inputs", place=str(map_path), remedy=_nearest(out.not_run))
    out.detectors = [_verdict(d, lane, again, made) for d, lane, _, again in done]
    out.caveats = [*made.notes, *made.unsure.values(), *caveats(made, done)]
    if output:
        _write(output, done, out, made.text, made.dt)
    return out


def _nearest(not_run: list) -> str:
    """Return what the detector lacks that needs the fewest signals more."""
    best = min(not_run, key=lambda r: len(signals_of.in_map(r["missing"])))
    return f"Missing: {best['id']} of {best['target']}: {', '.join(signals_of.in_map(best['missing']))}"


def run_all(made: Prepared, overrides: Mapping[str, Any]) -> tuple[list, list]:
    """Return ([(detector, lane, inputs, outputs)] of the lanes whose inputs are complete, what the others lack)."""
    wires, n, dt, values = made.wires, len(made.at), made.dt, dict(made.values)
    read = {w.source.split(".")[0] for own in wires.values() for w in own if w.signal.kind == "detector"}
    done: list = []
    not_run: list = []
    for d in made.found:
        words = {lane: dict.fromkeys(w.signal.word for w in wires[d.id, lane]) for lane in d.lanes}
        spare = {w.source for lane in d.lanes for w in wires[d.id, lane] if d.record.may_lack}
        missing = {lane: [w for w in own if w not in values and w not in spare] for lane, own in words.items()}
        not_run += [{"id": d.id, "target": d.target(lane), "missing": lack} for lane, lack in missing.items() if lack]
        ready = replace(d, inputs={lane: own for lane, own in d.inputs.items() if not missing[lane]})
        if not ready.lanes:
            continue
        p = ready.params(made.scenario, dt)
        for i, lane in enumerate(ready.lanes):
            if words[lane].keys() & made.unsure.keys():
                for name, value in d.record.slow.items():
                    p[name][i] = value
            own_p, u = p[i : i + 1], lane_inputs(d.module, wires[d.id, lane], values, n)
            override(d.record, d.module, own_p, overrides.get(d.id, {}), dt)
            own = Lane(d.id, lane, d.record.level, d.record.every, d.module, own_p, d.module.init(own_p))
            steps = u[:, :: d.record.every]
            again = np.concatenate([own.step(steps[:, a : a + SPAN], dt)[0] for a in range(0, steps.shape[1], SPAN)])
            done.append((ready, lane, u, again))
            made.notes.extend(line for line in own.notes if line not in made.notes)
            if d.id in read:
                names = vocabulary.elements(d.module.STATE, d.module.OUTPUTS)
                outputs = zip(names, np.repeat(again, d.record.every, axis=0)[:n].T)
                values |= {f"{d.id}.{lane}.{name}": (y, np.ones(n)) for name, y in outputs}
    return done, not_run


def lane_inputs(module: Any, own: Sequence[Any], values: Mapping[str, Any], n: int) -> np.ndarray:
    """Return INPUTS (1, n) of one lane with Wires `own`; what has no flag of its own holds its last valid value."""
    read = []
    for w in (w for w in own if w.signal.kind != "detector" or w.signal.word in values):
        value, valid = values[w.signal.word]
        gaps = np.where(valid > 0.0, value, np.nan) if w.signal.flag else _held(value, valid)
        read.append((w.field, valid if w.flag else gaps))
    return inputs(module, n, read)


def _held(value, valid):
    """Return a command without gaps: the last valid value, before the first one that first one."""
    import pandas as pd

    return pd.Series(np.where(valid > 0.0, value, np.nan)).ffill().bfill().fillna(0.0).to_numpy()


def _scenario(m, chosen, place):
    """Return the Scenario of which the detectors take lanes and parameters; its tables are those of the map."""
    own = {"flight": m.flight, "elevator": m.elevator}
    own["detectors"] = {**m.detectors, **({"enabled": list(chosen)} if chosen else {})}
    tables = {"duration_s": 1.0, "rate_hz": m.rate_hz, **own}
    return parse(locate(tables, Path(place).parent, str(place)), place=str(place))


def _verdict(d, lane, again, made):
    """Return one row of the verdict table; times are the recording's."""
    names = [name for name, _ in elements(d.module.STATE, d.module.OUTPUTS)]
    judged = judged_lane(d.id, d.record.level, lane, d.module.ISOLABLE_PARTS, names)
    found = judge(judged, again, made.dt * d.record.every, [])
    at, valid = found["detected_at_s"], again[:, names.index("valid")] > 0.5
    return {
        **{name: found[name] for name in ("id", "level", "target", "alarm")},
        "alarms": found["false_alarms"],
        "first_alarm_s": None if at is None else at + float(made.at[0]),
        "isolated": found["isolated"],
        "r_max": found["r_max_before"],
        "valid_pct": 100.0 * float(valid.mean()),
        "alarm_pct": 100.0 * float((again[valid, names.index("alarm")] > 0.5).mean()) if valid.any() else 0.0,
    }


def _write(path, done, out, text, dt):
    """Write inputs and outputs of every lane that ran to a log."""
    infos, values = [], []
    for d, lane, u, again in done:
        read, module = flat(np.ascontiguousarray(u))[0], d.module
        for where, kind, names, rows, every in (
            ("/input", module.INPUTS, module.INPUTS.names, read, 1),
            ("/replay/detectors", module.STATE, module.OUTPUTS, again, d.record.every),
        ):
            fields, units = zip(*elements(kind, names))
            topic = Topic(f"{where}/{d.id}/{lane}", fields, units, every=every, channel=f"{where}/{d.id}")
            infos.append((topic.name, topic, "detectors"))
            values.append(rows)
    topics = stacked(infos)
    attachments = {"map.toml": ("application/toml", text.encode()), **viewer_layouts(topics)}
    metadata = {"run": {"title": f"diagnosis of {Path(out.recording).name}", "start_s": repr(out.start_s)}}
    kept: dict[str, Any] = {"metadata": metadata, "attachments": attachments, "rows_per_chunk": 500, "kept": False}
    with LogWriter(path, topics, n_values=topics[-1].index[-1] + 1, dt_ns=round(dt * 1e9), **kept) as log:
        append(log, topics, values, 0, len(values[0]))
        lacks = {f"{r['id']} of {r['target']}": f"lacks {', '.join(signals_of.in_map(r['missing']))}"
                 for r in out.not_run}  # fmt: skip
        told = {"detectors": out.detectors, "caveats": [out.clock, *out.caveats], "not_run": lacks}
        kept = {name: json.dumps(plain(found), sort_keys=True) for name, found in told.items()}
        log.close(result={"status": "diagnosed", **kept})
