"""Recording of a benchmark flight: the signals that a detector may read, and the truth that judges it.

A detector that no servo closes on gives on one, bit for bit, what it would have given in the flight, so that a new one
is scored without flying. A recording is a Parquet file: a column for each word of `cosim list signals` as detectors
have it (`alpha`, `left_inner.rod`; `<word>_valid` where a sample was ever lost), columns of truth under their names on
the bus, and as metadata the scenario, how the flight ended, and what its faults did.
"""

import dataclasses
import hashlib
import io
import json
import math
import multiprocessing
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, Field

from cosim.errors import LogError
from cosim.files import replace
from cosim.flight import plugins
from cosim.flight.build import build
from cosim.flight.detection.detectors import Installed, chosen, cost, with_sources
from cosim.flight.faults.conditions import resolved
from cosim.flight.faults.fault_free_reference import Twin
from cosim.flight.fly import fly
from cosim.flight.plugins.watchdog import watched
from cosim.judge import estimation
from cosim.judge.detection import columns, watch_of
from cosim.judge.result import judge, judged
from cosim.replay.detector_replay import inputs, replay_lane, runner, unlogged
from cosim.scenario import Scenario, parse, vocabulary
from cosim.texts import from_json, toml

PATIENCE_S = 10.0  # for one step: no figure of a recording depends on the clock of a loaded machine
ABOUT, VALID = b"cosim", "_valid"


def readable(scenario: Scenario) -> dict[str, vocabulary.Signal]:
    """Return {full word: Signal} of everything that a detector may read in a flight of `scenario`."""
    out = {}
    for signal in vocabulary.words().values():
        own = [s for s, t in scenario.elevator.technology.items() if t in signal.technologies]
        for at in [signal.at(lane) for lane in own] if signal.technologies else [signal]:
            out[at.word] = at
    return out


def record(scenario: Scenario, path: str | Path) -> dict:
    """Fly `scenario` without detectors and write its recording to `path`; return what is told of it.

    {status, reason, sim_time_s, sha256 of the file, content: SHA-256 of names and values alone, bytes}. Raises
    TrimError, OutputError, and LogError for a servo that closes on a detector.
    """
    quiet = scenario.detectors.model_copy(update={"enabled": ()})
    scenario = resolved(scenario.model_copy(update={"detectors": quiet}))
    if chosen(scenario):
        raise LogError("a servo closes on a detector", place=str(path), remedy="elevator.feedback = 'measured'")
    setup = build(scenario)
    bus, kept = setup.loop.bus, list(setup.trace.index)
    words = {}
    for word, s in readable(scenario).items():
        section, lane, _ = s.source.split(".", 2)
        if lane in bus.lanes.get(section, ()):  # an aircraft with two engines has two tachometers
            words[word] = s
    flags = {w + VALID: s.flag for w, s in words.items() if s.flag}
    truth = list(estimation.truths(scenario))
    sources = [*(s.source for s in words.values()), *flags.values(), *truth]
    index = [bus.index(n) for n in sources]
    first = bus.v[index]  # what a servo had sent before the first tick
    with Twin(setup) as twin:
        rows, status, reason = fly(setup, keep=(np.array([*kept, *index], np.int64), np.float64), pause=twin.pause)
        if status == "interrupted":
            raise KeyboardInterrupt
        trace, values = rows[:, : len(kept)].astype(np.float32), rows[:, len(kept) :]
        achieved = twin.moved(trace)
    table = {}
    for i, (name, source) in enumerate(zip([*words, *flags, *truth], sources)):
        column = np.ascontiguousarray(values[:, i])
        if name in words and words[name].kind == "sent":  # detectors step before the servos: theirs is of a tick ago
            column = np.concatenate([first[i : i + 1], column[:-1]])
        if name in words or (name in flags and not column.all()):
            table[name] = column
        elif name in truth:
            table[source] = column.astype(np.float32)
    about = {"status": status, "reason": reason, "sim_time_s": len(rows) * scenario.dt, "achieved": achieved,
             "consequences": setup.trace.consequences(scenario, trace),
             "scenario": scenario.expanded_toml()}  # fmt: skip
    content = hashlib.sha256(json.dumps(about | {"scenario": ""}, sort_keys=True).encode())
    for name, column in table.items():
        content.update(name.encode() + b"\0" + column.tobytes())
    made = pa.table(table).replace_schema_metadata({ABOUT: json.dumps(about)})
    replace(path, lambda part: _write(part, made))
    whole = Path(path).read_bytes()
    told = {k: about[k] for k in ("status", "reason", "sim_time_s")}
    return {**told, "sha256": hashlib.sha256(whole).hexdigest(), "content": content.hexdigest(), "bytes": len(whole)}


def _write(path, table):
    how = {"compression": "zstd", "use_dictionary": False, "write_statistics": False}
    with Path(path).open("wb") as file:
        pq.write_table(table, file, use_byte_stream_split=True, **how)


class _About(BaseModel):
    """What a recording says of its flight, beside what the judgement adds."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)

    status: str
    reason: str
    sim_time_s: Annotated[float, Field(ge=0.0)]
    achieved: dict[str, dict[str, float | None]] | None
    consequences: dict[str, float | None] | None
    scenario: str


class Recording:
    """One thin recording; columns are read when they are asked for."""

    def __init__(self, path: str | Path, sha256: str = ""):
        """Open the file at `path`; with `sha256` it must be that file. Raises LogError."""
        self.path = Path(path)
        try:
            whole = self.path.read_bytes()
            if sha256 and hashlib.sha256(whole).hexdigest() != sha256:
                raise LogError("is damaged: its digest differs", place=str(path), remedy="Remove it, to be flown again")
            self._file = pq.ParquetFile(io.BytesIO(whole))
            schema = self._file.schema_arrow
            self.about = from_json((schema.metadata or {})[ABOUT], place=str(path), error=LogError)
            _About.model_validate(self.about)
        except (OSError, pa.ArrowException, KeyError, ValueError) as error:
            said = "cannot be read" if isinstance(error, OSError) else "is no thin recording"
            raise LogError(said, place=str(path)) from None
        self.names, self.ticks = set(schema.names), self._file.metadata.num_rows
        if len(self.names) != len(schema) or not all(pa.types.is_floating(t) for t in schema.types) or not self.ticks:
            raise LogError("is no thin recording: its columns are no numbers", place=str(path))
        self._columns: dict[str, np.ndarray] = {}

    @cached_property
    def scenario(self) -> Scenario:
        """Return the scenario that was flown: without detectors."""
        return parse(toml(self.about["scenario"], place=str(self.path)))

    @cached_property
    def faults(self) -> list[dict]:
        """Return the faults as the judgement takes them."""
        return judged(self.scenario, self.about["achieved"])

    def column(self, name: str) -> np.ndarray:
        """Return a signal (ticks,) by its word, or truth by its bus name; a flag that is not there was always 1."""
        if name not in self._columns:
            if name in self.names:
                try:
                    self._columns[name] = self._file.read([name]).column(0).to_numpy()
                except (OSError, pa.ArrowException) as error:
                    raise LogError(f"{name} is damaged: {error}", place=str(self.path)) from None
            elif name.endswith(VALID) and name.removesuffix(VALID) in self.names:
                self._columns[name] = np.ones(self.ticks)
            else:
                raise LogError(f"has no signal {name!r}", place=str(self.path))
        return self._columns[name]

    def inputs(self, detector: Installed, lane: str, given: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the INPUTS (1, ticks) of a lane; `given` has outputs (ticks,) of detectors by their bus names."""
        own = ((w.field, given[w.source] if w.source in given else self.column(w.signal.word + VALID * w.flag))
               for w in detector.inputs(lane))  # fmt: skip
        return inputs(detector.module, self.ticks, own)


def flown_with(recording: Recording, ids: Iterable[str], files: Iterable[str | Path] = ()) -> list[Installed]:
    """Return the detectors `ids` that ship, and those of `files`, as they fly in the recording's scenario, with those
    that they read, `asked` False."""

    def enabled(scenario, names):
        detectors = scenario.detectors.model_copy(update={"enabled": tuple(names)})
        return scenario.model_copy(update={"detectors": detectors})

    scenario = plugins.with_detectors(enabled(recording.scenario, ids), files)
    asked = scenario.detectors.enabled
    found = chosen(enabled(scenario, with_sources(asked)))
    return [d if d.id in asked else dataclasses.replace(d, asked=False) for d in found]


@dataclass
class Judged:
    """What one lane came to on a recording: its entry of the result as a flight has it, what a step cost, and every
    answer in probabilities, (tick, {class: probability})."""

    entry: dict
    step_us: float
    told: list[tuple[int, Mapping[str, float]]]


def judgement(recording: Recording, detectors: Iterable[Installed], *, timed: bool = True) -> Iterator[Judged]:
    """Yield what every lane of `detectors` comes to. Raises LogError for a signal that the recording lacks."""
    scenario, dt, detectors = recording.scenario, recording.scenario.dt, list(detectors)
    given: dict[str, np.ndarray] = {}
    read = {w.source.split(".")[0] for d in detectors for lane in d.lanes for w in d.inputs(lane)
            if w.signal.kind == "detector"}  # fmt: skip
    for d in detectors:
        p = d.params(scenario, dt)
        for i, lane in enumerate(d.lanes):
            own, u, told = p[i : i + 1], recording.inputs(d, lane, given), []
            rollout = runner(d.module)
            if rollout:
                rollout.keeps, rollout.patience_s = True, PATIENCE_S
            stretch = unlogged(d, lane, d.module, u, own, rollout)
            with watched([rollout], lost=_end) if rollout else nullcontext():
                out, _, x = replay_lane(stretch, dt)
            out = np.repeat(out, d.every, axis=0)[: recording.ticks]
            if d.id in read:
                names = vocabulary.outputs(d.module)
                given |= {f"{d.id}.{lane}.{name}": np.ascontiguousarray(out[:, j]) for j, name in enumerate(names)}
            if not d.asked:
                continue
            us = cost(d.module, x, stretch.u[:, -1:], own, dt * d.every) if timed and not rollout else math.nan
            if rollout:
                us = rollout.seconds / max(1, rollout.steps) * 1e6
                told = [(k * d.every, said) for k, _, said in rollout.told]
            yield Judged(_entry(recording, d, lane, out.astype(np.float32)), us, told)


def _end(runner, text):
    """End a worker whose detector does not come back; its caller says which one it was."""
    if multiprocessing.parent_process() is not None:
        os._exit(1)


def _entry(recording, d, lane, out):
    """Return the entry of one lane from its outputs (ticks, fields) in the order of STATE."""
    names: dict[str, int] = {}

    def column(name):
        return names.setdefault(name, len(names))

    at = {f: column(f"{d.id}.{lane}.{f}") for f in columns(d.module.CULPRITS, d.module.OUTPUTS)}
    plan = estimation.plan(recording.scenario, d.id, lane, column)
    own = {f"{d.id}.{lane}.{f}": out[:, i] for i, f in enumerate(vocabulary.outputs(d.module))}
    trace = np.stack([own[n] if n in own else recording.column(n) for n in names], axis=1)
    watch = watch_of(d.id, d.level, d.target(lane), d.module.CULPRITS, at, estimate=plan)
    return judge(watch, trace, recording.scenario.dt, recording.faults)


def again(path: str | Path, scenario_toml: str, sha256: str) -> Recording:
    """Return the recording at `path`, flown again where the file is gone or damaged. Raises LogError where the flight
    is not the same any more."""
    try:
        return Recording(path, sha256)
    except LogError:
        record(parse(toml(scenario_toml, place=str(path))), path)
        return Recording(path, sha256)
