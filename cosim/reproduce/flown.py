"""Flights whose measurements a detector can be run on again and again: one simulation, many sets of parameters."""

import numpy as np

from cosim.build import build
from cosim.simulate import health
from cosim.tick import tick


class Flown:
    """Hold chosen signals of one flight: `flown[name]` is the (ticks,) array of a bus name; `dt`, `status`."""

    def __init__(self, scenario, names):
        """Fly `scenario` and keep `names`; a flight that departs is cut there and says so in `status`."""
        setup = build(scenario)
        loop = setup.loop
        names = list(dict.fromkeys(names))
        index = np.array([loop.bus.index(n) for n in names])
        rows = np.empty((setup.ticks, len(names)))
        self.dt, self.status = loop.dt, ""
        k = -1
        for k in range(setup.ticks):
            tick(loop, k, _nowhere)
            rows[k] = loop.v[index]
            if k % 20 == 0 and health(loop.truth)[0]:
                self.status = health(loop.truth)[1]
                break
        self._columns = dict(zip(names, rows[: k + 1].T))
        self.t = np.arange(k + 1) * loop.dt

    def __getitem__(self, name):
        return self._columns[name]

    def inputs(self, module, wires):
        """Return the (1, ticks) INPUTS of a detector module from {field: name}."""
        u = np.zeros((1, len(self.t)), module.INPUTS)
        for field, name in wires.items():
            u[field][0] = self[name]
        return u

    def run(self, module, wires, p):
        """Return the (ticks,) STATE log of a detector with parameters `p` on this flight."""
        u = self.inputs(module, wires)
        log = np.zeros(u.shape, module.STATE)
        module.rollout(module.init(p), u, p, self.dt, log)
        return log[0]


def _nowhere(v):
    """Drop a row."""
