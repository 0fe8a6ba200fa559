"""Wiring of one tick by names, and the places where a fault enters.

A name is `section.lane.field` of the bus; a section `x_in` holds the inputs of block `x`. Everything here is data: the
loop compiles it to index arrays, the log stores the detectors' part of it, and replay and foreign data are wired by the
same names.
"""

from cosim.flight.blocks import sensors
from cosim.flight.blocks.law import SENSORS as LAW_SENSORS
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES

DEMANDS = ("nz_dem", "phi_dem", "psi_dem", "de_add", "hold_psi", "hold_h", "hold_v")
# surfaces with a simple actuator
SURFACE_OF = {"aileron_left": "da_l", "aileron_right": "da_r", "rudder": "dr", "stabiliser": "stab"}
COMMAND_OF = {"aileron_left": "da_cmd", "aileron_right": "da_cmd", "rudder": "dr_cmd", "stabiliser": "stab_cmd"}
OTHERS = tuple(SURFACE_OF)


def wires(scenario: Scenario) -> dict[str, list[tuple[str, str]]]:
    """Return {stage of the tick: [(to, source)]} of a flight, but for its detectors and faults."""
    aircraft, measured = scenario.aircraft, enumerate(LAW_SENSORS)
    out = {
        "sensors": [(f"sensors_in.{name}.truth", f"truth.aircraft.{spec[0]}")
                    for name, spec in sensors.installed(aircraft).items()],
        "law": [("pilot_in.pilot.t", "clock.clock.t"),
                *((f"law_in.law.{to}[{i}]", f"sensors.{name}.{to}") for i, name in measured for to in ("y", "valid"))],
        "demand": [(f"law_in.law.{name}", f"pilot.pilot.{name}") for name in DEMANDS],
        "hinge": [], "servos": [],
        "actuators": [(f"simple_in.{name}.command", f"law.law.{command}") for name, command in COMMAND_OF.items()],
        "surfaces": [*((f"surfaces.aircraft.{to}", f"simple.{name}.delta") for name, to in SURFACE_OF.items()),
                     *((f"surfaces.aircraft.throttle_{i}", "law.law.throttle_cmd") for i in aircraft.engine_names)],
    }  # fmt: skip
    for segment, technology in scenario.elevator.technology.items():
        for stage, pairs in _of_segment(segment, TECHNOLOGIES[technology], aircraft.short[segment]).items():
            out[stage] += pairs
    return out


def _of_segment(segment, technology, short):
    """Return {stage: wires} of an elevator segment: its sensors, the hinge model on measured air data, its servo, where
    it has one, its actuator against the hinge moment, its surface."""
    own, servo = technology.name, technology.servo
    demand = "law.law.de_cmd"
    ends = (("", "y_obs"), ("_valid", "valid_obs"))
    measured = [(f"{servo}_in.{segment}.{to}", f"sensors.{segment}_{name}.{source}")
                for name, s in technology.sensors.items() for to, source in zip(s.servo or (), ("y", "valid"))
                ]  # fmt: skip
    drive = (f"{own}_in.{segment}.u", f"{servo}.{segment}.u") if servo else (f"{own}_in.{segment}.command", demand)
    return {
        "sensors": [(f"sensors_in.{segment}_{name}.truth", f"{own}.{segment}.{s.state}")
                    for name, s in technology.sensors.items()],
        "hinge": [(f"hinge_model_in.{segment}.{name}{tail}", f"sensors.{name}.{source}")
                  for name in ("alpha", "q", "cas") for tail, source in ends],
        "servos": [(f"{servo}_in.{segment}.command", demand), *measured] if servo else [],
        "actuators": [drive, *((f"{own}_in.{segment}.{to}", f"truth.aircraft.{to}_{short}") for to in ("hm0", "hmd"))],
        "surfaces": [(f"surfaces.aircraft.de_{short}", f"{own}.{segment}.delta")],
    }  # fmt: skip
