"""What a fault does to the aircraft, in numbers: load factor, altitude, bank, speed, hinge load, time out of bounds.

All are taken from the onset of the first fault to the end of the flight, altitude, bank and speed against their values
at the onset. The flight itself is measured, not its difference from one without the fault: gusts and manoeuvres count.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from actuators.constants import M_S_PER_KT

MOTION = ("nz", "h", "phi", "cas", "alpha")  # fields of the truth that `consequences` takes
LOAD_FACTOR = (-1.0, 2.5)  # limit manoeuvring load factors of a transport, clean (CS 25.337) [g]
BANK = math.radians(67.0)  # full stick holds this bank in the laws of today's transports [rad]
ALPHA = math.radians(-10.0), math.radians(20.0)  # beyond it nothing is tested [rad]
NAMES = (
    *("nz_min_g", "nz_max_g", "altitude_lost_m", "bank_deg"),
    *("speed_lost_kt", "speed_gained_kt", "hinge_max_nm", "outside_s"),
)


def consequences(
    motion: Mapping[str, NDArray], hinge: Iterable[NDArray], onset: int, dt: float, cas: tuple[float, float]
) -> dict[str, float] | None:
    """Return {name of NAMES: value} from tick `onset` on; None when the flight ended before it.

    `motion` has the fields of MOTION over all ticks (ticks,), SI, n_z in g; `hinge` gives the moments of each elevator
    segment (ticks,) [N m]; `cas` the lowest and the highest speed of the envelope [m/s]; `dt` [s].
    altitude_lost_m, bank_deg, speed_lost_kt and speed_gained_kt are largest excursions from the onset, not below zero.
    """
    late = {name: motion[name][onset:] for name in MOTION}
    if not len(late["nz"]):
        return None
    least, most, begin = ({n: float(call(v)) for n, v in late.items()} for call in (np.min, np.max, lambda v: v[0]))
    bounds = {"nz": LOAD_FACTOR, "phi": (-BANK, BANK), "alpha": ALPHA, "cas": cas}
    outside = np.zeros(len(late["nz"]), bool)
    for name, (low, high) in bounds.items():
        outside |= (late[name] < np.float64(low)) | (late[name] > np.float64(high))
    phi = max(most["phi"] - begin["phi"], begin["phi"] - least["phi"])
    values = (
        *(least["nz"], most["nz"], begin["h"] - least["h"], math.degrees(phi)),
        *((begin["cas"] - least["cas"]) / M_S_PER_KT, (most["cas"] - begin["cas"]) / M_S_PER_KT),
        *(max(np.abs(moment[onset:]).max() for moment in hinge), outside.sum() * dt),
    )
    return {name: float(value) for name, value in zip(NAMES, values)}
