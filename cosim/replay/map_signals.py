"""From channels of a recording to the signals that detectors read: names, units, derived signals, samples on the ticks.

Signals that no channel holds are made from those that the map has:

    hdot = { derivative_of = "h_baro" }
    alpha_ground = { path_of = "theta" }     # theta less the angle of the path, by hdot, tas and phi
    tas = { speed_of = "cas" }               # or "mach": with h_baro, in the standard atmosphere

A rate is the central difference of the channel's own samples: late by nothing, and noisier than a measurement. The
angle solves hdot / V = sin(theta) cos(alpha) - cos(theta) cos(phi) sin(alpha), without sideslip; V is the airspeed, so
that the wind is in it. All are proxies, and the report says so.
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import did_you_mean
from cosim.flight.detection.detectors import wires
from cosim.replay import clock
from cosim.replay.log_schema import ReplayError
from cosim.replay.map_file import Signal as Mapped
from cosim.replay.map_physics import airspeed
from cosim.replay.units import PER, bare, factors
from cosim.scenario import Scenario
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.scenario.vocabulary import Signal, find, words
from fdi import registry

HINGE = ".hinge_moment"  # of a map: hm0, and hmd of zero
TURN = 2.0 * np.pi  # [rad]
TURNS = ("psi", "phi")  # angles that jump by a turn: between two samples they go the short way
STEPS = 2  # of a channel's own samples on either side of a derivative
SNAP = 1e-3  # of a tick: a sample that near to a tick lies on it, so that rounded times lose nothing


def with_hinge(m: Any) -> Any:
    """Return the map with a hinge moment of its as the model that detectors read, hm(delta) = hm0 + hmd delta."""
    signals = dict(m.signals)
    for name in [n for n in signals if n.endswith(HINGE)]:
        lane = name.removesuffix(HINGE)
        both = [n for n in (f"{lane}.hm0", f"{lane}.hmd") if n in signals]
        if both:
            raise ReplayError(f"stands beside {both[0]}", place=f"signals.{name}", remedy="Give one of the two")
        signals |= {f"{lane}.hm0": signals.pop(name), f"{lane}.hmd": Mapped(constant=0.0)}
    return m.model_copy(update={"signals": signals})


def in_map(words: Sequence[str]) -> list[str]:
    """Return the signals that a map may give for those that detectors read: `hinge_moment` for hm0 and hmd."""
    return list(dict.fromkeys(re.sub(r"\.(hm0|hmd)$", HINGE, word) for word in words))


def shares(scenario: Scenario, name: str, signal: Signal) -> dict[str, float]:
    """Return {SI unit: what one of it is of a signal}: a pressure by the supply's, a rod's load by its lever arm."""
    lane, _, word = name.rpartition(".")
    if not lane:
        return {}
    technology, parameters = scenario.elevator.technology[lane], scenario.elevator.parameters
    believed = parameters[lane].model if lane in parameters else {}
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
            how = {"allowed": ", ".join(sorted(known)), "remedy": did_you_mean(name, known)}
            (segment, dot, word), said = name.rpartition("."), "no detector reads such a signal"
            if dot and word in words() and segment not in segments:
                said = f"the aircraft of the map has no elevator segment {segment!r}; its own are {', '.join(segments)}"
            raise ReplayError(said, place=f"{place}: signals.{name}", **how)
        allowed = factors(known[name].unit, shares(scenario, name, known[name]))
        if signal.unit is not None and bare(signal.unit) not in allowed:
            per = f"A transducer's channel: unit = '{next(iter(allowed))}{PER[0]}' with scale"
            where = {"place": f"{place}: signals.{name}.unit", "allowed": ", ".join(allowed)}
            remedy = per if signal.unit in ("V", "mV", "mA") else ""
            raise ReplayError(f"{signal.unit!r} is no unit of it", **where, remedy=remedy)


def readable(aircraft: Aircraft) -> dict[str, Signal]:
    """Return {name in a map: Signal} of what some detector reads on an aircraft, in segments of the aircraft's own."""
    out: dict[str, Signal] = {}
    for record in registry.records().values():
        for lane in aircraft.segments if record.level == "local" else ("",):
            out |= {w.signal.word: w.signal for w in wires(record, lane, aircraft=aircraft)}
    out = {name: s for name, s in out.items() if s.kind != "detector"}
    return {name: s for name, s in out.items() if not s.technologies or name.rpartition(".")[0] in aircraft.segments}


def named(topic: str, channels: Sequence[Any]) -> bool:
    """Tell whether one of `channels`, names of the map, may be a field of `topic`: `/topic.field`, or `field` alone."""
    return any(name.startswith(f"{topic}.") or not name.startswith("/") for name in channels)


def channels_of(m: Any, tables: dict, path: str | Path, place: Any) -> dict:
    """Return {signal: (times, samples, flags or None)} of the recording."""
    pairs = [(t, c) for t, frame in tables.items() for c in frame.columns]
    short, often = {c: (t, c) for t, c in pairs}, Counter(c for _, c in pairs)
    names = {f"{t}.{c}": (t, c) for t, c in pairs} | {c: at for c, at in short.items() if often[c] == 1}

    def column(key, name):
        at = f"{place}: signals.{key}"
        texts = {c: word for frame in tables.values() for c, word in frame.attrs.get("texts", {}).items()}
        if name not in names and name in texts:
            what = f"channel {name!r} holds something that is no number{texts[name]}"
            raise ReplayError(what, place=at, remedy="An empty cell or NaN is a lost sample")
        if name not in names:
            allowed = ", ".join([n for n in names if len(tables) > 1 or n in short][:20])
            what = f"the recording has no channel {name!r}"
            raise ReplayError(what, place=at, allowed=allowed, remedy=did_you_mean(name, names))
        t, c = names[name]
        return tables[t].index.to_numpy(), tables[t][c].to_numpy(np.float64)

    out = {}
    for key, signal in m.signals.items():
        if signal.channel is None:
            continue
        t, y = column(key, signal.channel)
        y = y if signal.missing is None else np.where(y == signal.missing, np.nan, y)
        if signal.sparse:
            t, y = t[np.isfinite(y)], y[np.isfinite(y)]
        out[key] = (t, y, column(key, signal.valid) if signal.valid else None)
    return out


def derived(m: Any, channels: dict, place: Any) -> dict:
    """Return `channels` {signal: (times, samples, flags)} with the derived signals of the map, in SI.

    Raises ReplayError where a signal that one is made from has no channel.
    """
    out = dict(channels)
    for name, s in m.signals.items():
        if s.derivative_of:
            t, y = _si(m, out, name, s.derivative_of, place)
            out[name] = t, _rate(t, y, s.derivative_of in TURNS), None
    for name, s in m.signals.items():
        if s.speed_of:
            t, y = _si(m, out, name, s.speed_of, place)
            h = np.interp(t, *_si(m, out, name, "h_baro", place))
            out[name] = t, airspeed(h, **{s.speed_of: y}), None
    for name in [name for name, s in m.signals.items() if s.path_of]:
        out[name] = *_path(m, out, name, place), None
    return out


def _si(m, channels, name, base, place):
    """Return (times, samples in SI) of the signal `base`, from which `name` is made."""
    if base not in channels:
        what, allowed = f"{name} is made from {base}, which has no channel", ", ".join(sorted(channels))
        raise ReplayError(what, place=f"{place}: signals.{name}", allowed=allowed)
    t, y, flags = channels[base]
    if m.signals[base].derivative_of is None:  # a derived one is in SI already
        y = m.signals[base].factor(find(base).unit) * y + m.signals[base].offset
    if flags is not None:
        y = np.where(np.interp(t, flags[0], flags[1]) > 0.5, y, np.nan)
    return t, y


def _rate(t, y, turns):
    """Return the central difference of y over 2 STEPS samples; NaN at the ends."""
    out = np.full(len(y), np.nan)
    width = t[2 * STEPS :] - t[: -2 * STEPS]
    with np.errstate(divide="ignore", invalid="ignore"):
        out[STEPS:-STEPS] = np.where(width > 0.0, _change(y[: -2 * STEPS], y[2 * STEPS :], turns) / width, np.nan)
    return out


def _change(before, after, turns):
    """Return after - before, of an angle that `turns` the short way [rad]."""
    change = after - before
    return change - TURN * np.round(change / TURN) if turns else change


def _path(m, channels, name, place):
    """Return (times, theta less the angle of the path) at the times of theta."""
    t, theta = _si(m, channels, name, "theta", place)
    climb, speed = (np.interp(t, *_si(m, channels, name, n, place)) for n in ("hdot", "tas"))
    phi = np.interp(t, *_si(m, channels, name, "phi", place)) if "phi" in channels else np.zeros(len(t))
    up, across = np.sin(theta), np.cos(theta) * np.cos(phi)
    size = np.hypot(up, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = climb / (speed * size)
        alpha = np.arccos(share) - np.arctan2(across, up)
    return t, np.where((speed > 1.0) & (np.abs(share) < 1.0), alpha, np.nan)


def acting(m: Any, sources: dict, channels: dict, dt: float) -> dict:
    """Return `channels` with each command to an actuator as what has acted until a time: sent a tick before, the first
    one from the start; but where the map says that it is held.

    Raises ReplayError for `held` at another signal.
    """
    sent = {name for name, source in sources.items() if source.kind == "sent"}
    for name, signal in m.signals.items():
        if signal.held and name not in sent:
            allowed = ", ".join(sorted(sent))
            raise ReplayError("only a command to an actuator is held", place=f"signals.{name}.held", allowed=allowed)
    out = dict(channels)
    for name in sent & channels.keys():
        if not m.signals[name].held:
            t, y, flags = channels[name]
            out[name] = *_later(t, y, dt), flags and _later(flags[0], flags[1], dt)
    return out


def _later(t, y, dt):
    return np.concatenate([t[:1], t + dt]), np.concatenate([y[:1], y])


def slow(sources: dict, channels: dict, dt: float) -> dict[str, str]:
    """Return {command of a valve or motor that is sampled at less than the tick's rate: sentence}."""
    out = {}
    for name, source in sources.items():
        step = clock.interval(channels[name][0]) if name in channels and source.kind == "sent" else 0.0
        if step > dt * 1.01:
            told = f"{name} comes at {1 / step:.4g} Hz and the tick is {1 / dt:g} Hz: the detectors read it late by"
            more = "a filter on it may alarm for that alone; it wants the rate at which it was sent"
            out[name] = f"{told} up to {1e3 * step:.3g} ms, and {more}"
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
    factor = 1.0 if signal.made else signal.factor(source.unit, shares)
    y = y if factor == 1.0 else factor * y
    y = y if signal.offset == 0.0 else y + signal.offset
    linear = (signal.resample or ("linear" if source.kind in ("sensor", "model") else "hold")) == "linear"
    how = {"linear": linear, "max_gap": signal.max_gap_s, "turns": source.word in TURNS}
    values, valid = resample(t, y, t_0, dt, n, **how)
    if flags is not None:
        on, there = resample(flags[0], flags[1], t_0, dt, n, linear=False)
        valid = valid * ((on > 0.5) & (there > 0.0))
        values = np.where(valid > 0.0, values, np.nan)
    return values, valid


def ticks(spans: Any, dt: float, start: float | None = None) -> tuple[Any, ...]:
    """Return (t_0, n): the n ticks t_0 + k dt that all `spans` [(first, last)] [s] cover, from `start` on."""
    t_0, end = max(a for a, _ in spans), min(b for _, b in spans)
    if start is not None and start > t_0:
        t_0 += dt * np.ceil((start - t_0) / dt - SNAP)
    return t_0, max(0, int(np.floor((end - t_0) / dt + SNAP)) + 1)


def resample(
    t: np.ndarray, y: np.ndarray, t_0: Any, dt: float, n: Any, *, linear: bool, max_gap: Any = None, turns: bool = False
) -> Any:
    """Return (values, valid) (n,) of samples `y` at ascending times `t` [s] on the ticks t_0 + k dt.

    A sample within SNAP of a tick is taken as it is. Elsewhere the value is interpolated between its neighbours
    (`linear`; the short way of an angle [rad] that `turns`) or the last one is held. It is valid (1.0) where the
    samples used are finite and their distance, or for a held one its age, is at most `max_gap` [s] (default: three
    median intervals); elsewhere the value is NaN and the flag 0.0.
    """
    at = t_0 + np.arange(n) * dt
    near = SNAP * dt
    last = np.searchsorted(t, at + near, side="right") - 1  # newest sample not after the tick
    following = np.minimum(last + 1, len(t) - 1)
    held = np.maximum(last, 0)
    exact = (last >= 0) & (np.abs(t[held] - at) <= near)
    if max_gap is None:
        max_gap = 3.0 * float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if linear:
        width = t[following] - t[held]
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(width > 0.0, (at - t[held]) / width, 0.0)
            values = y[held] + share * _change(y[held], y[following], turns)
        good = (last >= 0) & (last + 1 < len(t)) & (width <= max_gap + near)
    else:
        values = y[held]
        good = (last >= 0) & (at - t[held] <= max_gap + near)
    values = np.where(exact, y[held], values)
    good = (exact | good) & np.isfinite(values)
    return np.where(good, values, np.nan), good.astype(float)
