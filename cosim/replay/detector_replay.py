"""Detector lanes of a log: what each reads, its parameters and states, and how it is stepped again.

Measurements and commands stand in the log at every tick, parameters and initial states as attachments, whole states
every second.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from actuators.block import unit
from cosim.errors import LogError, among
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import wires
from cosim.judge.detection import JudgedLane
from cosim.log import Log
from cosim.parts import rollout_of
from cosim.replay import log_schema as schema
from cosim.scenario import vocabulary
from fdi import registry
from fdi.common.record import Detector, Estimate

SPAN = 2000  # ticks that are stepped together: 40 MB of the largest state


@dataclass
class Lane:
    """One detector lane: what it is, its parameters (1,), its state (1,) before tick `at`, what of a log it reads."""

    id: str
    lane: str
    level: str
    every: int
    module: Any
    p: np.ndarray
    x: np.ndarray
    reads: Sequence = ()  # (input, topic, field of the topic)
    rollout: Any = None  # of the module, or of a user detector with an object of its own per lane
    at: int | None = 0  # None: where the first whole state says

    def __post_init__(self):
        self.rollout = rollout_of(self.module, (self.lane,))

    @property
    def notes(self) -> list[str]:
        """Return what is to be said of a user detector that was stepped: that its lane is dropped, and why."""
        return getattr(self.rollout, "notes", [])

    @property
    def topic(self) -> str:
        """Return the topic of the outputs."""
        return f"/detectors/{self.id}/{self.lane}"

    @property
    def hidden(self) -> str:
        """Return the topic of the hidden state's snapshots."""
        return f"/state/{self.id}/{self.lane}"

    @property
    def outputs(self) -> list[tuple[str, str]]:
        """Return [(field of a log, unit)] of the outputs."""
        return elements(self.module.STATE, self.module.OUTPUTS)

    def inputs(self, log: Log, read: Mapping[str, np.ndarray], start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        """Return its ticks (rows,) and INPUTS (1, rows) of start <= k < stop; `read` {topic: its values in these}."""
        own = np.arange(-(-start // self.every) * self.every, min(stop, log.n_ticks), self.every)
        ticks = log.ticks(self.topic, start, stop) if self.topic in log.topics else own
        return ticks, inputs(self.module, len(ticks), self._columns(log, read, start, stop, ticks))

    def _columns(self, log, read, start, stop, ticks):
        for name, source, field in self.reads:
            same = log.topics[source].every == self.every
            rows = slice(None) if same else np.searchsorted(log.ticks(source, start, stop), ticks)
            yield name, read[source][rows, log.topics[source].fields.index(field)]

    def restore(self, outputs: np.ndarray, hidden: np.ndarray, tick: int) -> None:
        """Take the whole state after tick `tick`, as it was logged. Raises LogError for one that cannot be."""
        for at, values in zip(split(self.module), (outputs, hidden)):
            flat(self.x)[0, at] = values
        schema.trusted(f"{self.hidden}, tick {tick}", registry.record(self.id), self.module, self.x)
        self.at = tick + self.every

    def step(self, u: np.ndarray, dt: float, whole: Any = ()) -> tuple[np.ndarray, np.ndarray]:
        """Step it through its next inputs u (1, rows), ticks of `dt` [s]; return its outputs (rows, n), and its hidden
        states (m, h) after the rows `whole` (m,)."""
        outputs, hidden = split(self.module)
        states = np.zeros(u.shape, self.module.STATE)
        self.rollout(self.x, u, self.p, dt * self.every, states)
        seen = flat(states)[0]
        return seen[:, outputs], seen[np.ix_(np.array(whole, int), hidden)]


def judged_lane(name: str, level: str, lane: str, parts: tuple, outputs: Iterable[str]) -> JudgedLane:
    """Return a lane of detector `name` as the judgement sees it: what it watches, its `outputs` in order."""
    target = f"elevator.{lane}" if level == "local" else "aircraft"
    return JudgedLane(name, level, target, parts, {n: i for i, n in enumerate(outputs)})


def tick_of(log: Log) -> Any:
    """Return the tick of a log's flight [s]: 1 / rate, which whole nanoseconds are only near to at 333 Hz."""
    rate = log.metadata.get("run", {}).get("rate_hz", "")
    hertz = int(rate) if rate.isdecimal() and len(rate) < 6 else 0
    return 1.0 / hertz if hertz and round(1e9 / hertz) == log.dt_ns else log.dt_ns * 1e-9


def describe(log: Log, chosen: Any = None, overrides: Mapping[str, Any] | None = None) -> list[Lane]:
    """Return the lanes of the detectors in `chosen` (all) whose code is here.

    `overrides` is {detector: {parameter: value}}. Raises LogError for one that is laid out otherwise than here.
    """
    found, place = schema.detectors(log), str(log.path)
    strange = [d["id"] for d in found if d["id"] not in registry.SHIPPED and "user_detector" not in d]
    if strange:
        raise schema.older(log, f"detector {strange[0]!r}")
    if log.metadata.get("run", {}).get("log_profile") == "signals":
        remedy = "Fly it again with log_profile = 'full' or 'replay'"
        raise schema.ReplayError("holds signals alone, not what detectors read", place=place, remedy=remedy)
    known = [d["id"] for d in found]
    for name in [*(chosen or ()), *(overrides or {})]:
        among(name, known, f"the log has no detector {name!r}", error=schema.ReplayError, place=place)
    schema.chosen_overrides(chosen, overrides)
    gone = next((d for d in found if d["id"] in (overrides or {}) and not registry.known(d["id"])), None)
    if gone:
        raise schema.ReplayError(code_that_flew(gone), place="--set")
    mine = [d for d in found if (not chosen or d["id"] in chosen) and registry.known(d["id"])]
    return [lane for d in mine for lane in _flown(log, d, (overrides or {}).get(d["id"], {}))]


def _flown(log, d, changes):
    """Return the lanes of one detector, its parameters with `changes`."""
    record, module = registry.record(d["id"]), registry.module(d["id"])
    p = schema.attached(log, f"{d['id']}.params", module.PARAMS, len(d["lanes"]))
    x = schema.attached(log, f"{d['id']}.initial", module.STATE, len(d["lanes"]))
    schema.trusted(str(log.path), record, module, x, p, tick_of(log))
    schema.override(record, module, p, changes, tick_of(log))
    out = []
    for i, lane in enumerate(d["lanes"]):
        own = Lane(d["id"], lane, d["level"], d["every"], module, p[i : i + 1], x[i : i + 1], d["inputs"][lane])
        _check(log, own)
        out.append(own)
    return out


def _check(log, lane):
    """Raise LogError unless the log's topics are those of this version of the detector."""
    fields = {name: topic.fields for name, topic in log.topics.items()}
    if lane.topic not in fields:
        raise LogError(f"the log lacks {lane.topic}, which its detectors.json names", place=str(log.path))
    if fields[lane.topic] != tuple(name for name, _ in lane.outputs):
        raise schema.older(log, lane.topic)
    if len(split(lane.module)[1]) != len(fields.get(lane.hidden, ())):
        raise schema.older(log, lane.hidden)
    for name, source, column in lane.reads:
        if column not in fields.get(source, ()) or name.partition("[")[0] not in lane.module.INPUTS.names:
            raise schema.older(log, f"{source}.{column}, which {lane.id} reads as {name},")


def unflown(log: Log, part: Any, technologies: dict[str, str]) -> list[Lane]:
    """Return the lanes of a user detector on a log in which it did not fly: it reads what the observers had.

    Raises ReplayError for a signal that the log lacks, or for a log with gaps.
    """
    record, out = part.DETECTOR, []
    if not log.n_ticks or log.gaps:
        raise schema.ReplayError("ticks are missing, and a user detector begins with the flight", place=str(log.path))
    local = [s for s, t in technologies.items() if t in record.technologies]
    for lane in local if record.level == "local" else ("",):
        reads = [(w.field, *_source(log, w)) for w in wires(record, lane)]
        p = record.fit(site(tick_of(log), lane, technologies))
        out.append(Lane(record.id, lane or "aircraft", record.level, record.every, part, p, part.init(p), reads))
    return out


def _source(log, wire):
    """Return (topic, field) of a signal as the observers had it: their own copy where the log has one."""
    topic, field = wire.signal.topic, wire.signal.field + "_valid" * wire.flag
    for name in (topic.replace("/sensors/", "/observers/"), topic):
        if name in log.topics and field in log.topics[name].fields:
            return name, field
    raise schema.ReplayError(f"the log has no {topic}.{field}", place=str(log.path))


def topics(log: Log, lanes: Iterable[Lane]) -> list[str]:
    """Return the topics that the lanes read or gave."""
    found = [t for lane in lanes for t in (lane.topic, lane.hidden, *(source for _, source, _ in lane.reads))]
    return [t for t in dict.fromkeys(found) if t in log.topics]


def stretches(log: Log, names: Iterable[str], start: int, stop: int) -> Iterator[tuple[range, dict[str, np.ndarray]]]:
    """Yield (ticks, {topic: (rows, fields)}) of the ticks start <= k < stop, SPAN of them at a time."""
    names = list(dict.fromkeys(names))
    for a in range(start, stop, SPAN):
        ticks = range(a, min(a + SPAN, stop))
        bounds = {"start_s": a * log.dt_ns / 1e9, "end_s": ticks.stop * log.dt_ns / 1e9}
        yield ticks, {name: log.array(name, **bounds) for name in names}


def inputs(module: Any, n: int, values: Iterable[tuple[str, Any]]) -> np.ndarray:
    """Return INPUTS (1, n) of a detector from the (input, its values (n,)); `name[i]` is an element."""
    u = np.zeros((1, n), module.INPUTS)
    for name, y in values:
        base, _, element = name.partition("[")
        own = u[base][0][:, int(element[:-1])] if element else u[base][0]
        own[:] = y
    return u


def elements(kind: Any, names: Sequence[str]) -> list[tuple[str, str]]:
    """Return [(field of a log, unit)] of the elements of fields `names` of a record, in memory order."""
    return [(vocabulary.column(name), unit(kind, name)) for name in vocabulary.elements(kind, names)]


@lru_cache(maxsize=64)
def split(module: Any) -> tuple:
    """Return the positions of a detector's (outputs, hidden state) in its STATE seen as float64, in memory order."""
    kind = module.STATE
    own = [np.full(kind[n].itemsize // 8, n in module.OUTPUTS) for n in kind.names]
    return np.flatnonzero(np.concatenate(own)), np.flatnonzero(~np.concatenate(own))


def flat(records: np.ndarray) -> np.ndarray:
    """Return records as float64, (..., values)."""
    return records.view(np.float64).reshape(*records.shape, -1)


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


def code_that_flew(entry: dict) -> str:
    """Return a sentence where the code of a detector of a log is not here, or not the one that flew, else ""."""
    name, about = entry["id"], entry.get("user_detector") or {}
    if not registry.known(name):
        return f"{name} is a user detector, and its code is not here: give it by --detector {about.get('file') or name}"
    flew, here = about.get("sha256", ""), registry.USER_DETECTORS.get(name)
    if not flew or here is None or here.sha256 == flew:
        return ""
    return f"{name} is not the code that flew: digest {here.sha256[:12]} here, {flew[:12]} in the log"
