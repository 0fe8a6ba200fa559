"""Flights of the Sun13 study: fly once without detectors, keep what the estimators read, estimate as often as
needed."""

from dataclasses import dataclass

import numpy as np

from cosim.flight.rfafe_wires import WIRES
from cosim.training.rfafe import DT, SEGMENTS, fly
from fdi.rfafe import rfafe, rfafe_airframe

MODULES = {"rfafe": rfafe, "rfafe_airframe": rfafe_airframe}


@dataclass(frozen=True)
class Recorded:
    """A flight: time [s], INPUTS of both estimators (1, ticks), command and the four surfaces [rad], and `more`
    signals."""

    t: np.ndarray
    inputs: dict
    command: np.ndarray
    surfaces: np.ndarray
    more: np.ndarray


def record(*, more=(), **flight):
    """Fly `flight` (arguments of `design_rfafe.fly`) and return it Recorded, with the bus values named in `more`."""
    paths = [(name, field, path) for name, wires in WIRES.items() for field, path in wires.items()]
    own = ["clock.clock.t", "law.law.de_cmd", *(f"truth.aircraft.{s}" for s in SEGMENTS)]
    v = fly([path for *_, path in paths] + own + list(more), **flight)
    inputs = {name: np.zeros((1, len(v)), module.INPUTS) for name, module in MODULES.items()}
    for column, (name, field, _) in enumerate(paths):
        base, _, place = field.partition("[")
        if place:
            inputs[name][base][0, :, int(place[:-1])] = v[:, column]
        else:
            inputs[name][base][0] = v[:, column]
    rest = v[:, len(paths):]
    return Recorded(rest[:, 0], inputs, rest[:, 1], rest[:, 2:6], rest[:, 6:])


def estimate(recorded, name, p=None):
    """Return the STATE log (ticks,) of estimator `name` over a recorded flight; `p` PARAMS, by default the stored
    ones."""
    module = MODULES[name]
    p = module.params() if p is None else p
    log = np.zeros(recorded.inputs[name].shape, module.STATE)
    module.rollout(module.init(p), recorded.inputs[name], p, DT, log)
    return log[0]
