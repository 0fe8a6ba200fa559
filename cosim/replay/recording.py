"""A flight as its log tells it: scenario, signals, detector lanes with their judgement, and what they estimate."""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cosim.errors import LogError
from cosim.flight.faults import inject
from cosim.flight.loop import wiring
from cosim.judge import coverage
from cosim.judge import estimation as estimate
from cosim.judge.result import errors, judged
from cosim.judge.store import column_store, release
from cosim.log import open_log
from cosim.replay import log_schema
from cosim.replay.detector_replay import culprits_of, elements, guest_outputs, judgement, tell
from cosim.scenario.catalog import ACTUATOR_SENSORS, SENSORS
from cosim.scenario.vocabulary import place

SMALL = 128 << 20  # [byte] signals of a log up to this are read at once
NEEDED = tuple(f"/{top}/" for top in "truth surfaces sensors observers actuators faults detectors".split())


@dataclass
class Lane:
    """One detector lane: its outputs by field (rows,), its judgement, and which case it meets."""

    id: str
    level: str
    lane: str
    target: str
    culprits: tuple
    every: int
    fields: Mapping
    entry: dict
    units: dict  # of the fields, as the log has them
    # (field, call that returns the truth (ticks,), unit, start, end) of the fault that it estimates
    truth: tuple | None = None

    @property
    def able(self) -> bool:
        """Tell whether it could judge: the fault that its entry is about, or most of the flight."""
        return self.entry["able"]

    @property
    def name(self) -> str:
        """Return what it is called in figures: "iotsekf left inner"."""
        return self.id if self.level != "local" else f"{self.id} {words(self.lane)}"


def words(name: str) -> str:
    """Return a name of a part without underscores."""
    return name.replace("_", " ")


TOGETHER = 32  # chunks of a log that are read at once: a few megabytes


class LoggedFlight:
    """The content of one log. `values(topic, field)` is a column, NaN where there is none.

    Signals are read at once where they are few. Of a long log memory is bounded: what detectors said is read once into
    a store, in single precision as a run's result has it, any other field when it is asked for.
    """

    knows_faults = True  # else alarms are neither right nor false

    def __init__(self, path: str | Path, guests: Iterable[Any] = ()):
        """Read the log at `path`, also one that was cut. Raises LogError for one that holds no scenario.

        `guests` are made guests (cosim/parts) that are run on the flight as well.
        """
        self._guests = guests
        self.log = open_log(path, tolerant=True)
        self.scenario = log_schema.scenario(self.log)
        self.detectors = log_schema.detectors(self.log)
        self.toml = self.log.attachments["scenario.toml"].decode()
        if "/truth/aircraft" not in self.log.topics:
            raise LogError("holds no truth, only what a replay reads", place=str(path), remedy="Fly the scenario again")
        self._topics = [n for n in self.log.topics if n.startswith((*NEEDED, "/law"))]
        infos = [self.log.topics[n] for n in self._topics]
        small = sum(8 * t.rows * len(t.fields) for t in infos) <= SMALL
        self._arrays = {n: self.log.array(n) for n in self._topics} if small else None
        self.ticks = self.log.ticks("/truth/aircraft")
        self.dt = self.log.dt_ns / 1e9
        if not len(self.ticks):
            raise LogError("holds no tick", place=str(path), remedy="Fly it again")
        self.t0, self.end = float(self.ticks[0] * self.dt), float(self.ticks[-1] * self.dt)

    def has(self, topic: str, name: str) -> bool:
        """Tell whether the log has field `name` of `topic`."""
        return topic in self._topics and name in self.log.topics[topic].fields

    def values(self, topic: str, name: str) -> np.ndarray:
        """Return one logged signal (rows,)."""
        if not self.has(topic, name):
            return np.full(len(self.ticks), np.nan)
        if self._arrays is None:
            return self.log.array(topic, fields=[name])[:, 0]
        return self._arrays[topic][:, self.log.topics[topic].fields.index(name)]

    def _rows(self, topic):
        """Return all fields of a detector's lane as `judge` takes them: (rows, fields)."""
        if self._arrays is not None:
            return self._arrays[topic]
        info, at = self.log.topics[topic], 0
        rows = column_store(info.rows, len(info.fields))
        starts = [k for k, _ in self.log.spans[::TOGETHER]]
        for first, end in itertools.zip_longest(starts, starts[1:]):
            part = self.log.array(topic, start_s=first * self.dt, end_s=None if end is None else end * self.dt)
            rows[at : (at := at + len(part))] = part
            release(rows)
        return rows

    @cached_property
    def achieved(self) -> dict[str, dict[str, float | None]] | None:
        """Return how far the faults moved the elevators (cosim/flight/faults/fault_free_reference.py), None where the
        log does not say."""
        return log_schema.achieved(self.log)

    @cached_property
    def faults(self) -> list:
        """Return what `judge` takes of the faults."""
        return judged(self.scenario, self.achieved)

    @cached_property
    def cases(self) -> list[str]:
        """Return the case of each fault (cosim/judge/coverage.py)."""
        return coverage.cases(self.scenario)

    @cached_property
    def intervals(self) -> Any:
        """Return [(from, to)] during which any fault is active, merged, within the flight."""
        return joined((f["start_s"], min(f["end_s"], self.end)) for f in self.faults if f["start_s"] < self.end)

    @cached_property
    def lanes(self) -> list[Lane]:
        """Return the Lanes: aircraft level first, in the order of the log."""
        out = []
        for d in self.detectors:
            tell(d)
            for lane in d["lanes"]:
                topic = f"/detectors/{d['id']}/{lane}"
                if topic in self._topics:
                    units = dict(zip(self.log.topics[topic].fields, self.log.topics[topic].units))
                    record = SimpleNamespace(id=d["id"], level=d["level"], every=d["every"])
                    out.append(self._lane(record, lane, culprits_of(d), units, self._rows(topic)))
        flew = {lane.id for lane in out}
        for own in (g for g in self._guests if g.DETECTOR.id not in flew):
            names = dict(elements(own.STATE, own.OUTPUTS))
            for lane, told in guest_outputs(self.log, own, self.scenario.elevator.technology).items():
                out.append(self._lane(own.DETECTOR, lane, own.CULPRITS, names, told))
        return sorted(out, key=lambda lane: lane.level == "local")

    def _lane(self, record, lane, culprits, units, rows):
        entry = judgement(record, lane, culprits, units, rows, self.dt, self.faults)
        about = record.id, record.level, lane, entry["target"], culprits, record.every
        made = Lane(*about, dict(zip(units, rows.T)), entry, units, self._truth(record.id, lane))
        if made.truth:
            made.entry |= self._errors(made)
        return made

    def _truth(self, detector, lane):
        """Return `truth` of a Lane, None where it estimates no fault of the flight."""
        names: dict[str, int] = {}
        plan = estimate.plan(self.scenario, detector, lane, lambda name: names.setdefault(name, len(names)))
        if plan is None or plan.unit is None:
            return None
        named = list(names)

        def truth():
            return plan.truth(np.stack([self.signal(named[c]) for c in plan.columns]), self.dt)

        return named[plan.column].rpartition(".")[2], truth, plan.unit, plan.start, plan.end

    def _errors(self, lane):
        """Return RMSE, bias and maximum of a lane's estimate after settling, as a run's result has them."""
        name, truth, unit, start, end = lane.truth
        e = lane.fields[name] - truth()[:: lane.every][: len(lane.fields[name])]
        step = self.dt * lane.every
        late = slice(round((start - self.t0) / step), round((min(end, self.end + self.dt) - self.t0) / step))
        return errors(e[late], unit)

    def signal(self, name: str) -> np.ndarray:
        """Return the bus signal `name` (section.lane.field) at every tick, as far as the log tells it.

        An input that nobody logs is what the faults add to it; a sensor's truth is what it is wired to.
        """
        topic, field = place(name)
        if self.has(topic, field):
            return self.values(topic, field)
        if field == "truth":
            wired = dict(wiring.sensor_wires(self.scenario))
            return self.signal(wired[name])
        sources = [(f.name, source) for f in self._injected for to, source in f.places if to == name]
        return sum((self._fault(lane, source) for lane, source in sources), np.zeros(len(self.ticks)))

    @cached_property
    def _injected(self):
        return inject.lanes(self.scenario)

    def _fault(self, lane, source):
        topic = f"/faults/f{lane}"
        return -self.values(topic, "f_inj") if source == "f_neg" else self.values(topic, source)

    @cached_property
    def injected(self) -> Any:
        """Return [(label, unit, call that returns the signal (ticks,))] of every fault lane."""
        out = []
        for f in self._injected:
            kind, place = self.scenario.faults[f.fault].kind, f.places[0][0]
            switched = all(source == "g" for _, source in f.places)
            label, unit = f"{words(kind)}, {words(f.name.split('_', 1)[1])}", unit_of(place, kind)
            signal = partial(self._fault, f.name, "g" if switched else "f_inj")
            out.append((label, "active" if switched else unit, signal))
        return out

    @cached_property
    def provenance(self) -> Any:
        """Return {name: text}: versions, seed, hashes."""
        run, libraries = self.log.metadata.get("run", {}), self.log.metadata.get("libraries", {})
        result = self.log.result or {}
        out = {k: run[k] for k in ("software", "seed", "rate_hz", "ticks") if k in run} | dict(libraries)
        for name in ("content", *(k for k in result if k.startswith("sha256"))):
            if name in result:
                out[f"hash of {name}" if name == "content" else name] = result[name]
        if "sha256" in self.log.metadata.get("preamble", {}):
            out["hash of the preamble"] = self.log.metadata["preamble"]["sha256"]
        return out


def unit_of(place: str, kind: Any) -> Any:
    """Return the unit in which a fault enters at bus name `place`."""
    section, name, field = place.split(".", 2)
    if section == "sensors_in":  # of an actuator ("left_inner_rod") or of the aircraft
        known = {**ACTUATOR_SENSORS, **SENSORS}
        own = max((n for n in known if name == n or name.endswith(f"_{n}")), key=len, default="")
        return "share" if "scale" in field else known[own][0].si if own else ""
    if field in ("f_u", "s_u"):
        return "A" if section == "ema_in" else "valve, 1 = full"
    if field in ("f_cmd", "s_cmd"):
        return "rad"
    if field == "f_rate":
        return "rad/s"
    if kind == "backlash":
        return "m of screw travel" if section == "ema_in" else "rad of surface"
    if kind == "friction":
        return "N m at the motor" if section == "ema_in" else "share of the brake's force"
    return "share"


def spans(mask: np.ndarray, t0: float, dt: float) -> list[Any]:
    """Return [(from, to)] during which `mask` holds; a span ends where the next sample no longer holds."""
    edges = np.flatnonzero(np.diff(np.asarray(mask, bool), prepend=False, append=False))
    return [(t0 + a * dt, t0 + b * dt) for a, b in zip(edges[::2], edges[1::2])]


def joined(spans: Iterable[tuple[float, float]], gap: float = 0.0) -> list[tuple[float, float]]:
    """Return [(from, to)] in order, those joined that are no more than `gap` [s] apart."""
    out: list[tuple[float, float]] = []
    for a, b in sorted(spans):
        if out and a - out[-1][1] <= gap:
            a, b = out[-1][0], max(b, out.pop()[1])
        out.append((a, b))
    return out


def finite(x: Any) -> bool:
    """Tell whether x is a number at all."""
    return x is not None and math.isfinite(x)
