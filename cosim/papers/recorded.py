"""Flights whose measurements a detector can be run on again and again: one simulation, many sets of parameters."""

import numpy as np

from cosim.flight.build import build
from cosim.flight.fly import record


class Flown:
    """Hold chosen signals of one flight: `flown[name]` is the (ticks,) array of a bus name; `dt`, `status`."""

    def __init__(self, scenario, names, rudder=()):
        """Fly `scenario` and keep `names`; a flight that departs is cut there and says so in `status`.

        `rudder` = [(time s, rad), ...], linear between, is added to the law's rudder command: a pilot's pedals.
        """
        setup = build(scenario)
        self.dt = setup.loop.dt
        if rudder:
            setup.loop.law = _Pedals(setup.loop, rudder)
        names = list(dict.fromkeys(names))
        rows, self.status, _ = record(setup, names)
        self._columns = dict(zip(names, rows.T))
        self.t = np.arange(len(rows)) * self.dt

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


class _Pedals:
    """Advance the law, then add the pedals' share to its rudder command; the law itself does not feed that back."""

    def __init__(self, loop, steps):
        self._law, self._clock, self._x = loop.law, loop.bus["clock"], loop.law.x
        self._time, self._angle = np.array(steps, float).T

    def __getattr__(self, name):
        return getattr(self._law, name)

    def advance(self):
        """Advance by one step, in place."""
        self._law.advance()
        self._x["dr_cmd"] += np.interp(self._clock["t"][0], self._time, self._angle)
