"""The detectors that fly: which lanes each has, what it reads, with which parameters.

A detector's inputs are copies of logged signals, named by the words of its record; the manifest with their places goes
into the log, so that replay needs nothing but the file.
"""

import functools
import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

import fdi
from actuators.kernels import cached_array
from cosim import parts
from cosim.errors import ScenarioError, did_you_mean
from cosim.flight.blocks.sensors import installed
from cosim.flight.detection import stored_designs
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.parameters import assign, wrong_parameter
from cosim.scenario import Scenario, vocabulary
from cosim.scenario.aircraft import Aircraft, load_aircraft, stamps
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.user_parts import identity
from fdi import registry
from fdi.common.record import Detector


class Wire(NamedTuple):
    """One input of a lane: its field, the signal that it reads, and whether it takes its value or its validity."""

    field: str
    signal: vocabulary.Signal
    flag: bool

    @property
    def source(self) -> str:
        """Return the name on the bus."""
        return self.signal.flag if self.flag else self.signal.source


def wires(record: Detector, lane: str = "", module: ModuleType | None = None, aircraft: Aircraft | None = None) -> list:
    """Return the Wires of a detector on segment `lane` ("" at aircraft level); what has a flag brings it, to
    `<field>_valid` or `<word>_valid` where INPUTS has such a field. On another `aircraft` than the default one a
    segment or an engine of its words is the one in that place (`placed`)."""
    names, out = (module or registry.module(record.id)).INPUTS.names, []
    for field, word in record.inputs.items():
        signal = vocabulary.find(placed(word, aircraft) if aircraft else word, lane)
        out.append(Wire(field, signal, False))
        if signal.flag:
            base, bracket, index = field.partition("[")
            flag = next((n for n in (f"{base}_valid", f"{word}_valid") if n in names), "")
            if flag:
                out.append(Wire(flag + bracket + index, signal, True))
    return out


def placed(word: str, aircraft: Aircraft) -> str:
    """Return an aircraft's word for one of a shipped detector, which names segments and engines of the default one.

    A side with one segment has it in both places, a twin's engine stands for two. The word itself, which this aircraft
    then lacks, where nothing is in that place.
    """
    if detector := vocabulary.detector_of(word):
        return f"{detector}.{placed(word.removeprefix(detector + '.'), aircraft)}"
    segment, _, what = word.rpartition(".")
    if segment in SEGMENTS and segment not in aircraft.segments:
        side, place = segment.split("_")
        own, first = aircraft.groups[side], (place == "outer") == (side == "left")
        return f"{own[0 if first else -1]}.{what}" if 0 < len(own) < 3 else word
    if what in N1 and ENGINES % aircraft.engines == 0:
        return N1[N1.index(what) * aircraft.engines // ENGINES]
    return word


def sources(name: str, lane: str = "", aircraft: Aircraft | None = None) -> dict[str, Any]:
    """Return {input field: name on the bus} of detector `name`."""
    return {w.field: w.source for w in wires(registry.record(name), lane, aircraft=aircraft)}


ENGINES = load_aircraft().engines
N1 = tuple(f"n1_{name}" for name in load_aircraft().engine_names)
_FITS: dict[tuple, np.ndarray] = {}  # of shipped detectors, by all that their designs depend on
MOST_FITS = 256


def _fit(detector, site, own, words, stored):
    """Return a lane's PARAMS; a shipped detector is designed once for the same place, words and `stored` designs."""
    if registry.SHIPPED.get(detector.id) != getattr(detector.module, "__name__", ""):
        return detector.record.fit(site, **words)
    place = site.dt, site.lane, site.technology, *site.technologies.items(), *sorted(site.actuator.items()), site.travel
    key = detector.id, place, str(own.folder), stamps(own.folder), *sorted(words.items()), stored
    if key not in _FITS:
        if len(_FITS) >= MOST_FITS:
            _FITS.clear()
        about = detector.id, place, identity(own.folder).sha256, *sorted(words.items()), stored
        made = functools.partial(detector.record.fit, site, **words)
        _FITS[key] = cached_array(about, detector.module.PARAMS, made, str(detector.module.__file__))
    return _FITS[key]


def _stored(own):
    """Return when the stored designs and thresholds were written, those of an aircraft's folder `own` among them."""
    roots = [Path(fdi.__file__).parent, *([own] if own else [])]
    folders = [root / name for root in roots for name in ("designs", "thresholds") if (root / name).is_dir()]
    return tuple(file.stat().st_mtime_ns for folder in folders for file in os.scandir(folder))


@dataclass(frozen=True)
class Installed:
    """A detector in one flight: its record, its block, the lanes that it has there."""

    record: Detector
    module: ModuleType
    lanes: tuple
    aircraft: Aircraft
    absent: frozenset = frozenset()  # outputs of other detectors, names on the bus, that this flight lacks

    @property
    def id(self) -> str:
        """Return its id."""
        return self.record.id

    @property
    def level(self) -> str:
        """Return "local", "aircraft" or "both"."""
        return self.record.level

    @property
    def every(self) -> int:
        """Return the ticks of the loop from step to step."""
        return self.record.every

    def params(self, scenario: Scenario, dt: float) -> np.ndarray:
        """Return the PARAMS of all lanes; the scenario's own values replace fields. Raises ScenarioError for one that
        is no number or out of range."""
        table, options = scenario.detectors.table(self.id), self.record.options
        if self.id not in registry.SHIPPED:
            table = {name: value for name, value in table.items() if name not in parts.KEYS}
        words = {n: _word(self.id, n, table.pop(n), allowed) for n, allowed in options.items() if n in table}
        technology, own = scenario.elevator.technology, scenario.aircraft
        lanes, told = self.lanes if self.level == "local" else [""], scenario.elevator.parameters
        sites = [site(dt, lane, technology, own, told[lane].model if lane in told else None) for lane in lanes]
        stored = _stored(own.own_designs)
        p = np.concatenate([_fit(self, s, own, words, stored) for s in sites])
        for name, value in table.items():
            place = f"detectors.{self.id}.{name} = {value}"
            if isinstance(value, str):
                raise ScenarioError("is no number", place=place, allowed="a number")
            assign(self.record, self.module, p, name, float(value), dt, error=ScenarioError, place=place)
        if wrong := table and wrong_parameter(self.record, self.module, p, dt):
            name, value, low, high = wrong
            said, allowed = f"index {value:g} is out of range", f"a whole number from {low:g} to {high:g}"
            raise ScenarioError(said, place=f"detectors.{self.id}.{name}", allowed=allowed)
        return p

    def inputs(self, lane: str) -> list:
        """Return the Wires of a lane."""
        if lane not in self._inputs:
            found = wires(self.record, lane if self.level == "local" else "", self.module, self.aircraft)
            self._inputs[lane] = [w for w in found if w.source not in self.absent]
        return self._inputs[lane]

    @functools.cached_property
    def _inputs(self) -> dict[str, list]:
        return {}

    def wires(self, of_detectors: bool | None = None) -> list[Any]:
        """Return [(input, source)] of all lanes, as names of the bus: all of them, or those alone that are outputs of
        other detectors (`of_detectors` True) or are not (False)."""
        return [(f"{self.id}_in.{lane}.{w.field}", w.source) for lane in self.lanes for w in self.inputs(lane)
                if of_detectors in (None, w.signal.kind == "detector")]  # fmt: skip

    def target(self, lane: str) -> str:
        """Return the name of what a lane watches."""
        return f"elevator.{lane}" if self.level == "local" else "aircraft"


def _word(detector, name, value, allowed):
    if value not in allowed:
        raise ScenarioError(f"{value!r} is no choice", place=f"detectors.{detector}.{name}",
                            allowed=", ".join(allowed), remedy=did_you_mean(str(value), allowed))  # fmt: skip
    return value


def unfit(record: Detector, aircraft: Aircraft) -> str:
    """Return which input of a detector an aircraft lacks, or ""."""
    shipped = record.level != "local" and record.id in registry.SHIPPED
    for word in (placed(word, aircraft) if shipped else word for word in record.inputs.values()):
        segment, dot, _ = word.rpartition(".")
        if vocabulary.detector_of(word):
            continue
        if dot and segment not in aircraft.segments:
            return f"no elevator segment {segment}"
        if word.startswith("n1_") and word not in installed(aircraft):
            return f"it reads {word}, the aircraft has {aircraft.engines} engine{'s' * (aircraft.engines > 1)}"
    return ""


def missing(record: Detector, aircraft: Aircraft) -> str:
    """Return why a detector cannot watch an aircraft, or "": an input that it lacks, or no design for it."""
    shipped = record.level != "local" and record.id in registry.SHIPPED
    why = unfit(record, aircraft)
    if not why and shipped and not record.any_aircraft and aircraft.own_designs:
        return stored_designs.lacking(aircraft, record)
    return why


def left_out(scenario: Scenario) -> dict[str, str]:
    """Return {detector: why} of those that the scenario runs and its aircraft, or its elevators, cannot have."""
    parts.use(scenario)
    own, out = scenario.aircraft, {}
    for name in scenario.running:
        record = registry.record(name)
        if why := missing(record, own) or record.lacks(scenario.elevator.technology, own.own_designs):
            out[name] = why
    return out


def chosen(scenario: Scenario) -> list:
    """Return the Installed detectors of a scenario, in its order; one without an actuator of its technologies, or that
    its aircraft cannot have, is left out. One that reads another comes after it (`ordered`)."""
    technology, out, lost = scenario.elevator.technology, [], left_out(scenario)
    for name in scenario.running:
        record = registry.record(name)
        own = tuple(s for s, t in technology.items() if t in record.technologies)
        lanes = own if record.level == "local" else ("aircraft",)
        if lanes and name not in lost:
            out.append(Installed(record, registry.module(name), lanes, scenario.aircraft))
    return ordered(out)


def ordered(found: list[Installed]) -> list[Installed]:
    """Return detectors with each after those whose outputs it reads: first those that read none, in their order.

    Raises ScenarioError for an output that none of them has, for detectors that wait for each other, and for one that
    steps more often than what it reads.
    """
    others = {d.id: d for d in found}
    found = [_connected(d, others) for d in found]
    sorter: TopologicalSorter = TopologicalSorter()
    for d in found:
        sorter.add(d.id)
    for d in found:
        reads = {w.source.split(".")[0] for lane in d.lanes for w in d.inputs(lane) if w.signal.kind == "detector"}
        sorter.add(d.id, *sorted(reads & others.keys()))
    try:
        order = [*sorter.static_order()]
    except CycleError as error:
        way = error.args[1][::-1]
        said = f"detectors wait for each other: {' reads '.join(way)}"
        remedy = "A detector may read only those that do not read it"
        raise ScenarioError(said, place=f"detectors.{way[0]}", remedy=remedy) from None
    return sorted(found, key=lambda d: order.index(d.id))


def _connected(d, others):
    """Return detector `d` with those inputs absent that no other has; raises ScenarioError unless it may lack them."""
    absent = set()
    for w in (w for lane in d.lanes for w in d.inputs(lane) if w.signal.kind == "detector"):
        name, lane, output = w.source.split(".")
        source, place = others.get(name), f"detectors.{d.id}: its input {w.source!r}"
        if source is not None and d.every % source.every:
            said = f"{name} steps every {source.every} ticks, {d.id} every {d.every}"
            raise ScenarioError(said, place=place, remedy=f"every = {source.every} in {d.id}, or a multiple of it")
        there = () if source is None else vocabulary.outputs(source.module)
        if source is not None and lane in source.lanes and output in there:
            continue
        absent.add(w.source)
        if d.record.may_lack:
            continue
        if source is None:
            known = registry.known(name)
            said = f"{name} does not fly" if known else f"{name!r} is no detector"
            remedy = f"Add {name!r} to detectors.enabled" if known else did_you_mean(name, others)
            raise ScenarioError(said, place=place, allowed=", ".join(others), remedy=remedy)
        if lane not in source.lanes:
            raise ScenarioError(f"{name} has no lane {lane!r}", place=place, allowed=", ".join(source.lanes))
        near = did_you_mean(output, there)
        raise ScenarioError(f"{name} has no output {output!r}", place=place, allowed=", ".join(there), remedy=near)
    return replace(d, absent=frozenset(absent)) if absent else d


def sources_of(record: Detector) -> list[str]:
    """Return the ids of the detectors that a detector reads, with those that they read in front."""
    names = filter(None, map(vocabulary.detector_of, record.inputs.values()))
    ways = [(*sources_of(registry.record(name)), name) for name in names if registry.known(name)]
    return list(dict.fromkeys(name for way in ways for name in way))


# What a servo takes from a local filter: servo input -> filter output
_ESTIMATE = {"q_fb": "q_now", "qd_fb": "v_now", "x3_fb": "x3_now"}
_ESTIMATE |= dict.fromkeys(("q_use", "qd_use", "x3_use"), "valid")


def feedback_wires(scenario: Scenario) -> list:
    """Return the wires by which servos close on a local filter's estimate: where the scenario says so, and on
    reconfiguration."""
    technology, pairs = scenario.elevator.technology, []
    running = {d.id for d in chosen(scenario)}
    for lane, tech in technology.items():
        source = scenario.elevator.feedback[lane]
        if tech == "hydraulic" and source != "measured":
            if source not in running:
                said = f"the servo of {lane} closes on {source}, which is not enabled"
                remedy = f"Add {source!r} to detectors.enabled, or set the feedback to 'measured'"
                raise ScenarioError(said, place="elevator.feedback", remedy=remedy)
            pairs += [(f"servo_in.{lane}.{to}", f"{source}.{lane}.{field}") for to, field in _ESTIMATE.items()]
        if tech == "hydraulic" and source == "measured" and scenario.elevator.reconfigure:
            # `blame` is 0 while neither position sensor, or none for sure, is wrong
            pairs += [(f"servo_in.{lane}.{to}", f"rtsekf_flight.{lane}.{'blame' if field == 'valid' else field}")
                      for to, field in _ESTIMATE.items()]
        own = scenario.elevator.ema_estimate
        if tech == "ema" and scenario.elevator.reconfigure and own in running:
            pairs += [(f"ema_servo_in.{lane}.pos_fb", f"{own}.{lane}.pos_hat"),
                      (f"ema_servo_in.{lane}.pos_use", f"{own}.{lane}.reconf")]  # fmt: skip
    return pairs


def manifest(setup: Any, topics: Sequence[Any]) -> list:
    """Return, for the log, each detector's module, lanes, rate and, per lane, where in the log each of its inputs
    stands.

    An input is [field, topic, field of the topic]; one that is not wired is zero. KeyError when a source is not logged
    at every tick, or at every step of a detector that is read.
    """
    bus = setup.loop.bus
    place: dict[int, tuple] = {}
    for t in topics:
        if t.every == 1 or t.name.startswith("/detectors/"):
            for field, i in zip(t.fields, t.index):
                place.setdefault(int(i), (t.name, field))
    out = []
    for d in chosen(setup.scenario):
        inputs: dict[str, list] = {lane: [] for lane in d.lanes}
        for to, source in d.wires():
            _, lane, field = to.split(".", 2)
            if bus.index(source) not in place:  # both copies of a sensor are the same bits, and one is logged
                source = source.removesuffix("_obs")
            inputs[lane].append([field, *place[bus.index(source)]])
        part = {} if d.id in registry.SHIPPED else {"user_detector": parts.about(d.module)}
        lanes = list(d.lanes)
        out.append({"id": d.id, "level": d.level, "lanes": lanes, "every": d.every, "inputs": inputs, **part})
    return out


def cost(module: Any, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float, repeats: int = 200) -> float:
    """Return the microseconds of one step of one lane: the best of three times `repeats` steps, on copies.

    `x`, `p` are STATE and PARAMS (lanes,), `u` INPUTS (lanes, 1) of one tick, `dt` [s].
    """
    x, u, best = x.copy(), np.repeat(u, repeats, axis=1), math.inf
    for _ in range(3):
        begin = time.perf_counter()
        module.rollout(x, u, p, dt)
        best = min(best, time.perf_counter() - begin)
    return best / repeats / len(x) * 1e6
