"""Replay of detector lanes: inputs, states and outputs from a log, run again through the same `rollout`.

Measurements and commands stand in the log at every tick, parameters and initial states as attachments, whole states
every second. Ticks that a damaged log has lost cut a lane into pieces; a piece that does not begin with the flight
starts at its first whole state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from actuators.block import Entry, unit
from cosim.errors import LogError, did_you_mean
from cosim.flight.detection.parameters import wrong_state
from cosim.flight.plugins.plain import PlainDetector
from cosim.log import Log
from cosim.replay import log_schema
from cosim.replay.params import LayoutError, ReplayError, attached, chosen_overrides, older, override, trusted
from fdi import registry

BLOCK_BYTES = 1 << 18  # of full states at once: they stay in the processor's cache
NONE: tuple = (np.empty(0, np.int64), np.empty((0, 0)))  # no whole states, nothing logged


@dataclass
class Lane:
    """A stretch of one detector lane: its inputs, parameters, the state before tick `at`, and what was logged."""

    id: str
    lane: str
    module: object
    every: int
    p: np.ndarray
    x: np.ndarray
    at: int
    u: np.ndarray  # (1, rows)
    ticks: np.ndarray  # of the rows
    logged: np.ndarray  # (rows, outputs)
    states: tuple  # (ticks, values) of the hidden state's snapshots
    rollout: object = None  # of a guest with objects of its own


def unlogged(name: str, lane: str, module: Any, every: int, u: np.ndarray, p: np.ndarray, rollout: Any = None) -> Lane:
    """Return the Lane of a detector on inputs u (1, ticks) that no log holds, from the first tick on."""
    ticks = np.arange(u.shape[1])[::every]
    return Lane(name, lane, module, every, p, module.init(p), 0, u[:, ::every], ticks, NONE[1], NONE, rollout)


def manifest(log: Log) -> list:
    """Return the list of detectors that a log describes."""
    found = log_schema.detectors(log)
    strange = [d["id"] for d in found if d["id"] not in registry.SHIPPED and "guest" not in d]
    if strange:
        raise older(log, f"detector {strange[0]!r}")
    return found


@dataclass
class Wired:
    """One detector lane as a log describes it: parameters, inputs, and the state with which tick `at` begins."""

    id: str
    lane: str
    level: str
    module: object
    every: int
    p: np.ndarray
    x: np.ndarray
    inputs: list  # (input field, topic, field of the topic)
    at: int = 0
    rollout: object = None  # of a guest with objects of its own

    @property
    def topic(self) -> str:
        """Return the topic of the outputs."""
        return f"/detectors/{self.id}/{self.lane}"

    @property
    def hidden(self) -> str:
        """Return the topic of the hidden state's snapshots."""
        return f"/state/{self.id}/{self.lane}"

    @property
    def target(self) -> str:
        """Return the name of what the lane watches."""
        return f"elevator.{self.lane}" if self.level == "local" else "aircraft"


def tick_of(log: Log) -> Any:
    """Return the tick of a log's flight [s]: 1 / rate, which whole nanoseconds are only near to at 333 Hz."""
    rate = log.metadata.get("run", {}).get("rate_hz", "")
    whole = log.dt_ns * 1e-9
    hertz = int(rate) if rate.isdecimal() and len(rate) < 6 else 0
    return 1.0 / hertz if hertz and round(1e9 / hertz) == log.dt_ns else whole


def describe(
    log: Log, chosen: Any = None, overrides: Mapping[str, Any] | None = None, left_out: dict[str, str] | None = None
) -> list[Wired]:
    """Return the Wired lanes of the detectors in `chosen` (all) whose code is here.

    `overrides` is {detector: {parameter: value}}. `left_out` takes {detector: why} of those whose layout is another
    one in the log than here, where some of the log's can be replayed and none is chosen; else they raise LayoutError.
    """
    found = manifest(log)
    if log.metadata.get("run", {}).get("log_profile") == "signals":
        remedy = "Fly it again with log_profile = 'full' or 'replay'"
        raise ReplayError("holds signals alone, not what detectors read", place=str(log.path), remedy=remedy)
    known = [d["id"] for d in found]
    if chosen is not None and not chosen:
        raise ReplayError("no detector is named", place="--detectors", allowed=", ".join(known))
    for name in [*(chosen or ()), *(overrides or {})]:
        if name not in known:
            raise ReplayError(
                f"the log has no detector {name!r}",
                place=str(log.path),
                allowed=", ".join(known) or "none",
                remedy=did_you_mean(name, known),
            )
    chosen_overrides(chosen, overrides)
    out, first = [], None
    for d in (d for d in found if (not chosen or d["id"] in chosen) and registry.known(d["id"])):
        try:
            out += _wired(log, d, (overrides or {}).get(d["id"], {}))
        except LayoutError as error:
            if left_out is None or chosen or d["id"] in (overrides or {}):
                raise
            left_out[d["id"]], first = error.problem, first or error
    if first and not out:
        raise first
    return out


def _wired(log, d, changes):
    """Return the Wired lanes of one detector, its parameters with `changes`."""
    record, module = registry.record(d["id"]), registry.module(d["id"])
    p = attached(log, f"{d['id']}.params", module.PARAMS, len(d["lanes"]))
    x = attached(log, f"{d['id']}.initial", module.STATE, len(d["lanes"]))
    trusted(log, record, module, p, x, tick_of(log))
    override(record, module, p, changes, tick_of(log))
    out = []
    for i, lane in enumerate(d["lanes"]):
        row = slice(i, i + 1)
        own = module.runner() if isinstance(module, PlainDetector) else None
        wired = Wired(d["id"], lane, d["level"], module, d["every"], p[row], x[row], d["inputs"][lane], rollout=own)
        _check(log, wired)
        out.append(wired)
    return out


def _check(log, wired):
    """Raise LogError unless the log's topics are those of this version of the detector."""
    topic, (outputs, hidden) = wired.topic, split(wired.module)
    if topic not in log.topics:
        raise LogError(f"the log lacks {topic}, which its detectors.json names", place=str(log.path))
    if len(outputs) != len(log.topics[topic].fields):
        raise older(log, topic)
    if len(hidden) != (len(log.topics[wired.hidden].fields) if wired.hidden in log.topics else 0):
        raise older(log, wired.hidden)
    for name, source, column in wired.inputs:
        there = source in log.topics and column in log.topics[source].fields
        if not there or name.partition("[")[0] not in wired.module.INPUTS.names:
            raise older(log, f"{source}.{column}, which {wired.id} reads as {name},")


def in_stages(wired: Sequence[Wired], place: str = "") -> list[list[int]]:
    """Return the positions of lanes, those of a stage reading outputs of earlier stages only.

    Raises LogError where lanes of a log wait for each other, which no flight allows.
    """
    topics = {w.topic for w in wired}
    left = {i: topics & {source for _, source, _ in w.inputs} for i, w in enumerate(wired)}
    out: list[list[int]] = []
    while left:
        waiting = {wired[i].topic for i in left}
        stage = [i for i, reads in left.items() if not reads & waiting]
        if not stage:
            raise LogError("is damaged: detectors wait for each other", place=f"{place}: detectors.json")
        out.append(stage)
        left = {i: reads for i, reads in left.items() if i not in stage}
    return out


def topics(log: Log, wired: Any) -> list[Any]:
    """Return the topics that the lanes read or gave."""
    found = [t for w in wired for t in (w.topic, w.hidden, *(source for _, source, _ in w.inputs))]
    return [t for t in dict.fromkeys(found) if t in log.topics]


def fill(log: Log, wired: Any, start: float = 0, stop: Any = None, read: dict | None = None) -> list[Lane]:
    """Return the Lane of each of `wired` for the ticks start <= k < stop; `read` is what log.arrays gave for them."""
    read = log.arrays(topics(log, wired), start, stop) if read is None else read
    return [_fill(log, w, read, start, stop) for w in wired]


def _fill(log, w, read, start, stop):
    ticks = log.ticks(w.topic, start, stop)
    u = np.zeros((1, len(ticks)), w.module.INPUTS)
    for name, source, own in w.inputs:
        same = log.topics[source].every == w.every
        rows = slice(None) if same else np.searchsorted(log.ticks(source, start, stop), ticks)
        field_of(u, name)[:] = read[source][rows, log.topics[source].fields.index(own)]
    held = w.hidden in log.topics
    states = (log.ticks(w.hidden, start, stop), read[w.hidden]) if held else NONE
    return Lane(w.id, w.lane, w.module, w.every, w.p, w.x, w.at, u, ticks, read[w.topic], states, w.rollout)


def field_of(u: np.ndarray, name: str) -> np.ndarray:
    """Return the view (rows,) of a field of records u (1, rows), or of an element of one, `name[i]`."""
    base, _, element = name.partition("[")
    return u[base][0][:, int(element[:-1])] if element else u[base][0]


def columns(kind: Any, names: Sequence[Any]) -> np.ndarray:
    """Return the positions of fields `names` in a record of `kind` seen as float64, in memory order."""
    out: list = []
    for name in kind.names:
        if name in names:
            sub, offset = kind.fields[name][:2]
            out += range(offset // 8, offset // 8 + sub.itemsize // 8)
    return np.array(out, np.int64)


def elements(kind: Any, names: Sequence[str]) -> list[tuple[str, str]]:
    """Return [(field of a log, unit)] of the elements of fields `names` of a record, in memory order."""
    out: list[tuple[str, str]] = []
    for name in (n for n in kind.names if n in names):
        count = kind[name].itemsize // 8
        out += [(name if kind[name].shape == () else f"{name}_{i}", unit(kind, name)) for i in range(count)]
    return out


def output_names(d: Any) -> list[str]:
    """Return the names of a detector's outputs as they stand in its rows."""
    return [name for name, _ in elements(d.module.STATE, d.module.OUTPUTS)]


@lru_cache(maxsize=64)
def split(module: Any) -> tuple:
    """Return the positions of a detector's (outputs, hidden state) in its STATE."""
    outputs = columns(module.STATE, module.OUTPUTS)
    return outputs, np.setdiff1d(np.arange(module.STATE.itemsize // 8), outputs)


def flat(records: np.ndarray) -> np.ndarray:
    """Return records as float64, (..., values)."""
    return records.view(np.float64).reshape(*records.shape, -1)


def pieces(lane: Lane, tick: Any = 0) -> list:
    """Return the stretches of a lane that can be replayed, each a Lane of its own with the state to start from.

    The rows are cut where ticks are missing. A stretch that begins at tick `at` starts from the lane's own state,
    unless `tick` lies inside and a whole state before it: then after that one. Any other starts after its first
    whole state; rows before are left out.
    """
    cuts = np.flatnonzero(np.diff(lane.ticks) != lane.every) + 1
    ends = [0, *cuts.tolist(), len(lane.ticks)]
    found = (_piece(lane, a, b, tick) for a, b in pairwise(ends) if a < b and lane.ticks[b - 1] >= tick)
    return [p for p in found if p is not None and len(p.ticks)]


def _piece(lane, a, b, tick):
    first, last = lane.ticks[a], lane.ticks[b - 1]
    whole = lane.states[0][(lane.states[0] >= first) & (lane.states[0] <= last)]
    before = whole[whole <= tick]
    if first == lane.at and (tick <= first or not len(before)):
        return replace(lane, u=lane.u[:, a:b], ticks=lane.ticks[a:b], logged=lane.logged[a:b])
    if not len(whole):
        return None
    k = before[-1] if len(before) else whole[0]
    row = int(np.searchsorted(lane.ticks, k))
    x, (outputs, hidden) = np.zeros(1, lane.module.STATE), split(lane.module)
    flat(x)[0, outputs] = lane.logged[row]
    flat(x)[0, hidden] = lane.states[1][np.searchsorted(lane.states[0], k)]
    if wrong := wrong_state(registry.record(lane.id), lane.module, x):
        raise LogError(
            f"{wrong[0]} = {wrong[1]:g} would reach beyond the detector's arrays",
            place=f"/state/{lane.id}/{lane.lane}, tick {k}",
            allowed=f"{wrong[2]:g} to {wrong[3]:g}",
            remedy="`cosim run` did not write this",
        )
    rows = slice(row + 1, b)
    return replace(
        lane, x=x, at=int(k) + lane.every, u=lane.u[:, rows], ticks=lane.ticks[rows], logged=lane.logged[rows]
    )


def stepper(module: Any) -> Any:
    """Return what steps a lane of a detector through its ticks: of a plain guest, with objects of its own."""
    return module.runner() if isinstance(module, PlainDetector) else module.rollout


def replay_lane(lane: Any, dt: float) -> Any:
    """Replay one gapless lane; return outputs (rows, n), snapshots (ticks (m,), hidden states (m, h)), last state."""
    module, n = lane.module, len(lane.ticks)
    outputs, hidden = split(module)
    rollout, x, p = lane.rollout or stepper(module), lane.x.copy(), lane.p.copy()
    first, last = lane.ticks[[0, -1]] if n else (0, -1)
    wanted = lane.states[0]
    wanted = wanted[(wanted >= first) & (wanted <= last) & ((wanted - first) % lane.every == 0)]
    at = np.searchsorted(lane.ticks, wanted)
    if isinstance(rollout, Entry):
        out, held = rollout.sweep(x, lane.u, p, dt * lane.every, outputs, at, hidden)
        return out, (wanted, held), x
    out, held, done = np.empty((n, len(outputs))), np.empty((len(wanted), len(hidden))), 0
    given = flat(np.ascontiguousarray(lane.u))
    block = max(1, min(n, BLOCK_BYTES // module.STATE.itemsize))
    u, states = np.zeros((1, block), module.INPUTS), np.zeros((1, block), module.STATE)
    for a in range(0, n, block):
        b = min(n, a + block)
        if b - a < block:
            u, states = np.zeros((1, b - a), module.INPUTS), np.zeros((1, b - a), module.STATE)
        flat(u)[:] = given[:, a:b]
        rollout(x, u, p, dt * lane.every, states)
        seen = flat(states)[0]
        np.take(seen, outputs, axis=1, out=out[a:b], mode="clip")  # the mode that needs no copy in between
        while done < len(at) and at[done] < b:
            held[done] = seen[at[done] - a, hidden]
            done += 1
    return out, (wanted, held), x
