"""The detectors that fly: which lanes each has, what it reads, with which parameters.

A detector's inputs are copies of logged signals, named by its wires; the manifest with those names goes into the log,
so that replay needs nothing but the file.
"""

from dataclasses import dataclass

import numpy as np

from cosim.errors import ScenarioError, did_you_mean
from cosim.flight.detector_table import TABLE, Spec, module
from cosim.flight.parameter_bounds import wrong_parameter
from cosim.flight.parameters import assign
from cosim.scenario.catalog import DETECTORS, SEGMENTS


@dataclass(frozen=True)
class Detector:
    """A detector of one flight."""

    id: str
    level: str
    module: object
    lanes: tuple
    spec: Spec
    every: int = 1

    def params(self, scenario, dt):
        """Return the PARAMS of all lanes; the scenario's own values replace fields. Raises ScenarioError for one that
        is none.
        """
        table = scenario.detectors.table(self.id)
        words = {name: _word(self.id, name, table.pop(name), allowed)
                 for name, allowed in self.spec.options if name in table}
        p = np.concatenate([self.spec.params(self.module, scenario, lane, dt, **words) for lane in self.lanes])
        for name, value in table.items():
            self._override(p, name, value, dt)
        if wrong := table and wrong_parameter(self.module, self.id, p, dt):
            name, value, low, high = wrong
            raise ScenarioError(
                f"{value:g} does not fit the detector's arrays",
                place=f"detectors.{self.id}.{name}",
                allowed=f"a whole number from {low:g} to {high:g}",
            )
        return p

    def _override(self, p, name, value, dt):
        """Set a parameter of every lane; raise ScenarioError for one that is none, or for a word."""
        place = f"detectors.{self.id}.{name} = {value}"
        if isinstance(value, str):
            raise ScenarioError("is no number", place=place, allowed="a number")
        words = [word for word, _ in self.spec.options]
        assign(self.id, self.module, p, name, float(value), dt, error=ScenarioError, place=place, also=words)

    def wires(self, technology):
        """Return [(input, source)] of all lanes."""
        return [
            (f"{self.id}_in.{lane}.{field}", source)
            for lane in self.lanes
            for field, source in self.spec.wires(lane, technology.get(lane)).items()
        ]

    def target(self, lane):
        """Return the name of what a lane watches."""
        return f"elevator.{lane}" if self.level == "local" else "aircraft"


def _word(detector, name, value, allowed):
    """Return `value` when it is one of the words `allowed`; else raise ScenarioError."""
    if value not in allowed:
        raise ScenarioError(
            f"{value!r} is no choice",
            place=f"detectors.{detector}.{name}",
            allowed=", ".join(allowed),
            remedy=did_you_mean(str(value), allowed),
        )
    return value


def chosen(scenario):
    """Return the Detectors of a scenario, in the order of the table; a local one without an actuator of its technology
    has no lane.
    """
    technology, out = scenario.elevator.technology, []
    for name in scenario.running:
        if name not in TABLE:
            continue
        spec, level = TABLE[name], DETECTORS[name][0]
        lanes = (
            tuple(s for s in SEGMENTS if technology[s] in spec.technologies)
            if level == "local"
            else ("aircraft",)
        )
        if lanes:
            out.append(Detector(name, level, module(name), lanes, spec, spec.every))
    return out


# What a servo takes from a local filter: servo input -> filter output
_ESTIMATE = {
    "q_fb": "q_now",
    "qd_fb": "v_now",
    "x3_fb": "x3_now",
    "q_use": "valid",
    "qd_use": "valid",
    "x3_use": "valid",
}


def feedback_wires(scenario):
    """Return the wires by which servos close on a local filter's estimate: where the scenario says so, and on
    reconfiguration.
    """
    technology, pairs = scenario.elevator.technology, []
    running = {d.id for d in chosen(scenario)}
    for lane, tech in technology.items():
        source = scenario.elevator.feedback[lane]
        if tech == "hydraulic" and source != "measured":
            if source not in running:
                raise ScenarioError(
                    f"the servo of {lane} closes on {source}, which is not enabled",
                    place="elevator.feedback",
                    remedy=f"Add {source!r} to detectors.enabled, or set the feedback to 'measured'",
                )
            pairs += [(f"servo_in.{lane}.{to}", f"{source}.{lane}.{field}") for to, field in _ESTIMATE.items()]
        if tech == "hydraulic" and source == "measured" and scenario.elevator.reconfigure:
            # `blame` is 0 while neither position sensor, or none for sure, is wrong
            pairs += [(f"servo_in.{lane}.{to}", f"rtsekf_flight.{lane}.{'blame' if field == 'valid' else field}")
                      for to, field in _ESTIMATE.items()]
        if tech == "ema" and scenario.elevator.reconfigure and "ema_kalman_flight" in running:
            pairs += [
                (f"ema_servo_in.{lane}.pos_fb", f"ema_kalman_flight.{lane}.pos_hat"),
                (f"ema_servo_in.{lane}.pos_use", f"ema_kalman_flight.{lane}.reconf"),
            ]
    return pairs


def manifest(setup, topics):
    """Return, for the log, each detector's module, lanes, rate and, per lane, where in the log each of its inputs
    stands.

    An input is [field, topic, field of the topic]; one that is not wired is zero. KeyError when a source is not logged
    at every tick.
    """
    bus, technology = setup.loop.bus, setup.scenario.elevator.technology
    place: dict[int, tuple] = {}
    for t in topics:
        if t.every == 1:
            for field, i in zip(t.fields, t.index):
                place.setdefault(int(i), (t.name, field))
    out = []
    for d in chosen(setup.scenario):
        inputs: dict[str, list] = {lane: [] for lane in d.lanes}
        for to, source in d.wires(technology):
            _, lane, field = to.split(".", 2)
            if bus.index(source) not in place:  # both copies of a sensor are the same bits, and one is logged
                source = source.removesuffix("_obs")
            inputs[lane].append([field, *place[bus.index(source)]])
        out.append(
            {
                "id": d.id,
                "level": d.level,
                "lanes": list(d.lanes),
                "every": d.every,
                "inputs": inputs,
            }
        )
    return out
