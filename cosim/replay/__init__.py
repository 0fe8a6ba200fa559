"""Run the detectors of a log again, from nothing but the file, and compare bit for bit.

What each detector consumed is in the log (cosim/replay/detector_replay.py). Replay feeds it through the same `rollout`
and compares every logged value as integers, so that NaN equals itself and -0 differs from 0. With changed parameters it
tells, and writes, what would have been.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from actuators.block import Entry
from actuators.kernels import compile_ahead
from cosim.errors import told_at_call
from cosim.judge.detection import Said
from cosim.judge.result import entry_of, judged, plain
from cosim.log import Log, open_log
from cosim.parts import loaded
from cosim.parts.detector import SLOW
from cosim.replay import detector_replay as lanes
from cosim.replay import log_schema
from cosim.replay.detector_replay import Lane, tick_of
from cosim.replay.log_schema import ReplayError, check_start
from cosim.replay.write import overlay

__all__ = ["Difference", "Replay", "ReplayError", "replay"]


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
    dt_s: float = 0.0  # of a tick
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
        differences = [vars(d) for d in self.differences]
        return plain({"log": self.log, "exact": self.exact, **vars(self), "differences": differences})


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
    if output and start_s:
        raise ReplayError("the log that is written begins with the flight", place="--from", remedy="Leave out -o")
    log = open_log(path)
    entries, scenario = log_schema.detectors(log), log_schema.scenario(log)
    faults, new = judged(scenario), [g for g in given if g.DETECTOR.id not in {d["id"] for d in entries}]
    flown = lanes.describe(log, detectors, overrides) if entries or overrides or not new else []
    every = [*flown, *(lane for g in new for lane in lanes.unflown(log, g, scenario.elevator.technology))]
    tick, end = max(0, round(start_s * 1e9 / log.dt_ns)), log.n_ticks + log.gaps
    if tick and tick >= end:
        raise ReplayError("the log ends before that time", place="--from", allowed=f"below {end * log.dt_ns / 1e9:g} s")
    begin = 0 if new else _begin(log, flown, tick)
    members = [_Member(log, lane, faults) for lane in every]
    compile_ahead([lane.rollout.native for lane in every if isinstance(lane.rollout, Entry)])
    with overlay(log, [lane.topic for lane in flown], output) if output else nullcontext() as written:
        asked = log.topics if output else lanes.topics(log, every)
        for ticks, read in lanes.stretches(log, asked, begin, end if every else 0):
            made: dict[str, np.ndarray] = {}
            for m in members:  # in the order in which they flew: what one reads of another is what that gives now
                made[m.lane.topic] = m.replay(log, read | made, ticks.start, ticks.stop)
            if written:
                written(read, made, ticks.start, ticks.stop)
            if progress:
                progress(ticks.stop * log.dt_ns / 1e9, log.n_ticks * log.dt_ns / 1e9)
    rows, values, skipped = (sum(getattr(m, name) for m in members) for name in ("rows", "values", "skipped"))
    if not values and not new:
        raise ReplayError("there is nothing to compare: the log holds no detector outputs", place=str(path),
                          remedy="Fly the scenario with detectors.enabled set")  # fmt: skip
    notes = [line for d in entries if (line := lanes.code_that_flew(d))]
    for d in entries:
        lanes.tell(d)
    return Replay(
        str(path), rows, values, skipped, tick_of(log), overrides or {}, output=str(output) if output else None,
        differences=sorted((d for m in members for d in m.differences.values()), key=lambda d: d.first_tick),
        detectors=[m.judge() for m in members],
        notes=[*notes, *dict.fromkeys(line for lane in every for line in lane.notes)],
    )  # fmt: skip


def _begin(log, flown, tick):
    """Return the tick from which lanes are replayed: of the last whole states up to `tick`, which each lane takes."""
    own = [lane for lane in flown if tick and lane.hidden in log.topics]
    for lane in own:
        lane.at = None
    return min((int(log.ticks(lane.hidden, 0, tick + 1).max(initial=0)) for lane in own), default=0)


class _Member:
    """A lane that is replayed span after span: what differs of what was compared, what it said then and says now."""

    def __init__(self, log: Log, lane: Lane, faults: Sequence):
        self.lane, self.flew, self.dt, self._faults = lane, lane.topic in log.topics, tick_of(log), faults
        self.fields = [name for name, _ in lane.outputs]
        self.hidden = log.topics[lane.hidden].fields if lane.hidden in log.topics else ()
        own = lanes.judged_lane(lane.id, lane.level, lane.lane, lane.module.ISOLABLE_PARTS, self.fields)
        self._logged, self._again = (Said(own, self.dt * lane.every, faults) for _ in range(2))
        self.rows = self.values = self.skipped = 0
        self.differences: dict[str, Difference] = {}

    def replay(self, log: Log, read: dict, start: int, stop: int) -> np.ndarray:
        """Return its new outputs (rows, n) in the ticks start <= k < stop, as logged where they cannot be replayed: a
        lane begins with the flight, and after a gap of the log at the next whole state."""
        lane = self.lane
        ticks, u = lane.inputs(log, read, start, stop)
        logged = read[lane.topic] if self.flew else np.zeros((len(ticks), len(self.fields)))
        none = np.empty(0, np.int64), np.empty((0, 0))
        whole, held = (log.ticks(lane.hidden, start, stop), read[lane.hidden]) if self.hidden else none
        out, at, i = logged.copy(), np.searchsorted(ticks, whole), 0
        while i < len(ticks):
            if ticks[i] != lane.at:  # ticks are missing before row i: on from the next whole state
                k = int(np.searchsorted(at, i))
                j = int(at[k]) + 1 if k < len(at) else len(ticks)
                self.skipped += (j - i) * (lane.at is not None)
                if k < len(at):
                    lane.restore(logged[j - 1], held[k], int(whole[k]))
            else:  # rows i to j follow one another
                gaps = np.flatnonzero(np.diff(ticks[i:]) != lane.every)
                j = i + 1 + int(gaps[0]) if len(gaps) else len(ticks)
                inside = slice(*np.searchsorted(at, (i, j)))
                out[i:j], states = lane.step(u[:, i:j], self.dt, at[inside] - i)
                lane.at = int(ticks[j - 1]) + lane.every
                self.rows += j - i
                n = self._by_clock(logged[i:j])
                self.skipped += j - i - n
                if self.flew:
                    self._compare(lane.topic, self.fields, ticks[i : i + n], logged[i : i + n], out[i : i + n])
                if self.hidden:
                    self._compare(lane.hidden, self.hidden, whole[inside], held[inside], states)
            i = j
        self._judge(ticks, logged, out)
        return out

    def _by_clock(self, logged):
        """Return the rows up to which a lane can repeat itself: a user's that took too long is dropped by the clock."""
        if isinstance(self.lane.rollout, Entry) or "status" not in self.fields:
            return len(logged)
        slow = np.flatnonzero(logged[:, self.fields.index("status")] == SLOW)
        return int(slow[0]) if len(slow) else len(logged)

    def _compare(self, topic, fields, ticks, logged, again):
        """Take down where `again` (rows, fields) differs from what was logged, bit for bit."""
        self.values += again.size
        wrong = np.ascontiguousarray(logged).view(np.int64) != np.ascontiguousarray(again).view(np.int64)
        for j in np.flatnonzero(wrong.any(axis=0)):
            rows, where = np.flatnonzero(wrong[:, j]), f"{topic}.{fields[j]}"
            with np.errstate(invalid="ignore", over="ignore"):
                gap = np.abs(logged[rows, j] - again[rows, j])
            found = self.differences.setdefault(where, Difference(where, 0, int(ticks[rows[0]]), math.nan))
            found.count += len(rows)
            found.max_abs = float(np.fmax.reduce(gap, initial=found.max_abs))

    def _judge(self, ticks, *rows):
        """Take what it said as logged and as replayed; nothing where the log has no row."""
        places = ticks // self.lane.every - self._logged.ticks
        for said, own in zip((self._logged, self._again), rows):
            block = np.zeros((int(places[-1]) + 1 if len(places) else 0, len(self.fields)), np.float32)
            with np.errstate(over="ignore"):
                block[places] = own
            said.add(block)

    def judge(self) -> dict:
        """Return the lane's detection metrics, as logged (None where it did not fly) and as replayed."""
        old, new = (entry_of(told, self.dt * self.lane.every, self._faults) for told in (self._logged, self._again))
        about = {k: new[k] for k in ("id", "level", "target")}
        return {**about, "logged": old if self.flew else None, "replayed": new}
