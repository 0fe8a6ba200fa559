"""Run the detectors of a log again, from nothing but the file, and compare bit for bit.

What each detector consumed is in the log: measurements and commands at every tick, parameters and initial state as attachments, and its
whole state every second. Replay feeds them through the same `rollout` and compares every logged value as integers, so that NaN equals
itself and -0 differs from 0. With changed parameters, or detectors chosen, it writes what would have been.
"""

import importlib
import io
import json
import math
import tomllib
from dataclasses import dataclass, field

import numpy as np

from cosim.errors import CosimError, LogError, did_you_mean
from cosim.log import LogWriter, Topic, open_log
from cosim.log.writer import RESERVED
from cosim.result import Watch, judge, judged, plain

BLOCK = 4096  # ticks at once: bounds the memory of the full states


class ReplayError(CosimError):
    """A replay that cannot be made, or would compare nothing."""


@dataclass
class Difference:
    """One field that is not as logged."""

    field: str
    count: int
    first_tick: int
    max_abs: float


@dataclass
class Replay:
    """What a replay found: `exact` only where something was compared and nothing differs."""

    log: str
    rows: int                 # ticks replayed, over all lanes
    values: int               # values compared
    differences: list = field(default_factory=list)
    changed: bool = False     # parameters were changed: differences are expected
    detectors: list = field(default_factory=list)  # detection metrics, logged and replayed
    output: str | None = None

    @property
    def exact(self):
        return self.values > 0 and not self.differences

    def to_dict(self):
        """Return what `cosim replay --json` prints."""
        return plain({"log": self.log, "exact": self.exact, "rows": self.rows, "values": self.values, "changed": self.changed,
                      "differences": [vars(d) for d in self.differences], "detectors": self.detectors, "output": self.output})


@dataclass
class Lane:
    """One detector lane of a log: its inputs (ticks,), parameters, state to start from, and what was logged."""

    id: str
    lane: str
    level: str
    module: object
    every: int
    p: np.ndarray
    x: np.ndarray
    u: np.ndarray          # (1, rows)
    ticks: np.ndarray      # of the rows
    logged: np.ndarray     # (rows, outputs)
    states: tuple          # (ticks, values) of the hidden state's snapshots


def _array(log, name, kind):
    """Return the structured array in attachment `name`, of dtype `kind`; LogError when it is not there or of another layout."""
    if name not in log.attachments:
        raise LogError(f"the log lacks {name}", place=str(log.path), remedy="It was not written by `cosim run`; see `cosim replay --map`")
    try:
        found = np.load(io.BytesIO(log.attachments[name]), allow_pickle=False)
    except (ValueError, EOFError, OSError, SyntaxError) as error:
        raise LogError(f"{name} is damaged: {error}", place=str(log.path)) from error
    if found.dtype.names != kind.names or any(found.dtype[n].shape != kind[n].shape for n in kind.names):
        raise LogError(f"{name} has another layout than this version's {', '.join(sorted(set(kind.names) ^ set(found.dtype.names or ())))}",
                       place=str(log.path), remedy="Replay it with the version that wrote it (`cosim info` names it)")
    out = np.zeros(found.shape, kind)
    for n in kind.names:
        out[n] = found[n]
    return out


def _columns(kind, names):
    """Return the positions of fields `names` in a record of `kind` seen as float64, in memory order."""
    out = []
    for name in kind.names:
        if name in names:
            sub, offset = kind.fields[name][:2]
            out += range(offset // 8, offset // 8 + sub.itemsize // 8)
    return np.array(out)


def _flat(records):
    """Return records as float64, (..., values)."""
    return records.view(np.float64).reshape(*records.shape, -1)


def manifest(log):
    """Return the list of detectors that a log describes."""
    if "detectors.json" not in log.attachments:
        raise LogError("the log describes no detectors", place=str(log.path), remedy="For data of another source use --map")
    return json.loads(log.attachments["detectors.json"])


def lanes(log, chosen=None, overrides=None):
    """Yield the Lane of every detector in `chosen` (all) of an open log. `overrides` is {detector: {parameter: value}}."""
    found = manifest(log)
    known = [d["id"] for d in found]
    for name in [*(chosen or ()), *(overrides or {})]:
        if name not in known:
            raise ReplayError(f"the log has no detector {name!r}", place=str(log.path), allowed=", ".join(known) or "none",
                              remedy=did_you_mean(name, known))
    topics = {t for d in found for inputs in d["inputs"].values() for _, t, _ in inputs}
    sources = log.arrays(sorted(topics))
    for d in found:
        if chosen and d["id"] not in chosen:
            continue
        module = importlib.import_module(d["module"])
        p, x = _array(log, f"{d['id']}.params.npy", module.PARAMS), _array(log, f"{d['id']}.initial.npy", module.STATE)
        override(d["id"], p, (overrides or {}).get(d["id"], {}))
        for i, lane in enumerate(d["lanes"]):
            topic, hidden = f"/detectors/{d['id']}/{lane}", f"/state/{d['id']}/{lane}"
            ticks = log.ticks(topic)
            u = np.zeros((1, len(ticks)), module.INPUTS)
            for name, source, column in d["inputs"][lane]:
                field, _, element = name.partition("[")
                to = u[field][0][:, int(element[:-1])] if element else u[field][0]
                to[:] = sources[source][ticks, log.topics[source].fields.index(column)]
            states = (log.ticks(hidden), log.array(hidden)) if hidden in log.topics else (np.empty(0, np.int64), np.empty((0, 0)))
            yield Lane(d["id"], lane, d["level"], module, d["every"], p[i : i + 1], x[i : i + 1], u, ticks, log.array(topic), states)


def override(detector, p, values):
    """Set parameters {name: value} of `detector` in its PARAMS `p`; `name[i]` is an element. Raises ReplayError for one that is none."""
    for name, value in values.items():
        base, _, index = name.partition("[")
        if base not in p.dtype.names:
            raise ReplayError("no such parameter", place=f"{detector}.{name}", allowed=", ".join(p.dtype.names),
                              remedy=did_you_mean(base, p.dtype.names))
        if index:
            p[base][:, int(index.rstrip("]"))] = value
        else:
            p[base] = value


def start_at(lane, tick):
    """Move a lane's start to the last snapshot of its whole state at or before `tick`; its rows then begin after that."""
    ticks, values = lane.states
    at = np.flatnonzero(ticks <= tick)
    if not len(at) or tick <= 0:
        return
    k = int(ticks[at[-1]])
    row = int(np.searchsorted(lane.ticks, k))
    x = _flat(lane.x)
    outputs = _columns(lane.module.STATE, lane.module.OUTPUTS)
    hidden = np.setdiff1d(np.arange(x.shape[-1]), outputs)
    x[0, outputs], x[0, hidden] = lane.logged[row], values[at[-1]]
    lane.u, lane.ticks, lane.logged = lane.u[:, row + 1 :], lane.ticks[row + 1 :], lane.logged[row + 1 :]


def run(lane, dt):
    """Replay one lane and return (outputs (rows, n), {tick: whole hidden state}) of its snapshots."""
    kind = lane.module.STATE
    outputs = _columns(kind, lane.module.OUTPUTS)
    hidden = np.setdiff1d(np.arange(kind.itemsize // 8), outputs)
    out, snapshots = np.empty((len(lane.ticks), len(outputs))), {}
    wanted = set(lane.states[0].tolist())
    for a in range(0, len(lane.ticks), BLOCK):
        u = np.ascontiguousarray(lane.u[:, a : a + BLOCK])
        states = np.zeros(u.shape, kind)
        lane.module.rollout(lane.x, u, lane.p, dt * lane.every, states)
        flat = _flat(states)[0]
        out[a : a + BLOCK] = flat[:, outputs]
        for i, k in enumerate(lane.ticks[a : a + BLOCK].tolist()):
            if k in wanted:
                snapshots[k] = flat[i, hidden]
    return out, snapshots


def compare(name, fields, ticks, logged, again):
    """Return the Differences of two (rows, fields) arrays, bit for bit."""
    out = []
    wrong = logged.view(np.int64) != again.view(np.int64)
    for j in np.flatnonzero(wrong.any(axis=0)):
        rows = np.flatnonzero(wrong[:, j])
        with np.errstate(invalid="ignore"):
            gap = np.abs(logged[rows, j] - again[rows, j])
        out.append(Difference(f"{name}.{fields[j]}", len(rows), int(ticks[rows[0]]), float(np.nanmax(gap)) if np.isfinite(gap).any() else math.nan))
    return out


def replay(path, *, detectors=None, overrides=None, start_s=0.0, output=None):
    """Replay the log at `path` and return a Replay.

    `detectors` chooses some; `overrides` {detector: {parameter: value}} asks what would have been; `start_s` begins at the last whole
    state before that time; `output` writes a log with the old topics and, under /replay, the new ones. Raises LogError, ReplayError.
    """
    log = open_log(path)
    dt = log.dt_ns * 1e-9
    result = Replay(str(path), 0, 0, changed=bool(overrides))
    new = {}
    for lane in lanes(log, detectors, overrides):
        if start_s > 0.0:
            start_at(lane, round(start_s / dt))
        out, snapshots = run(lane, dt)
        topic = f"/detectors/{lane.id}/{lane.lane}"
        result.rows += len(out)
        result.values += out.size
        result.differences += compare(topic, log.topics[topic].fields, lane.ticks, lane.logged, out)
        hidden = f"/state/{lane.id}/{lane.lane}"
        if snapshots:
            k, old = lane.states
            kept = np.isin(k, list(snapshots))
            again = np.array([snapshots[t] for t in k[kept].tolist()])
            result.values += again.size
            result.differences += compare(hidden, log.topics[hidden].fields, k[kept], np.ascontiguousarray(old[kept]), again)
        new[topic] = (lane, out)
    if not result.values:
        raise ReplayError("there is nothing to compare: the log holds no detector outputs", place=str(path),
                          remedy="Fly the scenario with detectors.enabled set")
    result.detectors = _metrics(log, new, dt)
    if output:
        _write(log, new, output)
        result.output = str(output)
    return result


def _metrics(log, new, dt):
    """Return the detection metrics of each lane, as logged and as replayed."""
    from cosim.scenario import parse

    faults = judged(parse(tomllib.loads(log.attachments["scenario.toml"].decode())))
    out = []
    for topic, (lane, again) in new.items():
        fields = list(log.topics[topic].fields)
        columns = [fields.index(f) for f in ("alarm", "verdict", "culprit")]
        watch = Watch(lane.id, lane.level, f"elevator.{lane.lane}" if lane.level == "local" else "aircraft", lane.module.CULPRITS, 0, 1, 2)
        old, now = (judge(watch, np.ascontiguousarray(a[:, columns]), dt * lane.every, faults) for a in (lane.logged, again))
        out.append({"id": lane.id, "target": watch.target, "logged": old, "replayed": now})
    return out


def _write(log, new, output):
    """Write a log with everything of `log` and the replayed outputs under /replay."""
    columns, topics, at = [], [], 0

    def add(name, info, ticks, values):
        nonlocal at
        full = np.zeros((log.n_ticks, values.shape[1]))
        full[ticks - log_start] = values
        columns.append(full)
        topics.append(Topic(name=name, fields=info.fields, units=info.units, index=np.arange(at, at + values.shape[1]), every=info.every,
                            group=info.group, description=info.description))
        at += values.shape[1]

    log_start = log.spans[0][0] if log.spans else 0
    for name, info in log.topics.items():
        add(name, info, log.ticks(name), log.array(name))
    for name, (lane, values) in new.items():
        add("/replay" + name, log.topics[name], lane.ticks, values)
    rows = np.concatenate(columns, axis=1)
    attachments = {n: (log.media_types[n], data) for n, data in log.attachments.items()}
    metadata = {n: v for n, v in log.metadata.items() if n not in RESERVED}
    metadata["replay_of"] = {k: v for k, v in (log.result or {}).items() if k.startswith("sha256")}
    with LogWriter(output, topics, n_values=at, dt_ns=log.dt_ns, metadata=metadata, attachments=attachments, rows_per_chunk=500) as writer:
        for row in rows:
            writer.append(row)
        writer.close(result={k: v for k, v in (log.result or {}).items() if not k.startswith("sha256")})
