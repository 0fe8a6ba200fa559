"""Compensation of estimated faults: of the input at the valve, of sensors before the law.

`elevator.compensate`: the valve of a hydraulic segment gets u - f_hat of its own `iotsekf`, which reads what the valve
was told, so that f_hat stays the fault's; while that detector alarms. `sensors.reconstructed`: the law flies on
y - f_hat of `lpv_smo` for load factor and angle of attack, always from half a second after the observer's start: it
cannot wait for an alarm, three steps at once look like a gust for seconds. `law.reallocate`: see `reallocation`.
"""

import math
from collections.abc import Callable

from cosim.flight.blocks.law import SENSORS
from cosim.flight.blocks.reallocation import reallocation
from cosim.flight.loop.bus import Bus
from cosim.scenario import Scenario

RECONSTRUCTED = {"n_z": "f_hat_n_z", "alpha": "f_hat_alpha"}


def corrections(scenario: Scenario, bus: Bus) -> dict[str, list[Callable[[int], None]]]:
    """Return {stage of the tick: calls that follow its wires}, stages "law", "commands" and "actuators"."""
    law, valves = [], []
    if scenario.sensors.reconstructed:
        pairs = [(f"law_in.law.y[{SENSORS.index(name)}]", f"lpv_smo.aircraft.{f}") for name, f in RECONSTRUCTED.items()]
        law.append(_less(bus, pairs, "lpv_smo.aircraft.age", latched=True))
    if scenario.elevator.compensate:
        for segment, technology in scenario.elevator.technology.items():
            if technology == "hydraulic":
                pair = (f"hydraulic_in.{segment}.u", f"iotsekf.{segment}.f_hat")
                valves.append(_less(bus, [pair], f"iotsekf.{segment}.alarm", limit=1.0))
    return {"law": law, "commands": reallocation(scenario, bus, scenario.dt), "actuators": valves}


def _less(bus, pairs, flag, *, latched=False, limit=math.inf):
    """Return a call that subtracts each source from its destination while `flag` is up, or since; within +-limit."""
    v, gate, (to, source) = bus.v, bus.index(flag), bus.wires(pairs)
    places, since = list(zip(to.tolist(), source.tolist())), False

    def subtract(k):
        nonlocal since
        since = v[gate] > 0.5 or (since and latched)
        if since:
            for i, j in places:
                value = v[i] - v[j]
                v[i] = min(max(value, -limit), limit)

    return subtract
