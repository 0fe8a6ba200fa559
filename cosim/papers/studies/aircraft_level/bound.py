"""The amplitude whose motion is three sigma of a sine fitted to three periods of the pitch rate alone.

Known aircraft, still air: no detector of the airframe's motion can do better (fdi/common/physics_bound.py).
"""

import math
from typing import Any

from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import SIX, FlightPoint
from cosim.papers.studies import Options
from fdi.common import physics_bound

HZ = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
STATES, SEGMENT, DT = ("tas", "alpha", "q", "theta"), ("de_li",), 0.005


def bound(point: str) -> Any:
    """Return the least amplitudes [deg] of one segment's oscillation at each of HZ."""
    A, B, C, D = linearize(FlightPoint.at(**SIX[point])).block(STATES, SEGMENT, ("q",))
    q = physics_bound.motion_per_degree(A, B, C, D, HZ)[:, 0, 0]
    sigma = math.degrees(TRANSPORT["q"][1])
    return physics_bound.detectable_amplitude(q, sigma, frequencies_hz=HZ, sample_s=DT).tolist()


def jobs(options: Options) -> list[Any]:
    """Return a job for each point."""
    return [(bound, {"point": p}) for p in SIX]


def tables(options: Options, values: Any) -> list[Any]:
    """Return the table over points and frequencies."""
    rows = [(p, *own) for p, own in zip(SIX, values)]
    return [("least oscillation of one inner segment that three periods of the pitch rate show [deg]",
             ("point", *(f"{hz:g} Hz>" for hz in HZ)), rows)]  # fmt: skip
