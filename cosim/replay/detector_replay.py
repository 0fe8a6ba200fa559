"""Replay of detector lanes: inputs, states and outputs from a log, run again through the same `rollout`.

Measurements and commands stand in the log at every tick, parameters and initial states as attachments, whole states
every second. Ticks that a damaged log has lost cut a lane into pieces; a piece that does not begin with the flight
starts at its first whole state.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from actuators.block import unit
from cosim.errors import LogError, did_you_mean
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import wires
from cosim.judge.detection import JudgedLane
from cosim.judge.result import judge
from cosim.log import Log
from cosim.replay import log_schema as schema
from cosim.scenario import vocabulary
from fdi import registry
from fdi.common.record import Detector, Estimate

BLOCK_BYTES = 1 << 18  # of full states at once: they stay in the processor's cache
NONE: tuple = (np.empty(0, np.int64), np.empty((0, 0)))  # no whole states, nothing logged


@dataclass
class Lane:
    """One detector lane: what it is, its parameters, the state before tick `at`, and, once they are read, a stretch of
    its inputs and of what was logged."""

    id: str
    lane: str
    level: str
    module: object
    every: int
    p: np.ndarray
    x: np.ndarray
    inputs: Sequence = ()  # in a log: (input field, topic, field of the topic)
    rollout: object = None  # of a user detector with objects of its own
    at: int = 0
    u: Any = None  # (1, rows)
    ticks: Any = None  # of the rows
    logged: Any = None  # (rows, outputs)
    states: tuple = NONE  # (ticks, values) of the hidden state's snapshots

    @property
    def topic(self) -> str:
        """Return the topic of the outputs."""
        return f"/detectors/{self.id}/{self.lane}"

    @property
    def hidden(self) -> str:
        """Return the topic of the hidden state's snapshots."""
        return f"/state/{self.id}/{self.lane}"


def unlogged(record: Any, lane: str, module: Any, u: np.ndarray, p: np.ndarray, rollout: Any = None) -> Lane:
    """Return the Lane of a detector on inputs u (1, ticks) that no log holds, from the first tick on."""
    every, x = record.every, module.init(p)
    ticks = np.arange(u.shape[1])[::every]
    return Lane(record.id, lane, record.level, module, every, p, x, (), rollout, u=u[:, ::every], ticks=ticks)


def target_of(level: str, lane: str) -> str:
    """Return what a lane of a detector of that level watches."""
    return f"elevator.{lane}" if level == "local" else "aircraft"


def judgement(record: Any, lane: str, parts: tuple, names: Any, rows: Any, dt: float, faults: Sequence) -> dict:
    """Return the entry of a lane (`judge`) of its outputs `rows` (n, fields), fields by `names`, at ticks of `dt` [s];
    of `record` the id, the level and the ticks from step to step are read."""
    own = JudgedLane(record.id, record.level, target_of(record.level, lane), parts, {n: i for i, n in enumerate(names)})
    return judge(own, rows, dt * record.every, faults)


def manifest(log: Log) -> list:
    """Return the list of detectors that a log describes."""
    found = schema.detectors(log)
    strange = [d["id"] for d in found if d["id"] not in registry.SHIPPED and "user_detector" not in d]
    if strange:
        raise schema.older(log, f"detector {strange[0]!r}")
    return found


def tick_of(log: Log) -> Any:
    """Return the tick of a log's flight [s]: 1 / rate, which whole nanoseconds are only near to at 333 Hz."""
    rate = log.metadata.get("run", {}).get("rate_hz", "")
    hertz = int(rate) if rate.isdecimal() and len(rate) < 6 else 0
    return 1.0 / hertz if hertz and round(1e9 / hertz) == log.dt_ns else log.dt_ns * 1e-9


def describe(log: Log, chosen: Any = None, overrides: Mapping[str, Any] | None = None) -> list[Lane]:
    """Return the lanes of the detectors in `chosen` (all) whose code is here; `fill` reads a stretch of them.

    `overrides` is {detector: {parameter: value}}. Raises LogError for one that is laid out otherwise than here.
    """
    found, place = manifest(log), str(log.path)
    if log.metadata.get("run", {}).get("log_profile") == "signals":
        remedy = "Fly it again with log_profile = 'full' or 'replay'"
        raise schema.ReplayError("holds signals alone, not what detectors read", place=place, remedy=remedy)
    known = [d["id"] for d in found]
    if chosen is not None and not chosen:
        raise schema.ReplayError("no detector is named", place="--detectors", allowed=", ".join(known))
    for name in [*(chosen or ()), *(overrides or {})]:
        if name not in known:
            allowed, remedy = ", ".join(known) or "none", did_you_mean(name, known)
            raise schema.ReplayError(f"the log has no detector {name!r}", place=place, allowed=allowed, remedy=remedy)
    schema.chosen_overrides(chosen, overrides)
    mine = [d for d in found if (not chosen or d["id"] in chosen) and registry.known(d["id"])]
    return [lane for d in mine for lane in _wired(log, d, (overrides or {}).get(d["id"], {}))]


def _wired(log, d, changes):
    """Return the lanes of one detector, its parameters with `changes`."""
    record, module = registry.record(d["id"]), registry.module(d["id"])
    p = schema.attached(log, f"{d['id']}.params", module.PARAMS, len(d["lanes"]))
    x = schema.attached(log, f"{d['id']}.initial", module.STATE, len(d["lanes"]))
    schema.trusted(str(log.path), record, module, x, p, tick_of(log))
    schema.override(record, module, p, changes, tick_of(log))
    out = []
    for i, lane in enumerate(d["lanes"]):
        own, row = d["inputs"][lane], slice(i, i + 1)
        out.append(Lane(d["id"], lane, d["level"], module, d["every"], p[row], x[row], own, runner(module)))
        _check(log, out[-1])
    return out


def _check(log, wired):
    """Raise LogError unless the log's topics are those of this version of the detector."""
    topic, (outputs, hidden) = wired.topic, split(wired.module)
    if topic not in log.topics:
        raise LogError(f"the log lacks {topic}, which its detectors.json names", place=str(log.path))
    if len(outputs) != len(log.topics[topic].fields):
        raise schema.older(log, topic)
    if len(hidden) != (len(log.topics[wired.hidden].fields) if wired.hidden in log.topics else 0):
        raise schema.older(log, wired.hidden)
    for name, source, column in wired.inputs:
        there = source in log.topics and column in log.topics[source].fields
        if not there or name.partition("[")[0] not in wired.module.INPUTS.names:
            raise schema.older(log, f"{source}.{column}, which {wired.id} reads as {name},")


def in_stages(wired: Sequence[Lane]) -> list[list[int]]:
    """Return the positions of lanes: first those that read no other one, then each of the rest, in the order in which
    they flew."""
    topics = {w.topic for w in wired}
    reads = [bool(topics & {source for _, source, _ in w.inputs}) for w in wired]
    return [[i for i, own in enumerate(reads) if not own], *([i] for i, own in enumerate(reads) if own)]


def topics(log: Log, wired: Any) -> list[Any]:
    """Return the topics that the lanes read or gave."""
    found = [t for w in wired for t in (w.topic, w.hidden, *(source for _, source, _ in w.inputs))]
    return [t for t in dict.fromkeys(found) if t in log.topics]


def values(log: Log, names: Iterable[str], start: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
    """Return {topic: (rows, fields)} of the ticks start <= k < stop."""
    end = None if stop is None else stop * log.dt_ns / 1e9
    return {name: log.array(name, start_s=start * log.dt_ns / 1e9, end_s=end) for name in names}


def fill(log: Log, wired: Any, start: int = 0, stop: Any = None, read: dict | None = None) -> list[Lane]:
    """Return each Lane of `wired` with the ticks start <= k < stop; `read` {topic: its values} in these ticks."""
    read = values(log, topics(log, wired), start, stop) if read is None else read
    return [_fill(log, w, read, start, stop) for w in wired]


def _fill(log, w, read, start, stop):
    ticks, own = log.ticks(w.topic, start, stop), []
    for name, source, field in w.inputs:
        same = log.topics[source].every == w.every
        rows = slice(None) if same else np.searchsorted(log.ticks(source, start, stop), ticks)
        own.append((name, read[source][rows, log.topics[source].fields.index(field)]))
    states = (log.ticks(w.hidden, start, stop), read[w.hidden]) if w.hidden in log.topics else NONE
    return replace(w, u=inputs(w.module, len(ticks), own), ticks=ticks, logged=read[w.topic], states=states)


def inputs(module: Any, n: int, values: Iterable[tuple[str, Any]]) -> np.ndarray:
    """Return INPUTS (1, n) of a detector from the (input, its values (n,)); `name[i]` is an element."""
    u = np.zeros((1, n), module.INPUTS)
    for name, y in values:
        field_of(u, name)[:] = y
    return u


def field_of(u: np.ndarray, name: str) -> np.ndarray:
    """Return the view (rows,) of a field of records u (1, rows), or of an element of one, `name[i]`."""
    base, _, element = name.partition("[")
    return u[base][0][:, int(element[:-1])] if element else u[base][0]


def columns(kind: Any, names: Sequence[Any]) -> np.ndarray:
    """Return the positions of fields `names` in a record of `kind` seen as float64, in memory order."""
    spans = [(kind[n].itemsize // 8, kind.fields[n][1] // 8) for n in kind.names if n in names]
    return np.array([at + i for size, at in spans for i in range(size)], np.int64)


def elements(kind: Any, names: Sequence[str]) -> list[tuple[str, str]]:
    """Return [(field of a log, unit)] of the elements of fields `names` of a record, in memory order."""
    return [(vocabulary.column(name), unit(kind, name)) for name in vocabulary.elements(kind, names)]


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
    schema.trusted(f"{lane.hidden}, tick {k}", registry.record(lane.id), lane.module, x)
    rows = slice(row + 1, b)
    own = {"u": lane.u[:, rows], "ticks": lane.ticks[rows], "logged": lane.logged[rows]}
    return replace(lane, x=x, at=int(k) + lane.every, **own)


def runner(module: Any) -> Any:
    """Return what steps a lane of a detector in Python, with objects of its own; None for any other."""
    return module.runner() if hasattr(module, "runner") else None


def replay_lane(lane: Any, dt: float) -> Any:
    """Replay one gapless lane; return outputs (rows, n), snapshots (ticks (m,), hidden states (m, h)), last state."""
    module, n = lane.module, len(lane.ticks)
    outputs, hidden = split(module)
    rollout, x, p = lane.rollout or runner(module) or module.rollout, lane.x.copy(), lane.p.copy()
    first, last = lane.ticks[[0, -1]] if n else (0, -1)
    wanted = lane.states[0]
    wanted = wanted[(wanted >= first) & (wanted <= last) & ((wanted - first) % lane.every == 0)]
    at = np.searchsorted(lane.ticks, wanted)
    out, held = np.empty((n, len(outputs))), np.empty((len(wanted), len(hidden)))
    block = max(1, BLOCK_BYTES // module.STATE.itemsize)
    for a in range(0, n, block):
        u = np.ascontiguousarray(lane.u[:, a : a + block])
        states = np.zeros(u.shape, module.STATE)
        rollout(x, u, p, dt * lane.every, states)
        seen, here = flat(states)[0], (at >= a) & (at < a + block)
        out[a : a + block] = seen[:, outputs]
        held[here] = seen[np.ix_(at[here] - a, hidden)]
    return out, (wanted, held), x


def tell(entry: dict) -> None:
    """Take from a log's entry of a detector the record of a user detector, for judgement and pages."""
    about = entry.get("user_detector")
    if about and entry["id"] not in registry.SHIPPED:
        own = dict(about["record"])
        own["estimates"] = tuple(Estimate(*e) for e in own["estimates"])
        for name in ("technologies", "blind_to"):
            own[name] = tuple(own[name])
        registry.tell(Detector(id=entry["id"], level=entry["level"], every=entry["every"], **own))


def isolable_parts_of(entry: dict) -> tuple:
    """Return what a detector of a log can blame."""
    about = entry.get("user_detector")
    if about and entry["id"] not in registry.SHIPPED:
        return tuple(about["isolable_parts"])
    return registry.module(entry["id"]).ISOLABLE_PARTS if registry.known(entry["id"]) else ("",)


def missing(entry: dict) -> str:
    """Return why a detector of a log cannot be run again, "" when it can."""
    name, about = entry["id"], entry.get("user_detector") or {}
    if registry.known(name):
        return ""
    return f"{name} is a user detector, and its code is not here: give it by --detector {about.get('file') or name}"


def other_code(entry: dict) -> str:
    """Return a sentence when the user detector that is here is not the one that flew, else ""."""
    name, about = entry["id"], entry.get("user_detector")
    if not about or name not in registry.USER_DETECTORS or registry.USER_DETECTORS[name].sha256 == about["sha256"]:
        return ""
    here = registry.USER_DETECTORS[name].sha256
    return f"{name} is not the code that flew: digest {here[:12]} here, {about['sha256'][:12]} in the log"


def outputs_of_user(log: Log, part: Any, technologies: dict[str, str]) -> dict[str, np.ndarray]:
    """Return {lane: outputs (rows, n)} of a user detector on an open log in which it did not fly, from its first tick.

    Raises ReplayError for a signal that the log lacks, or for a log with gaps.
    """
    own = part.DETECTOR
    if not log.spans or log.spans[0][0] or sum(log.spans[-1]) != log.n_ticks:
        raise schema.ReplayError("ticks are missing, and a user detector begins with the flight", place=str(log.path))
    local = own.level == "local"
    out = {}
    for lane in [s for s, t in technologies.items() if t in own.technologies] if local else ["aircraft"]:
        place = lane if local else ""
        read = wires(own, place)
        columns = ((w.field, _column(log, w.signal.topic, w.signal.field + "_valid" * w.flag)) for w in read)
        p = own.fit(site(tick_of(log), place, technologies))
        u = inputs(part, log.n_ticks, columns)
        out[lane] = replay_lane(unlogged(own, lane, part, u, p), tick_of(log))[0]
    return out


def _column(log, topic, field):
    """Return a signal as the observers had it: their own copy where the log has one."""
    for name in (topic.replace("/sensors/", "/observers/"), topic):
        if name in log.topics and field in log.topics[name].fields:
            return log.array(name, fields=[field])[:, 0]
    raise schema.ReplayError(f"the log has no {topic}.{field}", place=str(log.path))
