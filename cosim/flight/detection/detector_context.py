"""Context of a detector in the loop: its tick, its actuator, the age of what it reads, the
aircraft (fdi/common/record.py, `Site`)."""

import functools
import math
from dataclasses import dataclass

from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.blocks.servo_gain import SENSOR_DELAY
from cosim.flight.plant.force_model import force_model
from cosim.scenario.aircraft import Aircraft, load_aircraft
from fdi.common.record import Site

# lag [s] of the healthy elevator servos behind RATE: hydraulic 73, electromechanical 68 ms, least squares of the mean
# surface on the command over 16 fault-free flights of 60 s, still air to moderate (tests/flight/test_servo_lag.py flies
# one). Without gusts, where commands are small and friction counts, the hydraulic one lags by 80 to 200 ms
SERVO = 0.07
RATE = math.radians(40.0)  # of the elevator servos' reference
ZETA = 0.9  # of actuators.simple.actuator


@dataclass(frozen=True)
class About:
    """What an aircraft-level detector may know of the aircraft: [elevator, aileron, rudder, stabiliser (it creeps)]."""

    model: object  # of the forces, fdi/control_redundancy/force_model.py
    delays: tuple[float, ...]  # mean delays of the healthy actuators [s]
    rates: tuple[float, ...]  # how fast they follow their commands [rad/s]
    actuators: dict[str, dict[str, float]]  # of the elevators: {technology: what differs from that of `actuators`} [SI]


def aircraft(own: Aircraft) -> About:
    """Return what is known of an aircraft."""
    late = (2.0 * ZETA / s.omega_rad_s for s in (own.surfaces.aileron, own.surfaces.rudder))
    rates = (s.rate for s in (own.surfaces.aileron, own.surfaces.rudder, own.surfaces.stabiliser))
    actuators = {technology: dict(own.own(technology)) for technology in own.actuators}
    return About(force_model(own.folder), (SERVO, *late, 0.0), (RATE, *rates), actuators)


def site(
    dt: float, lane: str = "", technologies: dict | None = None, own: Aircraft | None = None,
    believed: dict | None = None,
) -> Site:  # fmt: skip
    """Return the Site of a detector with tick `dt` [s] on elevator segment `lane` ("" at aircraft level).

    `technologies` is {segment: technology}, `own` the aircraft, by default the bundled one;
    `believed` parameters that the scenario sets for what servo and filters take the actuator to be [SI].
    """
    technologies = technologies or {}
    technology, record = technologies.get(lane, ""), own or load_aircraft()
    actuator = {**dict(record.own(technology)), **(believed or {})}
    known = functools.cache(lambda: aircraft(record))
    return Site(
        dt, lane, technology, technologies, _delay, known, actuator, record.own_designs, record.travels["elevator"]
    )


def _delay(word):
    return TRANSPORT[word][2] if word in TRANSPORT else SENSOR_DELAY
