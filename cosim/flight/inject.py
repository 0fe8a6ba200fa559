"""Turn a scenario's faults into fault lanes of the loop: signal parameters, and where in the bus each one acts.

A place is (bus name, "f_inj" or "g", factor): the lane's signal or its envelope, times a factor, is added there. A
substitution (solid OFC, runaway) acts on two fields, its share of the healthy signal and its own signal.
"""

import math
from dataclasses import dataclass

import numpy as np

from cosim.errors import ScenarioError
from cosim.flight.blocks import faults as f
from cosim.flight.wiring import SERVO

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
SWITCHED = {  # kind -> input field that is full while active
    "hydraulic": {"jam_solid": "jam", "free_float": "free_float"},
    "ema": {"jam_solid": "jam", "jam": "jam_screw", "free_float": "free_float"},
    "simple": {"jam_solid": "jam", "jam": "jam", "free_float": "free_float"},
}
SHARES = {  # kind -> input field of the actuator that takes the magnitude
    "loss_of_effectiveness": "loss",
    "supply_pressure_drop": "supply_drop",
    "internal_leakage": "leak_add",
    "air_in_oil": "air",
    "winding_resistance": "r_add",
    "magnet_loss": "magnet_loss",
    "backlash": "backlash_add",
}


@dataclass(frozen=True)
class Lane:
    """One fault signal and the places it acts on."""

    name: str
    fault: int
    p: np.ndarray  # faults.PARAMS, (1,)
    places: tuple  # ((bus name, "f_inj" | "g"), ...)
    reference: str = ""  # bus name latched at onset, for a runaway


def lanes(scenario, nominal):
    """Return the fault lanes of `scenario`; `nominal` has what shares refer to (see `Nominal`)."""
    technology = scenario.elevator.technology
    return [_lane(j, technology, nominal) for j in scenario.injections()]


@dataclass(frozen=True)
class Nominal:
    """Nominal values that relative units of a fault refer to."""

    supply: float  # [Pa]
    motor_speed: float  # no load [rad/s]
    stall_current: float  # [A]
    stall_torque: float  # at the motor [N m]
    arm: dict  # technology -> lever arm [m]
    unit: dict  # technology -> what 1 of u is at the valve [1] or drive [A]
    speed: float  # rod speed per valve opening, no load [m/s]
    rate: dict  # aileron, rudder, stabiliser -> fastest its actuator moves [rad/s]
    brake: float  # full brake of a hydraulic actuator over its stall force [-]
    gain: object  # (technology, solid, omega) -> position amplitude [m] per unit at the valve [1] or drive [A]


def _params(j, shape, amplitude, lower=-math.inf, upper=math.inf):
    p = np.zeros(1, f.PARAMS)
    p["form"], p["start"], p["end"], p["ramp"], p["amplitude"] = shape, j.start, j.end, j.ramp, amplitude
    p["omega"], p["phase"] = (j.omega if math.isfinite(j.omega) else 0.0), j.phase
    p["lower"], p["upper"] = lower, upper
    return p


def _lane(j, technology, nominal):
    name = f"{j.fault}_{j.name.replace('.', '_')}"
    if j.place in ("sensor", "actuator_sensor") or j.sensor:
        shape, field, source = SENSOR_SHAPES[j.kind]
        lane = j.name if j.place == "sensor" else f"{j.name}_{j.sensor}"
        prefix = "g" if j.path in ("observers", "monitor") else "f"
        unit = sensor_unit(j.unit, j.sensor, technology.get(j.name), nominal)
        amplitude = 1.0 if math.isnan(j.magnitude) else j.magnitude * unit
        places = [(f"sensors_in.{lane}.{prefix}_{field}", source)]
        if j.sensor == "current" and j.path == "loop" and j.place == "actuator_sensor":
            return _current_loop(j, name, lane, amplitude, places)
        return Lane(name, j.fault, _params(j, shape, amplitude), tuple(places))
    if j.place == "engine":
        return Lane(
            name, j.fault, _params(j, f.CONSTANT, j.magnitude), ((f"surfaces.aircraft.thrust_loss_{j.name}", "f_inj"),)
        )
    if j.place == "surface":
        part = j.name.replace(".", "_")
        if j.kind == "runaway" and abs(j.magnitude) > (most := nominal.rate[j.name.split(".")[0]]):
            raise ScenarioError(
                f"its actuator moves at {math.degrees(most):g} deg/s at most",
                place=f"faults.{j.fault}.rate_deg_s = {math.degrees(j.magnitude):g}",
                allowed=f"-{math.degrees(most):g} to {math.degrees(most):g}",
            )
        return _moving(j, name, "simple", part, f"simple.{part}.delta", nominal)
    return _moving(j, name, technology[j.name], j.name, f"{technology[j.name]}.{j.name}.delta", nominal)


def _current_loop(j, name, lane, amplitude, places):
    """Return the lane of a current-sensor fault that also enters the drive's own current loop.

    There the sensor reads (1 - s_i) i + f_i. Added noise and a dropout stay on the measured copy: the drive filters the
    first and holds through the second within its 0.3 ms.
    """
    shape = SENSOR_SHAPES[j.kind][0]
    drive = f"ema_in.{j.name}"
    if j.kind == "freeze":  # the drive reads the current of the onset
        p = _params(j, f.RUNAWAY, 0.0)
        return Lane(name, j.fault, p, (*places, (f"{drive}.s_i", "g"), (f"{drive}.f_i", "f_inj")), f"ema.{j.name}.i")
    if j.kind == "scale":
        # s_i counts what is not seen; the lane's signal is the factor minus one, so the loop's copy takes it with the
        # other sign
        return Lane(name, j.fault, _params(j, shape, amplitude), (*places, (f"{drive}.s_i", "f_neg")))
    if j.kind in ("bias", "drift", "oscillation"):
        places = [*places, (f"{drive}.f_i", "f_inj")]
    return Lane(name, j.fault, _params(j, shape, amplitude), tuple(places))


def sensor_unit(unit, sensor, tech, nominal):
    """Return what one SI `unit`, or share of a nominal value, is in what `sensor` of an actuator of technology `tech`
    reads; 1 for every other sensor.
    """
    if unit == "Pa":
        return 1.0 / nominal.supply  # its own unit is the share of supply
    if unit == "of no-load speed":
        return nominal.motor_speed
    if unit == "of stall current":
        return nominal.stall_current
    if sensor in ("rod", "position") and unit.startswith("rad"):  # surface angle to rod travel
        return nominal.arm[tech]
    return 1.0


def _moving(j, name, tech, part, delta, nominal):
    """Return the lane of a fault of actuator `part` of technology `tech`; its surface angle is at bus name `delta`."""
    own = f"{tech}_in.{part}"
    if j.kind in SWITCHED[tech]:
        return Lane(name, j.fault, _params(j, f.CONSTANT, 1.0), ((f"{own}.{SWITCHED[tech][j.kind]}", "g"),))
    if j.kind == "friction":  # a share of the stall force, on the rod; of the stall torque, at the motor
        field, factor = ("jam", 1.0 / nominal.brake) if tech == "hydraulic" else ("friction_add", nominal.stall_torque)
        return Lane(name, j.fault, _params(j, f.CONSTANT, j.magnitude * factor), ((f"{own}.{field}", "f_inj"),))
    if j.kind == "loss_of_effectiveness" and j.at == "command" and tech != "simple":  # there `loss` is of the command
        place = (f"{SERVO[tech]}_in.{part}.s_cmd", "f_inj")
        return Lane(name, j.fault, _params(j, f.CONSTANT, j.magnitude), (place,))
    if j.kind in SHARES:
        to_radians = j.kind == "backlash" and tech == "hydraulic" and j.unit == "m"
        to_metres = j.kind == "backlash" and tech == "ema" and j.unit == "rad"
        factor = 1.0 / nominal.arm[tech] if to_radians else nominal.arm[tech] if to_metres else 1.0
        return Lane(
            name, j.fault, _params(j, f.CONSTANT, j.magnitude * factor), ((f"{own}.{SHARES[j.kind]}", "f_inj"),)
        )
    command = f"{SERVO.get(tech, tech)}_in.{part}"
    if j.kind == "runaway":
        return _runaway(j, name, tech, part, own, command, delta, nominal)
    solid = j.kind == "ofc_solid"
    share = ["s_cmd", "s_u"][j.at == "valve" and tech != "simple"]
    if share == "s_u":
        to, amplitude = own, _inner_amplitude(j, tech, solid, nominal)
    else:
        to, amplitude = command, j.magnitude / nominal.arm[tech] if j.unit == "m" else j.magnitude
    places = [(f"{to}.{share.replace('s_', 'f_')}", "f_inj"), *([(f"{to}.{share}", "g")] if solid else [])]
    shape = f.CONSTANT if j.kind == "bias" else f.SINE
    return Lane(name, j.fault, _params(j, shape, amplitude), tuple(places))


def _inner_amplitude(j, tech, solid, nominal):
    """Return the amplitude of an oscillation at the valve [1] or drive [A].

    Raises ScenarioError where a drive would need more than its current limit: a servo that the same limit binds loses
    against it, and the surface swings five times as far as was asked for, or the drive cannot move it that far.
    """
    unit = nominal.unit[tech]
    if j.unit == "u":
        return j.magnitude * unit
    gain = nominal.gain(tech, solid, j.omega)
    if tech == "ema" and j.magnitude > gain * unit:
        raise ScenarioError(
            f"{j.magnitude * 1e3:g} mm at {j.omega / (2 * math.pi):g} Hz take {j.magnitude / gain:.0f} A at the drive "
            f"of {j.name}, whose limit is {unit:g} A",
            place=f"faults.{j.fault}.amplitude_mm",
            allowed=f"up to {gain * unit * 1e3:.2g} mm at this frequency",
            remedy="For more, set at = 'command'",
        )
    return j.magnitude / gain


def _runaway(j, name, tech, part, own, command, delta, nominal):
    """Return the lane of a runaway at `magnitude` rad/s: the valve held open; without a valve, or to a limit, the
    demanded position runs.
    """
    if math.isfinite(j.limit):  # the command runs from where the surface is to the limit
        bounds = (-math.inf, j.limit) if j.magnitude > 0 else (j.limit, math.inf)
        p = _params(j, f.RUNAWAY, j.magnitude, *bounds)
        return Lane(name, j.fault, p, ((f"{command}.s_cmd", "g"), (f"{command}.f_cmd", "f_inj")), delta)
    if j.at == "valve" and tech == "hydraulic":
        u = j.magnitude * nominal.arm[tech] / nominal.speed
        return Lane(name, j.fault, _params(j, f.CONSTANT, u), ((f"{own}.s_u", "g"), (f"{own}.f_u", "f_inj")))
    if tech == "hydraulic":
        p = _params(j, f.RUNAWAY, j.magnitude)
        return Lane(name, j.fault, p, ((f"{command}.s_cmd", "g"), (f"{command}.f_cmd", "f_inj")), delta)
    return Lane(
        name, j.fault, _params(j, f.CONSTANT, j.magnitude), ((f"{command}.s_rate", "g"), (f"{command}.f_rate", "f_inj"))
    )
