"""Turn a scenario's faults into fault lanes of the loop: signal parameters, and where in the bus each one acts.

A place is (bus name, "f_inj" or "g", factor): the lane's signal or its envelope, times a factor, is added there. A substitution
(solid OFC, runaway) acts on two fields, its share of the healthy signal and its own signal.
"""

import math
from dataclasses import dataclass

import numpy as np

from actuators import linkage
from cosim import faults as f
from cosim.scenario.catalog import SEGMENTS
from cosim.wiring import SERVO

SENSOR_SHAPES = {  # kind -> (shape, field behind the prefix f_ or g_, source)
    "bias": (f.CONSTANT, "add", "f_inj"),
    "jam_liquid": (f.CONSTANT, "add", "f_inj"),
    "drift": (f.DRIFT, "add", "f_inj"),
    "scale": (f.CONSTANT, "scale", "f_inj"),
    "freeze": (f.CONSTANT, "freeze", "g"),
    "noise": (f.CONSTANT, "noise", "f_inj"),
    "oscillation": (f.SINE, "add", "f_inj"),
    "ofc_liquid": (f.SINE, "add", "f_inj"),
    "dropout": (f.CONSTANT, "drop", "g"),
}
SWITCHED = {"jam_solid": "jam", "jam": "jam", "free_float": "free_float"}  # kind -> input field, full when active
SHARES = {  # kind -> input field of the actuator that takes the magnitude
    "loss_of_effectiveness": "loss", "supply_pressure_drop": "supply_drop", "internal_leakage": "leak_add", "air_in_oil": "air",
    "friction": "friction", "backlash": "backlash", "winding_resistance": "resistance", "magnet_loss": "magnet_loss",
}


@dataclass(frozen=True)
class Lane:
    """One fault signal and the places it acts on."""

    name: str
    fault: int
    p: np.ndarray          # faults.PARAMS, (1,)
    places: tuple          # ((bus name, "f_inj" | "g"), ...)
    reference: str = ""    # bus name latched at onset, for a runaway


def lanes(scenario, nominal):
    """Return the fault lanes of `scenario`; `nominal` has what shares refer to (see `Nominal`)."""
    technology = scenario.elevator.technology
    return [_lane(j, technology, nominal) for j in scenario.injections()]


@dataclass(frozen=True)
class Nominal:
    """Nominal values that relative units refer to: supply [Pa], no-load motor speed [rad/s], stall current [A], arms [m], and
    `valve_gain(technology, solid, omega)`, rod amplitude [m] per unit of valve amplitude at `omega` [rad/s], with no load."""

    supply: float
    motor_speed: float
    stall_current: float
    arm: dict
    valve_gain: object


def _params(j, shape, amplitude, lower=-math.inf, upper=math.inf):
    p = np.zeros(1, f.PARAMS)
    p["shape"], p["start"], p["end"], p["ramp"], p["amplitude"] = shape, j.start, j.end, j.ramp, amplitude
    p["omega"], p["phase"] = (j.omega if math.isfinite(j.omega) else 0.0), j.phase
    p["lower"], p["upper"] = lower, upper
    return p


def _lane(j, technology, nominal):
    name = f"{j.fault}_{j.name.replace('.', '_')}"
    if j.place in ("sensor", "part_sensor") or j.sensor:
        shape, field, source = SENSOR_SHAPES[j.kind]
        lane = j.name if j.place == "sensor" else f"{j.name}_{j.sensor}"
        prefix = "g" if j.path in ("observers", "monitor") else "f"
        amplitude = 1.0 if math.isnan(j.magnitude) else j.magnitude * _sensor_factor(j, technology, nominal)
        return Lane(name, j.fault, _params(j, shape, amplitude), ((f"sensors_in.{lane}.{prefix}_{field}", source),))
    if j.place == "engine":
        return Lane(name, j.fault, _params(j, f.CONSTANT, j.magnitude), ((f"surfaces.aircraft.thrust_loss_{j.name}", "f_inj"),))
    if j.place == "surface":
        part = j.name.replace(".", "_")
        return _moving(j, name, "simple", part, f"simple.{part}.delta")
    return _moving(j, name, technology[j.name], j.name, f"{technology[j.name]}.{j.name}.delta", nominal)


def _sensor_factor(j, technology, nominal):
    """Return SI per unit of the injection for a sensor of an actuator; 1 for everything else."""
    if j.unit == "of supply":
        return 1.0
    if j.unit == "Pa":
        return 1.0 / nominal.supply
    if j.unit == "of no-load speed":
        return nominal.motor_speed
    if j.unit == "of stall current":
        return nominal.stall_current
    if j.sensor in ("rod", "position") and j.unit.startswith("rad"):  # surface angle to rod travel
        return nominal.arm[technology[j.name]]
    return 1.0


def _moving(j, name, tech, part, delta, nominal=None):
    """Return the lane of a fault of an actuator `part` of technology `tech` whose surface angle is at bus name `delta`."""
    own = f"{tech}_in.{part}"
    if j.kind in SWITCHED:
        return Lane(name, j.fault, _params(j, f.CONSTANT, 1.0), ((f"{own}.{SWITCHED[j.kind]}", "g"),))
    if j.kind in SHARES:
        factor = nominal.arm[tech] if j.kind == "backlash" and j.unit == "m" else 1.0
        return Lane(name, j.fault, _params(j, f.CONSTANT, j.magnitude / factor), ((f"{own}.{SHARES[j.kind]}", "f_inj"),))
    command = f"{SERVO.get(tech, tech)}_in.{part}"
    if j.kind == "runaway":
        lower, upper = linkage.TRAVEL if part in SEGMENTS else (-math.inf, math.inf)
        if math.isfinite(j.limit):
            lower, upper = (lower, j.limit) if j.magnitude > 0 else (j.limit, upper)
        if j.at == "valve" and tech != "simple" and not math.isfinite(j.limit):
            u = j.magnitude * nominal.arm[tech] / nominal.valve_gain(tech, None, 0.0)
            return Lane(name, j.fault, _params(j, f.CONSTANT, u), ((f"{own}.s_u", "g"), (f"{own}.f_u", "f_inj")))
        p = _params(j, f.RUNAWAY, j.magnitude, lower, upper)
        return Lane(name, j.fault, p, ((f"{command}.s_cmd", "g"), (f"{command}.f_cmd", "f_inj")), delta)
    solid = j.kind == "ofc_solid"
    if j.at == "valve" and tech != "simple":
        amplitude = j.magnitude if j.unit == "u" else j.magnitude / nominal.valve_gain(tech, solid, j.omega)
        places = [(f"{own}.f_u", "f_inj")] + ([(f"{own}.s_u", "g")] if solid else [])
    else:
        amplitude = j.magnitude / nominal.arm[tech] if j.unit == "m" else j.magnitude
        places = [(f"{command}.f_cmd", "f_inj")] + ([(f"{command}.s_cmd", "g")] if solid else [])
    return Lane(name, j.fault, _params(j, f.SINE, amplitude), tuple(places))
