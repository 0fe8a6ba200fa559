"""From channels of a recording to the signals that detectors read: names, units, samples on the ticks."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import did_you_mean
from cosim.flight.detection.detectors import wires
from cosim.replay import clock
from cosim.replay.log_schema import ReplayError
from cosim.replay.map_file import Signal as Mapped
from cosim.replay.units import factor
from cosim.scenario import Scenario
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.scenario.vocabulary import Signal, words
from fdi import registry

HINGE = ".hinge_moment"  # of a map: hm0, and hmd of zero
TURN = 2.0 * np.pi  # [rad]
TURNS = ("psi", "phi")  # angles that jump by a turn: between two samples they go the short way
NEAREST = 0.5  # of a tick: a sample that near to a tick is that tick's
LONE = 2.5  # ticks between two samples of which one is lost, not two
GAP = 3.0  # of a channel's own intervals that are bridged where the map does not say otherwise


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


def factors(m: Any, place: Any, scenario: Scenario) -> dict[str, float]:
    """Return {signal of the map: what its channel is multiplied with for SI}; raise ReplayError for one that no
    detector could read, a unit that does not fit it, or `held` at what is no command to an actuator."""
    known, segments, out = readable(scenario.aircraft), scenario.aircraft.segments, {}
    for name, signal in m.signals.items():
        at = f"{place}: signals.{name}"
        if name not in known:
            how = {"allowed": ", ".join(sorted(known)), "remedy": did_you_mean(name, known)}
            (segment, dot, word), said = name.rpartition("."), "no detector reads such a signal"
            if dot and word in words() and segment not in segments:
                said = f"the aircraft of the map has no elevator segment {segment!r}; its own are {', '.join(segments)}"
            raise ReplayError(said, place=at, **how)
        if signal.held and known[name].kind != "sent":
            raise ReplayError("only a command to an actuator is held", place=f"{at}.held", remedy="Leave it out")
        unit = known[name].unit
        one = factor(signal.unit or unit, unit, _shares(scenario, name, known[name]))
        if one is None:
            remedy = "Of a transducer: unit of the quantity, and scale how much of it one volt is"
            raise ReplayError(f"{signal.unit!r} is no unit of it", place=f"{at}.unit", allowed=f"units of {unit}",
                              remedy=remedy)  # fmt: skip
        out[name] = signal.sign * signal.scale * one
    return out


def _shares(scenario: Scenario, name: str, signal: Signal) -> dict[str, float]:
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


def readable(aircraft: Aircraft) -> dict[str, Signal]:
    """Return {name in a map: Signal} of what detectors read on an aircraft, in segments of the aircraft's own.

    A signal of the aircraft that none reads today may stand in a map, too: a map serves other detectors and versions.
    """
    out = {name: s for name, s in words().items() if s.kind in ("sensor", "command") and not s.technologies}
    for record in registry.records().values():
        for lane in aircraft.segments if record.level == "local" else ("",):
            out |= {w.signal.word: w.signal for w in wires(record, lane, aircraft=aircraft)}
    out = {name: s for name, s in out.items() if s.kind != "detector"}
    return {name: s for name, s in out.items() if not s.technologies or name.rpartition(".")[0] in aircraft.segments}


def samples(signal: Any, t: NDArray, y: NDArray, on: Any) -> tuple[NDArray, NDArray]:
    """Return (times, values) of a channel's samples: an empty cell, a number that stands for a lost sample and one that
    is not `on` ((times, flags) or None) are none, as a row that is missing is none."""
    good = np.isfinite(y) & (y != signal.missing)
    if on is not None:
        last = np.maximum(np.searchsorted(on[0], t, side="right") - 1, 0)
        good &= on[1][last] > 0.5
    return t[good], y[good]


def acting(t: NDArray, y: NDArray, dt: float) -> tuple[NDArray, NDArray]:
    """Return (times, values) of a command to an actuator, which acts from the tick after it is sent; the first one
    acts from the start."""
    return np.concatenate([t[:1], t + dt]), np.concatenate([y[:1], y])


def resample(
    t: NDArray, y: NDArray, at: NDArray, dt: float, *, linear: bool, max_gap: float | None = None, turns: bool = False
) -> tuple[NDArray, NDArray]:
    """Return (values, valid) of samples `y` at rising times `t` [s] on ticks `at` [s] that are `dt` apart.

    A tick has the sample nearest to it, where one lies within half a tick. Elsewhere the value is interpolated between
    its neighbours (`linear`; the short way of an angle [rad] that `turns`) or the last one is held. It is valid (1.0)
    where these are at most `max_gap` [s] apart, or the last one so old (default: three median intervals); elsewhere the
    value is NaN and the flag 0.0.
    """
    if not len(t):
        return np.full(len(at), np.nan), np.zeros(len(at))
    following = np.searchsorted(t, at)
    last, following = np.maximum(following - 1, 0), np.minimum(following, len(t) - 1)
    near = np.where(np.abs(t[following] - at) <= np.abs(at - t[last]), following, last)
    exact = np.abs(t[near] - at) <= NEAREST * dt
    gap = (GAP * clock.interval(t) if max_gap is None else max_gap) + 1e-3 * dt
    inside = (t[last] <= at) & ((at <= t[following]) if linear else True)
    width = t[following] - t[last]
    good = inside & ((width if linear else at - t[last]) <= gap)
    values = y[last]
    if linear:
        change = y[following] - y[last]
        change = change - TURN * np.round(change / TURN) if turns else change
        with np.errstate(invalid="ignore", divide="ignore"):
            values = values + np.where(width > 0.0, (at - t[last]) / width, 0.0) * change
    valid = exact | good
    return np.where(valid, np.where(exact, y[near], values), np.nan), valid.astype(float)


def ticks(times: Sequence[NDArray], dt: float, start: float | None = None) -> NDArray:
    """Return the ticks t_0 + k dt [s] that the samples at all `times` [s] cover, from `start` on; they stand where most
    samples of the channel that begins last do, not where its first one happens to."""
    last = max(times, key=lambda t: t[0])
    off = np.angle(np.exp(1j * TURN * (last - last[0]) / dt).mean()) / TURN  # [ticks]
    t_0, end = last[0] + dt * np.round(off, 3), min(t[-1] for t in times)
    if start is not None and start > t_0:
        t_0 += dt * np.ceil((start - t_0) / dt - 1e-3)
    return t_0 + dt * np.arange(max(0, int(np.floor((end - t_0) / dt + NEAREST)) + 1))


def unsure(times: Mapping[str, NDArray], dt: float) -> dict[str, str]:
    """Return {command to a valve or motor of which not every tick's is known: sentence} of the times of their samples:
    they come at less than the tick's rate, or two or more are lost in a row."""
    out = {}
    for name, t in times.items():
        step = clock.interval(t)
        if step > dt * 1.01:
            told = f"{name} comes at {1 / step:.4g} Hz and the tick is {1 / dt:g} Hz: it is read late by up to"
            out[name] = f"{told} {1e3 * step:.3g} ms, and a filter on it may alarm for that alone"
        elif len(t) > 1 and np.diff(t).max() > LONE * dt:
            out[name] = f"{name} has gaps: a filter on it does not know what was sent there, and sees less for it"
    return out
