"""The detectors that fly: which lanes each has, what it reads, with which parameters.

`TABLE` is the one list of all detectors. A detector's inputs are copies of logged signals, named by its wires; the manifest with those
names goes into the log, so that replay needs nothing but the file.
"""

import functools
import importlib
from dataclasses import dataclass

import numpy as np

from cosim import wiring
from cosim.scenario.catalog import DETECTORS


@dataclass(frozen=True)
class Spec:
    """How a detector is built: module, technologies of its lanes (none for an aircraft-level one), wires and parameters.

    `wires(lane, technology)` returns {input field: bus name}; `params(scenario, lane, dt)` one record.
    """

    module: str
    technologies: tuple
    wires: object
    params: object
    every: int = 1


def _obs(lane, sensor, field, flag=None):
    return {field: f"sensors.{lane}_{sensor}.y_obs", flag or f"{field}_valid": f"sensors.{lane}_{sensor}.valid_obs"}


def _position_monitor(lane, technology):
    return {"command": "law.law.de_cmd", **_obs(lane, "surface", "surface")}


TABLE = {
    "position_monitor": Spec("fdi.position_monitor", ("hydraulic", "ema"), _position_monitor, lambda m, s, lane, dt: m.params()),
}


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
        """Return the PARAMS of all lanes; the scenario's own values replace fields. Raises ScenarioError for one that is none."""
        p = np.concatenate([self.spec.params(self.module, scenario, lane, dt) for lane in self.lanes])
        for name, value in scenario.detectors.table(self.id).items():
            _override(self.id, p, name, value)
        return p

    def wires(self, technology):
        """Return [(input, source)] of all lanes."""
        return [(f"{self.id}_in.{lane}.{field}", source)
                for lane in self.lanes for field, source in self.spec.wires(lane, technology.get(lane)).items()]

    def target(self, lane):
        """Return the name of what a lane watches."""
        return f"elevator.{lane}" if self.level == "local" else "aircraft"


def _override(detector, p, name, value):
    from cosim.errors import ScenarioError, did_you_mean

    plain = [n for n in p.dtype.names if p.dtype[n].shape == ()]
    if name not in plain:
        raise ScenarioError(f"detectors.{detector}.{name}: no such parameter", allowed=", ".join(plain), remedy=did_you_mean(name, plain))
    p[name] = float(value)


@functools.cache
def module(name):
    """Return the module of detector `name`."""
    return importlib.import_module(TABLE[name].module)


def chosen(scenario):
    """Return the Detectors of a scenario, in the order of the table; a local one without an actuator of its technology has no lane."""
    technology, out = scenario.elevator.technology, []
    for name in scenario.detectors.enabled:
        if name not in TABLE:
            continue
        spec, level = TABLE[name], DETECTORS[name][0]
        lanes = tuple(s for s in wiring.SEGMENTS if technology[s] in spec.technologies) if level == "local" else ("aircraft",)
        if lanes:
            out.append(Detector(name, level, module(name), lanes, spec, spec.every))
    return out


def feedback_wires(scenario):
    """Return the wires by which a servo closes on a local filter's estimate instead of its own observer's."""
    return []


def manifest(setup):
    """Return, for the log, each detector's module, lanes, rate and wires."""
    technology = setup.scenario.elevator.technology
    return [{"id": d.id, "level": d.level, "module": d.spec.module, "lanes": list(d.lanes), "every": d.every,
             "wires": [list(w) for w in d.wires(technology)]} for d in chosen(setup.scenario)]
