"""Wiring of one tick by names, and the places where a fault enters.

A name is `section.lane.field` of the bus; a section `x_in` holds the inputs of block `x`. Everything here is data: the
loop compiles it to index arrays, the log stores the detectors' part of it, and replay and foreign data are wired by the
same names.
"""

from typing import Any

from cosim.flight.blocks import sensors
from cosim.flight.blocks.law import SENSORS as LAW_SENSORS
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES

DEMANDS = ("nz_dem", "phi_dem", "psi_dem", "de_add", "hold_psi", "hold_h", "hold_v")
OTHERS = ("aileron_left", "aileron_right", "rudder", "stabiliser")  # surfaces with a simple actuator
SURFACE_OF = {"aileron_left": "da_l", "aileron_right": "da_r", "rudder": "dr", "stabiliser": "stab"}
COMMAND_OF = {"aileron_left": "da_cmd", "aileron_right": "da_cmd", "rudder": "dr_cmd", "stabiliser": "stab_cmd"}

def sensor_wires(scenario: Scenario) -> list[tuple[str, str]]:
    """Return the wires from truth and actuators to the sensors."""
    installed = sensors.installed(scenario.aircraft)
    pairs = [(f"sensors_in.{name}.truth", f"truth.aircraft.{spec[0]}") for name, spec in installed.items()]
    for seg, tech in scenario.elevator.technology.items():
        own = TECHNOLOGIES[tech].sensors
        pairs += [(f"sensors_in.{seg}_{name}.truth", f"{tech}.{seg}.{s.state}") for name, s in own.items()]
    return pairs


def law_wires() -> list[Any]:
    """Return the wires of measurements to the law."""
    pairs = []
    for i, name in enumerate(LAW_SENSORS):
        pairs += [(f"law_in.law.y[{i}]", f"sensors.{name}.y"), (f"law_in.law.valid[{i}]", f"sensors.{name}.valid")]
    return [*pairs, ("pilot_in.pilot.t", "clock.clock.t")]


def demand_wires() -> list[tuple[str, str]]:
    """Return the wires from the manoeuvre to the law."""
    return [(f"law_in.law.{name}", f"pilot.pilot.{name}") for name in DEMANDS]


def hinge_wires(technology: dict) -> list[tuple[str, str]]:
    """Return the wires of measured air data to the detectors' model of the hinge moment."""
    ends = (("", "y_obs"), ("_valid", "valid_obs"))
    return [(f"hinge_model_in.{seg}.{name}{tail}", f"sensors.{name}.{source}")
            for seg in technology for name in ("alpha", "q", "cas") for tail, source in ends]  # fmt: skip


def servo_wires(technology: dict) -> list:
    """Return the wires of commands and measurements to the servo loops."""
    pairs = []
    for seg, tech in technology.items():
        if not TECHNOLOGIES[tech].servo:
            continue
        to = f"{TECHNOLOGIES[tech].servo}_in.{seg}"
        pairs.append((f"{to}.command", "law.law.de_cmd"))
        for name, sensor in TECHNOLOGIES[tech].sensors.items():
            if sensor.servo:
                measured = (f"sensors.{seg}_{name}.y", f"sensors.{seg}_{name}.valid")
                pairs += [(f"{to}.{into}", source) for into, source in zip(sensor.servo, measured)]
    return pairs


def actuator_wires(scenario: Scenario) -> list:
    """Return the wires from servos, law and hinge moments to the actuators."""
    pairs, short = [], scenario.aircraft.short
    for seg, tech in scenario.elevator.technology.items():
        to = f"{tech}_in.{seg}"
        servo = TECHNOLOGIES[tech].servo
        pairs.append((f"{to}.u", f"{servo}.{seg}.u") if servo else (f"{to}.command", "law.law.de_cmd"))
        pairs += [(f"{to}.hm0", f"truth.aircraft.hm0_{short[seg]}"), (f"{to}.hmd", f"truth.aircraft.hmd_{short[seg]}")]
    return pairs + [(f"simple_in.{name}.command", f"law.law.{COMMAND_OF[name]}") for name in OTHERS]


def surface_wires(scenario: Scenario) -> list[tuple[str, str]]:
    """Return the wires from actuators, law and engine faults to the aircraft."""
    short = scenario.aircraft.short
    pairs = [(f"surfaces.aircraft.de_{short[s]}", f"{t}.{s}.delta") for s, t in scenario.elevator.technology.items()]
    pairs += [(f"surfaces.aircraft.{SURFACE_OF[name]}", f"simple.{name}.delta") for name in OTHERS]
    return pairs + [(f"surfaces.aircraft.throttle_{i}", "law.law.throttle_cmd") for i in scenario.aircraft.engine_names]
