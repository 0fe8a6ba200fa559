"""A pilot's own inputs in the loop: what a table says of every tick goes over what manoeuvre and law have put there.

Stick, bank, heading and elevator take the place of the manoeuvre's demands, before the law; throttle and stabiliser
that of the law's commands, which is then off: no automatic trim, the levers stay where they are put.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ScenarioError
from cosim.flight.blocks.pilot import FULL_STICK_G
from cosim.flight.loop.bus import Bus
from cosim.scenario import Scenario
from cosim.scenario.manoeuvre import Inputs

DEMANDS = {  # column -> (signal, factor to SI)
    "stick": ("pilot.pilot.nz_dem", FULL_STICK_G),
    "nz_g": ("pilot.pilot.nz_dem", 1.0),
    "bank_deg": ("pilot.pilot.phi_dem", math.radians(1.0)),
    "heading_deg": ("pilot.pilot.psi_dem", math.radians(1.0)),
    "elevator_deg": ("pilot.pilot.de_add", math.radians(1.0)),
}
COMMANDS = {
    "throttle": ("law.law.throttle_cmd", 1.0),
    "throttle_change": ("law.law.throttle_cmd", 1.0),
    "stabiliser_deg": ("law.law.stab_cmd", math.radians(1.0)),
    "stabiliser_change_deg": ("law.law.stab_cmd", math.radians(1.0)),
}


def rows(manoeuvre: Inputs, names: Any, ticks: int, dt: float) -> NDArray[np.float64]:
    """Return what the table says at every tick (ticks, columns), in its own units: before its first row and after its
    last those rows hold."""
    t, times = np.arange(ticks) * dt, np.array(manoeuvre.time_s)
    if manoeuvre.between == "hold":  # half a tick of slack: a row acts at the tick nearest to its time
        at = np.maximum(np.searchsorted(times, t + 0.5 * dt, side="left") - 1, 0)
        return np.array([np.array(manoeuvre.columns[name])[at] for name in names]).T.reshape(ticks, -1)
    return np.array([np.interp(t, times, manoeuvre.columns[name]) for name in names]).T.reshape(ticks, -1)


def user_inputs(scenario: Scenario, bus: Bus, trim: Any) -> dict[str, tuple[NDArray, NDArray]]:
    """Return {stage of the tick: (positions in the bus, their values at every tick (ticks, n))}, stages "pilot" and
    "law"; {} where the scenario has no table. Raises ScenarioError where a change leads beyond a stop."""
    table = scenario.manoeuvre
    if not isinstance(table, Inputs):
        return {}
    out = {}
    for stage, known in (("pilot", DEMANDS), ("law", COMMANDS)):
        names = [name for name in known if name in table.columns]
        values = rows(table, names, scenario.ticks, scenario.dt)
        for i, name in enumerate(names):
            values[:, i] *= known[name][1]
            if "_change" in name:
                values[:, i] += trim.throttle if name == "throttle_change" else trim.stabilizer
                _within(values[:, i], name, trim, scenario)
        if names:
            out[stage] = np.array([bus.index(known[name][0]) for name in names]), np.ascontiguousarray(values)
    return out


def _within(values, name, trim, scenario):
    """Raise ScenarioError where trim and change together leave the range."""
    throttle = name == "throttle_change"
    low, high = (0.0, 1.0) if throttle else scenario.aircraft.travels["stabiliser"]
    start, unit = (trim.throttle, "") if throttle else (math.degrees(trim.stabilizer), " deg")
    off = np.flatnonzero((values < low - 1e-9) | (values > high + 1e-9))
    if len(off):
        factor = 1.0 if throttle else math.degrees(1.0)
        raise ScenarioError(
            f"at {off[0] * scenario.dt:g} s it leads to {values[off[0]] * factor:.3g}{unit}",
            place=f"manoeuvre.{name}",
            allowed=f"{low * factor - start:.3g} to {high * factor - start:.3g}{unit}; the trim is {start:.3g}{unit}",
        )
