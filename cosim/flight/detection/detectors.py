"""The detectors that fly: which lanes each has, what it reads, with which parameters.

A detector's inputs are copies of logged signals, named by the words of its record; the manifest with their places goes
into the log, so that replay needs nothing but the file.
"""

import functools
import os
import timeit
from collections.abc import Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

import fdi
from actuators.kernels import cached_array
from actuators.python_block import PythonBlock
from cosim import parts
from cosim.errors import ScenarioError, among, did_you_mean
from cosim.flight.blocks.sensors import installed
from cosim.flight.detection import stored_designs
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.parameters import assign
from cosim.scenario import Scenario, vocabulary
from cosim.scenario.aircraft import Aircraft, load_aircraft, of_folder
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


def _fit(detector, site, own, words):
    """Return a lane's PARAMS; a shipped detector is designed once for the same place, words and stored designs."""
    fit = functools.partial(detector.record.fit, site, **words)
    if registry.SHIPPED.get(detector.id) != getattr(detector.module, "__name__", ""):
        return fit()
    place = site.dt, site.lane, site.technology, *site.technologies.items(), *sorted(site.actuator.items()), site.travel
    key = detector.id, place, _sha256(own.folder), *sorted(words.items()), _stored(own.own_designs)
    return cached_array(key, detector.module.PARAMS, fit, str(detector.module.__file__))


@of_folder
def _sha256(folder):
    return identity(folder).sha256


def _stored(own):
    """Return when the stored designs and thresholds were written, those of an aircraft's folder `own` among them."""
    roots = [Path(fdi.__file__).parent, *([own] if own else [])]
    folders = [root / name for root in roots for name in ("designs", "thresholds") if (root / name).is_dir()]
    return tuple(file.stat().st_mtime_ns for folder in folders for file in os.scandir(folder))


@dataclass(frozen=True)
class Installed:
    """A detector in one flight: its record, its block, the lanes that it has there, and what each reads."""

    record: Detector
    module: ModuleType
    inputs: dict[str, list[Wire]]  # of each lane

    @property
    def id(self) -> str:
        """Return its id."""
        return self.record.id

    @property
    def lanes(self) -> tuple[str, ...]:
        """Return the names of its lanes: segments, or "aircraft"."""
        return tuple(self.inputs)

    def params(self, scenario: Scenario, dt: float) -> np.ndarray:
        """Return the PARAMS of all lanes; the scenario's own values replace fields. Raises ScenarioError for one that
        is no number or out of range."""
        table, options = scenario.detectors.table(self.id), self.record.options
        if self.id not in registry.SHIPPED:
            table = {name: value for name, value in table.items() if name not in parts.KEYS}
        words = {n: table.pop(n) for n in options if n in table}
        for n, word in words.items():
            among(word, options[n], f"{word!r} is no choice", place=f"detectors.{self.id}.{n}")
        technology, own, told = scenario.elevator.technology, scenario.aircraft, scenario.elevator.parameters
        lanes = self.lanes if self.record.level == "local" else [""]
        sites = [site(dt, lane, technology, own, told[lane].model if lane in told else None) for lane in lanes]
        p = np.concatenate([_fit(self, s, own, words) for s in sites])
        for name, value in table.items():
            place = f"detectors.{self.id}.{name} = {value}"
            if isinstance(value, str):
                raise ScenarioError("is no number", place=place, allowed="a number")
            assign(self.record, self.module, p, name, float(value), dt, error=ScenarioError, place=place)
        return p

    def wires(self) -> list[tuple[str, str]]:
        """Return [(input, source)] of all lanes, as names of the bus."""
        return [(f"{self.id}_in.{lane}.{w.field}", w.source) for lane, own in self.inputs.items() for w in own]

    def target(self, lane: str) -> str:
        """Return the name of what a lane watches."""
        return f"elevator.{lane}" if self.record.level == "local" else "aircraft"


def unfit(record: Detector, aircraft: Aircraft) -> str:
    """Return which input of a detector an aircraft lacks, or ""."""
    shipped = record.level != "local" and record.id in registry.SHIPPED
    words = [placed(word, aircraft) if shipped else word for word in record.inputs.values()]
    for segment, _, name in (word.rpartition(".") for word in words if not vocabulary.detector_of(word)):
        if segment and segment not in aircraft.segments:
            return f"no elevator segment {segment}"
        if name.startswith("n1_") and name not in installed(aircraft):
            return f"it reads {name}, the aircraft has {aircraft.engines} engine{'s' * (aircraft.engines > 1)}"
    return ""


def left_out(scenario: Scenario) -> dict[str, str]:
    """Return {detector: why} of those that the scenario runs and its aircraft, or its elevators, cannot have: an input
    that is not there, or no design for them."""
    parts.use(scenario)
    own, out = scenario.aircraft, {}
    for name in scenario.running:
        record = registry.record(name)
        designed = record.level != "local" and name in registry.SHIPPED and not record.any_aircraft
        why = unfit(record, own) or (stored_designs.lacking(own, record) if designed and own.own_designs else "")
        if why := why or record.lacks(scenario.elevator.technology, own.own_designs):
            out[name] = why
    return out


def chosen(scenario: Scenario) -> list[Installed]:
    """Return the Installed detectors of a scenario; one without an actuator of its technologies, or that its aircraft
    cannot have, is left out. First come those that read no other, in its order, then each after those that it reads.

    Raises ScenarioError for a detector that does not fly and is read, for detectors that wait for each other, and for
    one that steps more often than what it reads. What a detector `may_lack` is not wired where it is not there.
    """
    technology, lost, found = scenario.elevator.technology, left_out(scenario), {}
    for name in (name for name in scenario.running if name not in lost):
        record, module = registry.record(name), registry.module(name)
        lanes = {"aircraft": ""}
        if record.level == "local":
            lanes = {s: s for s, t in technology.items() if t in record.technologies}
        if lanes:
            read = {lane: wires(record, s, module, scenario.aircraft) for lane, s in lanes.items()}
            found[name] = Installed(record, module, read)
    for name, d in found.items():
        if d.record.may_lack:
            kept = {lane: [w for w in own if _there(w, found)] for lane, own in d.inputs.items()}
            found[name] = replace(d, inputs=kept)
    sorter: TopologicalSorter = TopologicalSorter(dict.fromkeys(found, ()))
    for d in found.values():
        sorter.add(d.id, *sorted(_read(d, found)))
    try:
        return [found[name] for name in sorter.static_order()]
    except CycleError as error:
        way = error.args[1][::-1]
        said = f"detectors wait for each other: {' reads '.join(way)}"
        remedy = "A detector may read only those that do not read it"
        raise ScenarioError(said, place=f"detectors.{way[0]}", remedy=remedy) from None


def _there(w, found):
    """Tell whether a wire reads no detector, or an output that one of those that fly has."""
    name, lane, output = w.source.split(".", 2)
    own = found.get(name)
    has = own is not None and lane in own.lanes and output in vocabulary.elements(own.module.STATE, own.module.OUTPUTS)
    return has or w.signal.kind != "detector"


def _read(d, found):
    """Return the ids of the detectors that `d` reads; raises ScenarioError for one that does not fly, that lacks what
    is read, or that steps less often."""
    read = {}
    for w in (w for own in d.inputs.values() for w in own if w.signal.kind == "detector"):
        (name, lane, output), place = w.source.split(".", 2), f"detectors.{d.id}: its input {w.source!r}"
        if name not in found:
            known = registry.known(name)
            remedy = f"Add {name!r} to detectors.enabled" if known else did_you_mean(name, found)
            raise ScenarioError(f"{name} does not fly" if known else f"{name!r} is no detector", place=place,
                                remedy=remedy)  # fmt: skip
        read[name] = source = found[name]
        among(lane, source.lanes, f"{name} has no lane {lane!r}", place=place)
        outputs = vocabulary.elements(source.module.STATE, source.module.OUTPUTS)
        among(output, outputs, f"{name} has no output {output!r}", place=place)
        if d.record.every % source.record.every:
            said = f"{name} steps every {source.record.every} ticks, {d.id} every {d.record.every}"
            remedy = f"every = {source.record.every} in {d.id}, or a multiple of it"
            raise ScenarioError(said, place=place, remedy=remedy)
    return read


def sources_of(record: Detector) -> list[str]:
    """Return the ids of the detectors that a detector reads, with those that they read in front."""
    names = filter(None, map(vocabulary.detector_of, record.inputs.values()))
    ways = [(*sources_of(registry.record(name)), name) for name in names if registry.known(name)]
    return list(dict.fromkeys(name for way in ways for name in way))


# What a servo takes from a local filter: servo input -> filter output
_ESTIMATE = {"q_fb": "q_now", "qd_fb": "v_now", "x3_fb": "x3_now"}
_ESTIMATE |= dict.fromkeys(("q_use", "qd_use", "x3_use"), "valid")


def feedback_wires(scenario: Scenario, running: Sequence[Installed]) -> list:
    """Return the wires by which servos close on a local filter's estimate: where the scenario says so, and on
    reconfiguration."""
    pairs, flying, elevator = [], {d.id for d in running}, scenario.elevator
    for lane, tech in elevator.technology.items():
        source, fields = elevator.feedback[lane], _ESTIMATE
        if tech == "hydraulic" and source == "measured" and elevator.reconfigure:
            # `blame` is 0 while neither position sensor, or none for sure, is wrong
            source, fields = "rtsekf_flight", {to: "blame" if f == "valid" else f for to, f in _ESTIMATE.items()}
        if tech == "hydraulic" and source != "measured":
            if source not in flying:
                said = f"the servo of {lane} closes on {source}, which is not enabled"
                remedy = f"Add {source!r} to detectors.enabled, or set the feedback to 'measured'"
                raise ScenarioError(said, place="elevator.feedback", remedy=remedy)
            pairs += [(f"servo_in.{lane}.{to}", f"{source}.{lane}.{field}") for to, field in fields.items()]
        own = elevator.ema_estimate
        if tech == "ema" and elevator.reconfigure and own in flying:
            pairs += [(f"ema_servo_in.{lane}.pos_fb", f"{own}.{lane}.pos_hat"),
                      (f"ema_servo_in.{lane}.pos_use", f"{own}.{lane}.reconf")]  # fmt: skip
    return pairs


def manifest(running: Sequence[Installed], parted: bool) -> list:
    """Return, for the log, each detector's module, lanes, rate and, per lane, where in the log each of its inputs
    stands: [field, topic, field of the topic].

    Where the sensors' two copies are `parted`, detectors read the observers' one, else both are logged as one.
    """
    out = []
    for d in running:
        inputs: dict[str, list] = {lane: [] for lane in d.lanes}
        for lane, w in ((lane, w) for lane, own in d.inputs.items() for w in own):
            topic = w.signal.topic.replace("/sensors/", "/observers/") if parted else w.signal.topic
            inputs[lane].append([w.field, topic, w.signal.field + "_valid" * w.flag])
        about = {"user_detector": parts.about(d.module)} if d.id not in registry.SHIPPED else {}
        out.append({"id": d.id, "level": d.record.level, "lanes": list(d.lanes), "every": d.record.every,
                    "inputs": inputs, **about})  # fmt: skip
    return out


def cost(block: Any, repeats: int = 200) -> float:
    """Return the microseconds of one step of one lane of a detector's Block: in Python, whose objects are the flight's
    own, what its steps took in the loop, else the best of three times `repeats` steps on copies."""
    own = block.rollout
    if isinstance(own, PythonBlock):
        return own.seconds / max(1, own.steps * len(block.x)) * 1e6
    x, u = block.x.copy(), np.repeat(block.u, repeats, axis=1)
    best = min(timeit.repeat(lambda: own(x, u, block.p, block.dt), number=1, repeat=3))
    return best / repeats / len(x) * 1e6
