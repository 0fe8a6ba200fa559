"""A flight as its log tells it: scenario, signals, detector lanes with their judgement, and what they estimate.

A log may be hours long: it is read some chunks at a time, and of each column only what a page draws is kept.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import LogError
from cosim.flight.faults import inject
from cosim.flight.loop import wiring
from cosim.judge import coverage
from cosim.judge import estimation as estimate
from cosim.judge.detection import JudgedLane, Said
from cosim.judge.result import Errors, entry_of, judged
from cosim.log import open_log
from cosim.replay import log_schema
from cosim.replay.detector_replay import isolable_parts_of, judged_lane, stretches, tell, topics, unflown
from cosim.replay.thinned import envelope, peaks
from cosim.scenario.catalog import ACTUATOR_SENSORS, SENSORS
from cosim.scenario.vocabulary import place

BASE = "/truth/aircraft"  # has a row at every tick
DRAWN = ("/truth/", "/law", "/sensors/", "/faults/")  # topics whose fields a page draws
PLACES = 400  # of the aircraft's path
ESTIMATE = ("all", "valid", "not_valid", "low", "high")  # curves of an estimate: with its two-sigma band

INJECTED = {  # field of an actuator's inputs, or kind of fault -> unit of a hydraulic actuator's, of an EMA's
    **dict.fromkeys(("f_u", "s_u"), ("valve, 1 = full", "A")), **dict.fromkeys(("f_cmd", "s_cmd"), ("rad", "rad")),
    "f_rate": ("rad/s", "rad/s"), "backlash": ("rad of surface", "m of screw travel"),
    "friction": ("share of the brake's force", "N m at the motor"),
}  # fmt: skip


class Lane:
    """One detector lane: its judgement, what it said where that changes, its statistic and one estimate as drawn.

    `add` takes its outputs in blocks, `end` judges them; `at` is the column of each, `units` its unit. `main` is the
    estimate that is drawn, "" for none, `truth` (curve, unit) of the fault that it estimates.
    """

    def __init__(
        self, own: JudgedLane, lane: str, every: int, units: Sequence[str], rows: int, main: str, dt: float,
        faults: Sequence[Mapping] = (),
    ):  # fmt: skip
        """`every` are the ticks of `dt` [s] from step to step of the lane `own`, `units` those of its outputs in order,
        `rows` is their number."""
        self.id, self.level, self.target = own.id, own.level, own.target
        self.at, self.isolable_parts = own.at, own.parts
        self.lane, self.every, self.units, self.main = lane, every, dict(zip(own.at, units)), main
        self.entry: dict = {}
        self.truth: tuple[tuple[np.ndarray, float], str] | None = None
        self._dt, self._faults = dt * every, faults
        self.said = Said(own, self._dt, faults)
        (self._r, self._r_every), (self._f, self._f_every) = peaks(rows), envelope(rows)
        estimates = [n for n in own.at if n.startswith("f_hat")]
        named = f"f_sigma{main.removeprefix('f_hat')}"
        self._sigma = named if named in own.at else "f_sigma" if main in ("f_hat", *estimates[:1]) else ""

    def add(self, rows: np.ndarray) -> None:
        """Take the outputs (rows, fields) of its next ticks."""
        self.said.add(rows)
        self._r.add(np.abs(rows[:, [self.at["r"]]]))
        if self.main:
            f, ok = rows[:, self.at[self.main]].astype(float), rows[:, self.at["valid"]] > 0.5
            half = 2.0 * rows[:, self.at[self._sigma]] if self._sigma in self.at else np.nan
            valid = np.where(ok, f, np.nan)
            self._f.add(np.stack([f, valid, np.where(ok, np.nan, f), valid - half, valid + half], axis=1))

    def end(self) -> "Lane":
        """Judge what it said; return itself."""
        self.entry = entry_of(self.said, self._dt, self._faults)
        return self

    @property
    def r(self) -> tuple[np.ndarray, float]:
        """Return (largest |r| of each of some intervals, rows per value)."""
        return self._r.values()[:, 0], self._r_every

    def estimate(self, curve: str) -> tuple[np.ndarray, float]:
        """Return (values, rows per value) of one of the curves ESTIMATE."""
        return self._f.values()[:, ESTIMATE.index(curve)], self._f_every

    @property
    def able(self) -> bool:
        """Tell whether it could judge: the fault that its entry is about, or most of the flight."""
        return self.entry["able"]

    @property
    def name(self) -> str:
        """Return what it is called in figures: "iotsekf left inner"."""
        return self.id if self.level != "local" else f"{self.id} {words(self.lane)}"

    def spans(self, output: str, t0: float) -> list[tuple[float, float]]:
        """Return [(from, to)] [s] during which an output is above one half; `t0` is the time of the first tick."""
        return [(t0 + a * self._dt, t0 + b * self._dt) for a, b in self.said.spans(output)]


def words(name: str) -> str:
    """Return a name of a part without underscores."""
    return name.replace("_", " ")


class LoggedFlight:
    """The content of one log up to its end or its first hole, read some chunks at a time: memory does not grow with
    its length."""

    knows_faults = True  # else alarms are neither right nor false

    def __init__(self, path: str | Path, user_detectors: Iterable[Any] = ()):
        """Open the log at `path`, also one that was cut. Raises LogError for one that holds no scenario.

        `user_detectors` are made ones (cosim/parts) that are run on the flight as well.
        """
        self._user_detectors = user_detectors
        self.log = open_log(path, tolerant=True)
        self.scenario = log_schema.scenario(self.log)
        self.cases = coverage.cases(self.scenario)  # of each fault
        self.detectors = log_schema.detectors(self.log)
        self.toml = self.log.attachments["scenario.toml"].decode()
        if BASE not in self.log.topics:
            raise LogError("holds no truth, only what a replay reads", place=str(path), remedy="Fly the scenario again")
        self.dt, self.n = self.log.dt_ns / 1e9, 0
        for first, ticks in self.log.spans:  # what a detector said behind a hole is not judged
            if first != self.n:
                break
            self.n += ticks
        if not self.n:
            raise LogError("holds no tick from the start of its flight", place=str(path), remedy="Fly it again")
        self.t0, self.end = 0.0, (self.n - 1) * self.dt

    def _rows(self, every):
        """Return the number of rows of a topic."""
        return -(-self.n // every)

    def has(self, topic: str, name: str) -> bool:
        """Tell whether the log has field `name` of `topic`."""
        return topic in self.log.topics and name in self.log.topics[topic].fields

    @cached_property
    def _drawn(self):
        """Return ({topic: (Thinned, rows per value)} of DRAWN, (PLACES, 4) of t [s], latitude, longitude [rad], height
        [m] along the path)."""
        made = {n: envelope(self._rows(t.every)) for n, t in self.log.topics.items() if n.startswith(DRAWN)}
        at = [self.log.topics[BASE].fields.index(n) for n in ("lat", "lon", "h")]
        picks, path = np.unique(np.linspace(0, self.n - 1, PLACES).astype(int)), []
        for ticks, read in stretches(self.log, made, 0, self.n):
            for name, (thinned, _) in made.items():
                thinned.add(read[name])
            own = picks[(picks >= ticks.start) & (picks < ticks.stop)]
            path.append(np.column_stack([self.t0 + self.dt * own, read[BASE][own - ticks.start][:, at]]))
        return made, np.concatenate(path)

    @property
    def path(self) -> np.ndarray:
        """Return (places, 4): t [s], latitude, longitude [rad] and height [m] at even distances in time."""
        return self._drawn[1]

    def curve(self, topic: str, name: str) -> tuple[np.ndarray, float]:
        """Return (values, ticks per value) of a logged signal as it is drawn; NaN where there is none."""
        if not self.has(topic, name):
            return np.full(2, np.nan), self.n / 2
        thinned, every = self._drawn[0][topic]
        return thinned.values()[:, self.log.topics[topic].fields.index(name)], every

    @cached_property
    def achieved(self) -> dict[str, dict[str, float | None]] | None:
        """Return how far the faults moved the elevators (cosim/flight/faults/fault_free_reference.py), None where the
        log does not say."""
        return log_schema.of_result(self.log, "achieved")

    @cached_property
    def faults(self) -> list:
        """Return what `judge` takes of the faults."""
        return judged(self.scenario, self.achieved)

    @cached_property
    def intervals(self) -> Any:
        """Return [(from, to)] during which any fault is active, merged, within the flight."""
        return joined((f["start_s"], min(f["end_s"], self.end)) for f in self.faults if f["start_s"] < self.end)

    @cached_property
    def lanes(self) -> list[Lane]:
        """Return the Lanes: aircraft level first, in the order of the log."""
        watched = [(own, topic, truth) for d in self.detectors for own, topic, truth in self._watched(d)]
        new = list(self._unflown({own.id for own, *_ in watched}))
        read_by = [t for _, topic, truth in watched for t in (topic, *(truth.topics if truth else ()))]
        read_by += topics(self.log, (lane for _, lane in new))
        for ticks, read in stretches(self.log, read_by, 0, self.n):
            for own, topic, truth in watched:
                if truth:
                    truth.add(own, ticks, read, read[topic])
                own.add(read[topic])
            for own, lane in new:
                own.add(lane.step(lane.inputs(self.log, read, ticks.start, ticks.stop)[1], self.dt)[0])
        out = [own.end() for own, *_ in (*watched, *new)]
        for own, _, truth in watched:
            if truth:
                own.truth = truth.curve, truth.unit
                own.entry |= truth.errors.entry(truth.unit)
        return sorted(out, key=lambda lane: lane.level == "local")

    def _unflown(self, flew):
        """Yield (Lane, the lane to step) of the user detectors that did not fly."""
        for part in (g for g in self._user_detectors if g.DETECTOR.id not in flew):
            for lane in unflown(self.log, part, self.scenario.elevator.technology):
                names, units = zip(*lane.outputs)
                own = judged_lane(lane.id, lane.level, lane.lane, part.ISOLABLE_PARTS, names)
                rows = self._rows(lane.every)
                yield Lane(own, lane.lane, lane.every, units, rows, "", self.dt, self.faults), lane

    def _watched(self, d):
        """Yield (Lane, its topic, _Truth or None) of the lanes of a detector."""
        tell(d)
        topics = {lane: f"/detectors/{d['id']}/{lane}" for lane in d["lanes"]}
        truths = {lane: self._truth(d["id"], lane) for lane, topic in topics.items() if topic in self.log.topics}
        main = next((t.output for t in truths.values() if t), "")
        for lane, truth in truths.items():
            info = self.log.topics[topics[lane]]
            own = main or next((n for n in info.fields if n.startswith("f_hat")), "")
            judged_ = judged_lane(d["id"], d["level"], lane, isolable_parts_of(d), info.fields)
            made = Lane(judged_, lane, d["every"], info.units, self._rows(info.every), own, self.dt, self.faults)
            yield made, info.name, truth

    def _truth(self, detector, lane):
        """Return the _Truth of a lane, None where it estimates no fault of the flight."""
        names: dict[str, int] = {}
        plan = estimate.plan(self.scenario, detector, lane, lambda name: names.setdefault(name, len(names)))
        return None if plan is None or plan.unit is None else _Truth(self, plan, list(names))

    def sources(self, name: str) -> list[tuple[str, str, float]]:
        """Return [(topic, field, sign)] whose sum is the bus signal `name` (section.lane.field), as the log tells it.

        An input that nobody logs is what the faults add to it; a sensor's truth is what it is wired to.
        """
        topic, field = place(name)
        if self.has(topic, field):
            return [(topic, field, 1.0)]
        if field == "truth":
            return self.sources(dict(wiring.wires(self.scenario)["sensors"])[name])
        return [_fault(f.name, source) for f in self._injected for to, source in f.places if to == name]

    @cached_property
    def _injected(self):
        return inject.lanes(self.scenario)

    @cached_property
    def injected(self) -> Any:
        """Return [(label, unit, (values, ticks per value))] of every fault lane."""
        out = []
        for f in self._injected:
            kind, place = self.scenario.faults[f.fault].kind, f.places[0][0]
            switched = all(source == "g" for _, source in f.places)
            label, unit = f"{words(kind)}, {words(f.name.split('_', 1)[1])}", unit_of(place, kind)
            curve = self.curve(f"/faults/f{f.name}", "g" if switched else "f_inj")
            out.append((label, "active" if switched else unit, curve))
        return out

    @cached_property
    def provenance(self) -> Any:
        """Return {name: text}: versions, seed, hashes."""
        run, libraries = self.log.metadata.get("run", {}), self.log.metadata.get("libraries", {})
        out = {k: run[k] for k in ("software", "seed", "rate_hz", "ticks") if k in run} | dict(libraries)
        if self.log.result:
            out["hash of content"] = self.log.result["content"]
        return out | {"hash of the preamble": self.log.metadata["preamble"]["sha256"]}


class _Truth:
    """What a lane's estimate should be, and its errors after settling, stretch by stretch."""

    def __init__(self, flown: LoggedFlight, plan: Any, names: list[str]):
        self.output, self.unit, self.errors = names[plan.column].rpartition(".")[2], plan.unit, Errors()
        self._plan, self._flown = plan, flown
        self._kept: dict[str, Any] = {}
        self._sources = [flown.sources(names[c]) for c in plan.columns]
        self._drawn, self._every = envelope(flown.n)
        self.topics = [BASE, *(topic for own in self._sources for topic, *_ in own)]

    def add(self, lane: Lane, ticks: range, read: Mapping, rows: np.ndarray) -> None:
        """Take a stretch, with the outputs `rows` of the lane, which has not taken them yet."""
        log, step = self._flown.log, self._flown.dt * lane.every
        columns = [sum((sign * read[topic][:, log.topics[topic].fields.index(field)] for topic, field, sign in own),
                       np.zeros(len(read[BASE]))) for own in self._sources]  # fmt: skip
        truth = self._plan.truth(np.stack(columns), self._flown.dt, self._kept)
        self._drawn.add(truth[:, None])
        own = truth[-ticks.start % lane.every :: lane.every]
        ends = self._plan.start, min(self._plan.end, self._flown.end + self._flown.dt)
        first, stop = (max(0, round((t - self._flown.t0) / step) - lane.said.ticks) for t in ends)
        self.errors.add((rows[:, lane.at[self.output]] - own)[first:stop])

    @property
    def curve(self) -> tuple[np.ndarray, float]:
        """Return (values, ticks per value)."""
        return self._drawn.values()[:, 0], self._every


def _fault(lane, source):
    """Return (topic, field, sign) of what a fault lane adds."""
    return (f"/faults/f{lane}", "f_inj", -1.0) if source == "f_neg" else (f"/faults/f{lane}", source, 1.0)


def unit_of(place: str, kind: Any) -> Any:
    """Return the unit in which a fault enters at bus name `place`."""
    section, name, field = place.split(".", 2)
    if section == "sensors_in":  # of an actuator ("left_inner_rod") or of the aircraft
        known = {**ACTUATOR_SENSORS, **SENSORS}
        own = max((n for n in known if name == n or name.endswith(f"_{n}")), key=len, default="")
        return "share" if "scale" in field else known[own][0].si if own else ""
    hydraulic, ema = INJECTED.get(field) or INJECTED.get(kind) or ("share", "share")
    return ema if section == "ema_in" else hydraulic


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
