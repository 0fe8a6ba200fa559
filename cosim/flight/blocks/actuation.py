"""The actuators of one flight: which blocks, with which parameters, in which equilibrium."""

from typing import Any

import numpy as np

from actuators.simple import actuator as simple
from cosim.errors import among
from cosim.flight.blocks.servo_gain import sensor_age
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES
from cosim.scenario.elevator import Settings


def _scaled(technology, own, multipliers):
    """Return {name: nominal times multiplier}; raises ScenarioError for a name that is no parameter."""
    nominal = technology.parameters(own)
    for name in multipliers:
        among(name, nominal, "no such parameter", place=f"tolerances.{technology.name}.{name}")
    return {k: nominal[k] * v for k, v in multipliers.items()}


def plain(aircraft: Any, kind: str) -> dict[str, float]:
    """Return the parameters of the plain actuator of a `kind` of surface: the travel that trim and law count on, so
    that it holds whatever trims, rate [rad/s], natural frequency [rad/s]."""
    bounds = dict(zip(("lo", "hi"), aircraft.travels[kind]))
    if kind == "elevator":
        return bounds
    surface = getattr(aircraft.surfaces, kind)
    return {**bounds, "rate": surface.rate, "omega": surface.omega_rad_s}


def blocks(scenario: Scenario, loads: dict, others: dict, dt: float) -> list[tuple]:
    """Return [(section, module, lanes, p, x0)] of all actuators, a servo before its actuator.

    `loads` maps segment -> (delta, hm0, hmd) at trim, `others` the remaining surfaces -> their angle [rad]. What flies
    is multiplied by the scenario's tolerances, or what it sets for a segment.
    """
    flown, aircraft, out = scenario.elevator.technology, scenario.aircraft, []
    for name, technology in TECHNOLOGIES.items():
        lanes = tuple(s for s in flown if flown[s] == name)
        if lanes:
            trim = np.array([loads[s] for s in lanes]).T
            own, set_ = aircraft.own(name), scenario.elevator.parameters
            scaled = _scaled(technology, own, getattr(scenario.tolerances, name, {}))
            truth = [{**scaled, **set_.get(s, Settings()).truth} for s in lanes]
            believed = [set_.get(s, Settings()).model for s in lanes]
            travel = aircraft.travels["elevator"]
            made = technology.build(own, truth, believed, trim, travel, dt, sensor_age(dt))
            out += [(section, module, lanes, p, x0) for section, module, p, x0 in made]
    left = tuple(s for s in flown if flown[s] == "simple")
    kinds = ["elevator"] * len(left) + [name.split("_")[0] for name in others]
    p = np.concatenate([simple.params(**plain(aircraft, k)) for k in kinds])
    x = simple.init_at(p, np.array([loads[s][0] for s in left] + list(others.values())))
    return [*out, ("simple", simple, left + tuple(others), p, x)]
