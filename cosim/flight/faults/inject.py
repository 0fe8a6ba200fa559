"""Turn a scenario's faults into fault lanes of the loop: signal parameters, and where in the bus each one acts.

A place is (bus name, "f_inj" or "g", factor): the lane's signal or its envelope, times a factor, is added there. A
substitution (solid OFC, runaway) acts on two fields, its share of the healthy signal and its own signal.
"""

import math
from dataclasses import dataclass

import numpy as np

from cosim.errors import ScenarioError
from cosim.flight.blocks import faults as f
from cosim.flight.blocks.servo_gain import liquid_gain
from cosim.scenario import Scenario
from cosim.scenario.aircraft import Aircraft
from cosim.scenario.catalog import FREQUENCY, TECHNOLOGIES

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
WAVES = {"sine": f.SINE, "square": f.SQUARE, "triangle": f.TRIANGLE, "chirp": f.CHIRP}


@dataclass(frozen=True)
class Lane:
    """One fault signal and the places it acts on."""

    name: str
    fault: int
    p: np.ndarray  # faults.PARAMS, (1,)
    places: tuple  # ((bus name, "f_inj" | "g"), ...)
    reference: str = ""  # bus name latched at onset, for a runaway


def lanes(scenario: Scenario) -> list[Lane]:
    """Return the fault lanes of `scenario`; relative units refer to the nominal values of the technologies' records."""
    return [_lane(j, scenario) for j in scenario.injections()]


def _params(j, shape, amplitude, lower=-math.inf, upper=math.inf):
    p = np.zeros(1, f.PARAMS)
    if shape == f.SINE:
        shape = WAVES[j.shape]
        lower, upper = (FREQUENCY.low * FREQUENCY.factor, FREQUENCY.high * FREQUENCY.factor)
    p["form"], p["start"], p["end"], p["ramp"], p["amplitude"] = shape, j.start, j.end, j.ramp, amplitude
    p["omega"], p["phase"], p["sweep"] = (j.omega if math.isfinite(j.omega) else 0.0), j.phase, j.sweep
    p["lower"], p["upper"] = lower, upper
    return p


def _constant(j, name, amplitude, *places):
    return Lane(name, j.fault, _params(j, f.CONSTANT, amplitude), places)


def _lane(j, scenario):
    name = f"{j.fault}_{j.name.replace('.', '_')}"
    technology = scenario.elevator.technology.get(j.name)
    if j.place in ("sensor", "actuator_sensor") or j.sensor:
        return _sensor(j, name, technology, scenario.aircraft)
    if j.place == "engine":
        return _constant(j, name, j.magnitude, (f"surfaces.aircraft.thrust_loss_{j.name}", "f_inj"))
    if j.place == "surface":
        surface, most = j.name.replace(".", "_"), getattr(scenario.aircraft.surfaces, j.name.split(".")[0]).rate
        if j.kind == "runaway" and abs(j.magnitude) > most:
            rate, most = math.degrees(j.magnitude), math.degrees(most)
            raise ScenarioError(f"its actuator moves at {most:g} deg/s at most", allowed=f"-{most:g} to {most:g}",
                                place=f"faults.{j.fault}.rate_deg_s = {rate:g}")  # fmt: skip
        return _moving(j, name, TECHNOLOGIES["simple"], surface, scenario)
    return _moving(j, name, TECHNOLOGIES[technology], j.name, scenario)


def _sensor(j, name, technology, aircraft):
    shape, field, source = SENSOR_SHAPES[j.kind]
    lane = j.name if j.place == "sensor" else f"{j.name}_{j.sensor}"
    prefix = "g" if j.path in ("observers", "monitor") else "f"
    amplitude = 1.0 if math.isnan(j.magnitude) else j.magnitude * own_unit(j.unit, j.sensor, technology, aircraft)
    places = [(f"sensors_in.{lane}.{prefix}_{field}", source)]
    drive = TECHNOLOGIES[technology].sensors[j.sensor].drive if technology else None
    if drive and j.path == "loop" and j.place == "actuator_sensor":
        inputs = tuple(f"{technology}_in.{j.name}.{field}" for field in drive)
        state = f"{technology}.{j.name}.{TECHNOLOGIES[technology].sensors[j.sensor].state}"
        return _read_by_drive(j, name, amplitude, places, inputs, state)
    return Lane(name, j.fault, _params(j, shape, amplitude), tuple(places))


def _read_by_drive(j, name, amplitude, places, inputs, state):
    """Return the lane of a sensor's fault that also enters the actuator's own electronics, a drive's current loop.

    There the sensor reads (1 - s) i + f; `inputs` are the bus names of s and f. Added noise and a dropout stay on the
    measured copy: the drive filters the first and holds through the second within its 0.3 ms.
    """
    share, added = inputs
    freezes = j.kind == "freeze"
    drive = {
        "freeze": ((share, "g"), (added, "f_inj")),  # the drive reads the value of the onset
        # s counts what is not seen; the lane's signal is the factor minus one, so the loop's copy takes it with the
        # other sign
        "scale": ((share, "f_neg"),),
        **dict.fromkeys(("bias", "drift", "oscillation"), ((added, "f_inj"),)),
    }.get(j.kind, ())
    p = _params(j, f.RUNAWAY, 0.0) if freezes else _params(j, SENSOR_SHAPES[j.kind][0], amplitude)
    return Lane(name, j.fault, p, (*places, *drive), state if freezes else "")


def own_unit(unit: str, sensor: str, technology: str | None, aircraft: Aircraft) -> float:
    """Return what one SI `unit`, or share of a nominal value, is in what `sensor` of an actuator of `technology` reads;
    1 for an aircraft's sensor (`technology` is None)."""
    if technology is None or sensor not in TECHNOLOGIES[technology].sensors:
        return 1.0
    design = TECHNOLOGIES[technology].design(aircraft.own(technology))
    own = TECHNOLOGIES[technology].sensors[sensor].units[0].si
    unit = unit.removesuffix("/s")  # of a drift
    if own == "m" and unit == "rad":  # surface angle to travel of the rod
        return design.arm
    return design.shares.get(unit, 1.0)


def _moving(j, name, technology, part, scenario):
    """Return the lane of a fault of the actuator of segment or surface `part`."""
    aircraft, own = scenario.aircraft, f"{technology.name}_in.{part}"
    design = technology.design(aircraft.own(technology.name))
    command = f"{technology.servo or technology.name}_in.{part}"
    kind = "jam_solid" if j.kind == "jam" and j.place == "surface" else j.kind
    # without a servo `loss` is the command's
    if kind == "loss_of_effectiveness" and j.at == "command" and technology.servo:
        return _constant(j, name, j.magnitude, (f"{command}.s_cmd", "f_inj"))
    if kind in technology.effects:
        effect = technology.effects[kind]
        if math.isnan(j.magnitude):  # switched
            return _constant(j, name, 1.0, (f"{own}.{effect.input}", "g"))
        factor = design.factors.get(kind, 1.0)
        if effect.unit and j.unit != effect.unit:
            factor = design.arm if effect.unit == "m" else 1.0 / design.arm
        places = [(f"{own}.{effect.input}", "f_inj"), *([(f"{own}.{effect.share}", "g")] if effect.share else [])]
        return _constant(j, name, j.magnitude * factor, *places)
    if kind == "runaway":
        return _runaway(j, name, technology, design, own, command, f"{technology.name}.{part}.delta")
    solid = kind == "ofc_solid"
    share = "s_u" if j.at == "valve" and technology.servo else "s_cmd"
    if share == "s_u":
        to, amplitude = own, _inner_amplitude(j, technology, solid, scenario)
    else:
        to, amplitude = command, j.magnitude / design.arm if j.unit == "m" else j.magnitude
    places = [(f"{to}.{share.replace('s_', 'f_')}", "f_inj"), *([(f"{to}.{share}", "g")] if solid else [])]
    shape = f.CONSTANT if kind == "bias" else f.SINE
    return Lane(name, j.fault, _params(j, shape, amplitude), tuple(places))


def _inner_amplitude(j, technology, solid, scenario):
    """Return the amplitude of an oscillation at the valve [1] or drive [A].

    Raises ScenarioError where a drive would need more than its current limit: a servo that the same limit binds loses
    against it, and the surface swings five times as far as was asked for, or the drive cannot move it that far.
    """
    differs = scenario.aircraft.own(technology.name)
    design = technology.design(differs)
    if j.unit == "u":
        return j.magnitude * design.drive
    if solid:
        gain = technology.solid_gain(j.omega, differs)
    else:
        gain = liquid_gain(technology.gain_of or technology.name, j.omega, scenario.dt, differs)
    if design.limited and j.magnitude > gain * design.drive:
        asked = f"{j.magnitude * 1e3:g} mm at {j.omega / (2 * math.pi):g} Hz take {j.magnitude / gain:.0f} A"
        raise ScenarioError(
            f"{asked} at the drive of {j.name}, whose limit is {design.drive:g} A",
            place=f"faults.{j.fault}.amplitude_mm", remedy="For more, set at = 'command'",
            allowed=f"up to {gain * design.drive * 1e3:.2g} mm at this frequency",
        )  # fmt: skip
    return j.magnitude / gain


def _runaway(j, name, technology, design, own, command, delta):
    """Return the lane of a runaway at `magnitude` rad/s: the valve held open, or the demanded rate; to a limit, and
    with a servo that knows no rate, the commanded position runs from where the surface is (bus name `delta`)."""
    bounds: tuple = (-math.inf, j.limit) if j.magnitude > 0 else (j.limit, math.inf)
    if not math.isfinite(j.limit):
        bounds = ()
        if technology.runaway == "rate":
            return _constant(j, name, j.magnitude, (f"{command}.s_rate", "g"), (f"{command}.f_rate", "f_inj"))
        if j.at == "valve" and technology.runaway == "valve":
            u = j.magnitude * design.arm / design.valve_speed
            return _constant(j, name, u, (f"{own}.s_u", "g"), (f"{own}.f_u", "f_inj"))
    p = _params(j, f.RUNAWAY, j.magnitude, *bounds)
    return Lane(name, j.fault, p, ((f"{command}.s_cmd", "g"), (f"{command}.f_cmd", "f_inj")), delta)
