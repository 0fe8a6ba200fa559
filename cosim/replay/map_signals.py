"""From channels of a recording to the signals that detectors read: names, units, samples on the ticks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import did_you_mean
from cosim.flight.detection.detectors import wires
from cosim.replay.map_file import Signal as Mapped
from cosim.replay.params import ReplayError
from cosim.replay.resample import resample
from cosim.replay.units import PER, bare, factors
from cosim.scenario import Scenario
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.scenario.vocabulary import Signal, words
from fdi import registry

HINGE = ".hinge_moment"  # of a map: hm0, and hmd of zero


def renamed(m: Any, technology: dict) -> tuple[Any, ...]:
    """Return (map, sentences) with signals that it calls by an old name under those of the vocabulary."""
    names, said = {}, []
    for name in m.signals:
        segment, dot, word = name.rpartition(".")
        own = TECHNOLOGIES.get(technology.get(segment, ""))
        now = own.sent[0] if own and dot and word == "u" else ""
        names[name] = f"{segment}.{now}" if now else name
        if now:
            said.append(f"signals.{name} is now called {segment}.{now}")
    signals = {names[n]: s for n, s in m.signals.items()}
    for name in [n for n in signals if n.endswith(HINGE)]:  # hm(delta) = hm0 + hmd delta
        lane = name.removesuffix(HINGE)
        both = [n for n in (f"{lane}.hm0", f"{lane}.hmd") if n in signals]
        if both:
            raise ReplayError(f"stands beside {both[0]}", place=f"signals.{name}", remedy="Give one of the two")
        signals |= {f"{lane}.hm0": signals.pop(name), f"{lane}.hmd": Mapped(constant=0.0)}
    return m.model_copy(update={"signals": signals}), said


def shares(scenario: Scenario, name: str, signal: Signal) -> dict[str, float]:
    """Return {SI unit: what one of it is of a signal}: a pressure by the supply's, a rod's load by its lever arm."""
    lane, dot, word = name.rpartition(".")
    if not dot:
        return {}
    technology = scenario.elevator.technology[lane]
    believed = scenario.elevator.parameters[lane].model if lane in scenario.elevator.parameters else {}
    own = TECHNOLOGIES[technology]
    design = own.design(tuple({**dict(scenario.aircraft.own(technology)), **believed}.items()))
    if word in own.sensors and signal.unit == "-":
        return {unit: share for unit, share in design.shares.items() if not unit.startswith("of ")}
    return {"N": design.arm} if word == "hm0" else {}


def check(m: Any, place: Any, scenario: Scenario) -> None:
    """Raise ReplayError for a signal of the map that no detector could read, or a unit that does not fit it."""
    known, segments = readable(scenario.aircraft), scenario.aircraft.segments
    for name, signal in m.signals.items():
        if name not in known:
            raise ReplayError(
                _unread(name, segments),
                place=f"{place}: signals.{name}",
                allowed=", ".join(sorted(known)),
                remedy=did_you_mean(name, known),
            )
        allowed = factors(known[name].unit, shares(scenario, name, known[name]))
        if signal.unit is not None and bare(signal.unit) not in allowed:
            per = f"A transducer's channel: unit = '{next(iter(allowed))}{PER[0]}' with scale"
            raise ReplayError(
                f"{signal.unit!r} is no unit of it", place=f"{place}: signals.{name}.unit", allowed=", ".join(allowed),
                remedy=per if signal.unit in ("V", "mV", "mA") else "",
            )  # fmt: skip


def readable(aircraft: Aircraft) -> dict[str, Signal]:
    """Return {name in a map: Signal} of what some detector reads on an aircraft, in segments of the aircraft's own."""
    out: dict[str, Signal] = {}
    for record in registry.records().values():
        for lane in aircraft.segments if record.level == "local" else ("",):
            out |= {w.signal.word: w.signal for w in wires(record, lane, aircraft=aircraft)}
    out = {name: s for name, s in out.items() if s.kind != "detector"}
    return {name: s for name, s in out.items() if not s.technologies or name.rpartition(".")[0] in aircraft.segments}


def _unread(name, segments):
    """Return why no detector reads the signal `name`."""
    segment, dot, word = name.rpartition(".")
    if dot and word in words() and segment not in segments:
        return f"the aircraft of the map has no elevator segment {segment!r}; its own are {', '.join(segments)}"
    return "no detector reads such a signal"


def named(topic: str, channels: Sequence[Any]) -> bool:
    """Tell whether one of `channels`, names of the map, may be a field of `topic`: `/topic.field`, or `field` alone."""
    return any(name.startswith(f"{topic}.") or not name.startswith("/") for name in channels)


def channels_of(m: Any, tables: dict, path: str | Path, place: Any) -> dict:
    """Return {signal: (times, samples, flags or None)} of the recording."""
    names = {f"{t}.{c}": (t, c) for t, frame in tables.items() for c in frame.columns}
    short = {c: (t, c) for t, frame in tables.items() for c in frame.columns}
    doubled = {c for c in short if sum(c in frame.columns for frame in tables.values()) > 1}
    names |= {c: at for c, at in short.items() if c not in doubled}

    def column(key, name):
        if name not in names and any(name in frame.attrs.get("texts", ()) for frame in tables.values()):
            raise ReplayError(
                f"channel {name!r} holds something that is no number",
                place=f"{place}: signals.{key}",
                remedy="An empty cell or NaN is a lost sample",
            )
        if name not in names:
            raise ReplayError(
                f"the recording has no channel {name!r}",
                place=f"{place}: signals.{key}",
                allowed=", ".join([n for n in names if len(tables) > 1 or n in short][:20]),
                remedy=did_you_mean(name, names),
            )
        t, c = names[name]
        return tables[t].index.to_numpy(), tables[t][c].to_numpy(np.float64)

    out = {}
    for key, signal in m.signals.items():
        if signal.channel is None:
            continue
        t, y = column(key, signal.channel)
        if signal.sparse:
            t, y = t[np.isfinite(y)], y[np.isfinite(y)]
        out[key] = (t, y, column(key, signal.valid) if signal.valid else None)
    return out


def acting(m: Any, sources: dict, channels: dict, dt: float) -> dict:
    """Return `channels` with each command to an actuator as what has acted until a time: sent a tick before, the first
    one from the start; but where the map says that it is held.

    Raises ReplayError for `held` at another signal.
    """
    sent = {name for name, source in sources.items() if source.kind == "sent"}
    for name, signal in m.signals.items():
        if signal.held and name not in sent:
            raise ReplayError(
                "only a command to an actuator is held", place=f"signals.{name}.held", allowed=", ".join(sorted(sent))
            )
    out = dict(channels)
    for name in sent & channels.keys():
        if not m.signals[name].held:
            t, y, flags = channels[name]
            out[name] = *_later(t, y, dt), flags and _later(flags[0], flags[1], dt)
    return out


def _later(t, y, dt):
    return np.concatenate([t[:1], t + dt]), np.concatenate([y[:1], y])


def slow(sources: dict, channels: dict, dt: float) -> list[str]:
    """Return a sentence per command of a valve or motor that is sampled at less than the tick's rate."""
    out = []
    for name, source in sources.items():
        t = channels[name][0] if name in channels and source.kind == "sent" else ()
        step = float(np.median(np.diff(t))) if len(t) > 2 else 0.0
        if step > dt * 1.01:
            out.append(
                f"{name} comes at {1 / step:.4g} Hz and the tick is {1 / dt:g} Hz: the detectors read it late by up to "
                f"{1e3 * step:.3g} ms, and a filter on it may alarm for that alone; it wants the rate at which it was "
                "sent"
            )
    return out


def sampled(
    signal: Any, source: Any, channel: Any, t_0: float, dt: float, n: int, shares: Any = None
) -> tuple[Any, ...]:
    """Return (values, valid) (n,) of one signal of the map in SI; `source` is that of the vocabulary."""
    if signal.absent:
        return np.full(n, np.nan), np.zeros(n)
    if channel is None:
        return np.full(n, signal.constant), np.ones(n)
    t, y, flags = channel
    factor = 1.0 if signal.derivative_of or signal.path_of else signal.factor(source.unit, shares)
    y = y if factor == 1.0 else factor * y
    y = y if signal.offset == 0.0 else y + signal.offset
    linear = (signal.resample or ("linear" if source.kind in ("sensor", "model") else "hold")) == "linear"
    values, valid = resample(t, y, t_0, dt, n, linear=linear, max_gap=signal.max_gap_s)
    if flags is not None:
        on, there = resample(flags[0], flags[1], t_0, dt, n, linear=False)
        valid = valid * ((on > 0.5) & (there > 0.0))
        values = np.where(valid > 0.0, values, np.nan)
    return values, valid
