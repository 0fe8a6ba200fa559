"""Run the detectors of a log again, from nothing but the file, and compare bit for bit.

What each detector consumed is in the log (cosim/replay/detector_replay.py). Replay feeds it through the same `rollout`
and compares every logged value as integers, so that NaN equals itself and -0 differs from 0. With changed parameters it
tells, and writes, what would have been.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from actuators.block import Entry
from actuators.kernels import compile_ahead, cores
from cosim.errors import told_at_call
from cosim.judge.detection import JudgedLane, Said, outputs_read
from cosim.judge.result import entry_of, judged, plain
from cosim.log import open_log
from cosim.parts import loaded
from cosim.parts.detector import SLOW
from cosim.replay import detector_replay as lanes
from cosim.replay import log_schema
from cosim.replay.detector_replay import pieces, replay_lane, tick_of
from cosim.replay.log_schema import ReplayError, check_start
from cosim.replay.write import Overlay

SPAN = 2000  # ticks that are replayed together
COUNTS = ("rows", "values", "skipped")
__all__ = ["Difference", "Replay", "ReplayError", "compare", "pieces", "replay", "replay_lane"]


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

    log: str  # the file that was replayed
    rows: int = 0  # ticks replayed, over all lanes
    values: int = 0  # values compared
    skipped: int = 0  # rows that follow a gap of the log, up to the next whole state
    dt: float = 0.0  # of a tick [s]
    changed: dict = field(default_factory=dict)  # {detector: {parameter: value}}: then differences are expected
    differences: list = field(default_factory=list)  # a dict per field: count, first tick, largest
    detectors: list = field(default_factory=list)  # detection metrics, logged and replayed
    output: str | None = None  # the log that was written
    notes: list = field(default_factory=list)  # sentences: user detectors not run, or not the code that flew

    @property
    def exact(self) -> bool:
        """Return whether something was compared and nothing differs."""
        return self.values > 0 and not self.differences

    def to_dict(self) -> Any:
        """Return what `cosim replay --json` prints."""
        own = {{"dt": "dt_s"}.get(name, name): value for name, value in vars(self).items()}
        differences = [vars(d) for d in self.differences]
        return plain({"log": self.log, "exact": self.exact, **own, "differences": differences})


def compare(name: str, fields: Any, ticks: np.ndarray, logged: np.ndarray, again: np.ndarray) -> list:
    """Return the Differences of two (rows, fields) arrays, bit for bit."""
    wrong = np.ascontiguousarray(logged).view(np.int64) != np.ascontiguousarray(again).view(np.int64)
    if not wrong.any():
        return []
    out = []
    for j in np.flatnonzero(wrong.any(axis=0)):
        rows = np.flatnonzero(wrong[:, j])
        with np.errstate(invalid="ignore", over="ignore"):
            gap = np.abs(logged[rows, j] - again[rows, j])
        largest = math.nan if np.isnan(gap).all() else float(np.nanmax(gap))
        out.append(Difference(f"{name}.{fields[j]}", len(rows), int(ticks[rows[0]]), largest))
    return out


@told_at_call
def replay(
    path: str | Path, *, detectors: Any = None, overrides: Any = None, start_s: float = 0.0, output: Any = None,
    progress: Callable[..., Any] | None = None, user_detectors: Sequence[Any] = ()
) -> Replay:  # fmt: skip
    """Replay the log at `path` and return a Replay.

    `detectors` chooses some; `overrides` {detector: {parameter: value}} asks what would have been; `start_s` begins
    at the last whole state before that time; `output` writes a log with the old topics and, under /replay, the new
    ones. `user_detectors` are files of detectors (cosim/parts): one that flew is run again, another one is run on the
    flight as it was logged, and has no `logged` among its results. Raises LogError, ReplayError, PartError.
    """
    given = loaded(user_detectors)
    check_start(start_s)
    if str(path).lower().endswith((".csv", ".parquet")):
        remedy = f"`cosim map {path}` drafts the map of its columns that --map takes"
        raise ReplayError("is a table, no log", place=str(path), remedy=remedy)
    log = open_log(path)
    entries = lanes.manifest(log)
    flew = {d["id"] for d in entries}
    fresh = [g for g in given if g.DETECTOR.id not in flew]
    if said := next((why for e in entries if e["id"] in (overrides or {}) and (why := lanes.missing(e))), ""):
        raise ReplayError(said, place="--set")
    wired = lanes.describe(log, detectors, overrides) if flew or not fresh else []
    scenario = log_schema.scenario(log)
    faults = judged(scenario)
    members = [_Member(log, w, faults) for w in wired]
    tick = max(0, round(start_s * 1e9 / log.dt_ns))
    spans, asked = list(_spans(log, wired, tick)), lanes.topics(log, wired) if output is None else log.topics
    _ready(wired)
    stages = lanes.in_stages(wired)
    with ExitStack() as stack, ThreadPoolExecutor(cores()) as pool:
        overlay = stack.enter_context(Overlay(log, wired, output)) if output else None
        coming = [pool.submit(lanes.values, log, asked, *span) for span in spans[:1]]
        for k, (a, b) in enumerate(spans):
            read = coming.pop().result()
            coming = [pool.submit(lanes.values, log, asked, *span) for span in spans[k + 1 : k + 2]]
            new = _span(log, members, stages, read, (a, b, tick), pool)
            if overlay:
                overlay.append(read, new, a, b)
            if progress:
                progress(min(b, log.n_ticks) * log.dt_ns / 1e9, log.n_ticks * log.dt_ns / 1e9)
    result = Replay(str(path), dt=tick_of(log), changed=overrides or {}, output=str(output) if output else None)
    result.rows, result.values, result.skipped = (sum(getattr(m, n) for m in members) for n in COUNTS)
    result.notes = [line for d in entries for line in (lanes.missing(d), lanes.other_code(d)) if line]
    if not result.values and not fresh:
        raise _nothing(log, path, tick)
    result.differences = sorted((d for m in members for d in m.differences.values()), key=lambda d: d.first_tick)
    for d in entries:
        lanes.tell(d)
    result.detectors = [m.judge() for m in members]
    for own in fresh:
        for lane, rows in lanes.outputs_of_user(log, own, scenario.elevator.technology).items():
            names = dict(lanes.elements(own.STATE, own.OUTPUTS))
            new = lanes.judgement(own.DETECTOR, lane, own.ISOLABLE_PARTS, names, rows, tick_of(log), faults)
            result.detectors.append(_both(None, new))
    return result


def _both(old, new):
    """Return the detection metrics of a lane, as logged (None where it did not fly) and as replayed."""
    return {**{k: new[k] for k in ("id", "level", "target")}, "logged": old, "replayed": new}


def _ready(wired):
    """Compile on every core what is not compiled yet."""
    natives = [w.module.rollout.native for w in wired if _compiled(w.module)]
    compile_ahead(natives)
    for native in natives:
        _ = native.address  # before there are threads, of which each would compile it


def _compiled(module):
    return isinstance(getattr(module, "rollout", None), Entry)


def _span(log, members, stages, read, span, pool):
    """Return the new outputs of every member for a span (start, stop, first tick wanted), stage after stage: one that
    reads another detector that is replayed, too, reads what that one gives now."""
    a, b, tick = span
    new, read = [None] * len(members), dict(read)
    for k, stage in enumerate(stages):
        found = _each([members[i] for i in stage], lambda m: m.replay(*lanes.fill(log, [m.w], a, b, read), tick), pool)
        for i, out in zip(stage, found):
            new[i] = out
            if k + 1 < len(stages):
                topic = members[i].w.topic
                read[topic] = np.where(np.isnan(out).all(axis=1, keepdims=True), read[topic], out)
    return new


def _each(members, call, pool):
    """Return call(m) of each member: of compiled ones side by side, of users' with objects of their own one by one."""
    tasks = [pool.submit(call, m) if _compiled(m.w.module) else None for m in members]
    return [task.result() if task else call(m) for m, task in zip(members, tasks)]


def _nothing(log, path, tick):
    end = sum(log.spans[-1]) if log.spans else 0
    why = "the log holds no detector outputs"
    how = {"remedy": "Fly the scenario with detectors.enabled set"}
    if tick and log.spans and tick >= end:
        why, how = "the log ends before that time", {"allowed": f"--from below {end * log.dt_ns / 1e9:g} s"}
    return ReplayError(f"there is nothing to compare: {why}", place=str(path), **how)


def _spans(log, wired, tick):
    """Yield (start, stop) of the ticks that are replayed together, from the last whole states up to `tick` on."""
    if not log.spans or not wired:
        return
    held = [log.ticks(w.hidden, 0, tick + 1)[-1:] for w in wired if w.hidden in log.topics]
    begin = min((int(k[0]) if len(k) else 0 for k in held), default=0)
    for a in range(begin, sum(log.spans[-1]), SPAN):
        yield a, a + SPAN


class _Member:
    """Replay one lane span after span: carry its state, count, compare, and keep what a verdict needs."""

    def __init__(self, log, w, faults):
        self.w, self.dt, self.differences = w, tick_of(log), {}
        self.fields = log.topics[w.topic].fields
        self.hidden = log.topics[w.hidden].fields if w.hidden in log.topics else ()
        self.names = outputs_read(w.module.ISOLABLE_PARTS, self.fields)
        self.columns = [self.fields.index(n) for n in self.names]
        self.rows = self.values = self.skipped = 0
        at = {n: i for i, n in enumerate(self.names)}
        own = JudgedLane(w.id, w.level, lanes.target_of(w.level, w.lane), w.module.ISOLABLE_PARTS, at)
        self._faults = faults
        # zero where the log has no row; the same while nothing differs
        self.logged = self.again = Said(own, self.dt * w.every, faults)

    def replay(self, lane, tick):
        """Return the new outputs (rows, n) of a lane's span; NaN where it could not or should not be replayed."""
        w, out, done = self.w, np.full(lane.logged.shape, np.nan), 0  # rows from `tick` on
        places = lane.ticks // w.every - self.logged.ticks
        old = np.zeros((int(places[-1]) + 1 if len(places) else 0, len(self.names)), np.float32)
        old[places] = np.take(lane.logged, self.columns, axis=1)
        new = old.copy()
        for piece in pieces(lane, tick):
            again, (at, states), w.x = replay_lane(piece, self.dt)
            w.at = int(piece.ticks[-1]) + w.every
            first, n = int(np.searchsorted(lane.ticks, piece.ticks[0])), self._by_clock(piece)
            rows = slice(first, first + len(again))
            out[rows], new[places[rows]] = again, again[:, self.columns]
            self.rows += len(again)
            done += int(np.count_nonzero(piece.ticks[:n] >= tick))
            self._compare(w.topic, self.fields, piece.ticks[:n], piece.logged[:n], again[:n])
            held = lane.states[1][np.searchsorted(lane.states[0], at)]
            self._compare(w.hidden, self.hidden, at, held, states)
        if self.again is self.logged and not np.array_equal(old.view(np.int32), new.view(np.int32)):
            self.again = deepcopy(self.logged)
        if self.again is not self.logged:
            self.again.add(new)
        self.logged.add(old)
        self.skipped += int(np.count_nonzero(lane.ticks >= tick)) - done
        return out

    def _by_clock(self, piece):
        """Return the rows up to which a lane can repeat itself: a user's that took too long is dropped by the clock."""
        if self.w.rollout is None or "status" not in self.fields:
            return len(piece.ticks)
        slow = np.flatnonzero(piece.logged[:, self.fields.index("status")] == SLOW)
        return int(slow[0]) if len(slow) else len(piece.ticks)

    def _compare(self, name, fields, ticks, logged, again):
        """Take down where `again` differs from what was logged."""
        self.values += again.size
        for d in compare(name, fields, ticks, logged, again):
            old = self.differences.setdefault(d.field, Difference(d.field, 0, d.first_tick, d.max_abs))
            old.count += d.count
            old.max_abs = float(np.fmax(old.max_abs, d.max_abs))

    def judge(self):
        """Return the lane's detection metrics, as logged and as replayed."""
        return _both(*(entry_of(told, self.dt * self.w.every, self._faults) for told in (self.logged, self.again)))
