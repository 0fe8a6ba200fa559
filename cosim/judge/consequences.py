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
    blocks: Iterable[tuple[Mapping[str, NDArray], Iterable[NDArray]]], dt: float, cas: tuple[float, float]
) -> dict[str, float] | None:
    """Return {name of NAMES: value} of a flight from its first onset on, told in blocks of ticks; None without one.

    A block is (motion, hinge): the fields of MOTION (ticks,), SI, n_z in g; the moments of each elevator segment
    (ticks,) [N m]. `cas` is the lowest and the highest speed of the envelope [m/s]; `dt` [s].
    altitude_lost_m, bank_deg, speed_lost_kt and speed_gained_kt are largest excursions from the onset, not below zero.
    """
    bounds = {"nz": LOAD_FACTOR, "phi": (-BANK, BANK), "alpha": ALPHA, "cas": cas}
    begin: dict[str, float] = {}
    least, most = dict.fromkeys(MOTION, math.inf), dict.fromkeys(MOTION, -math.inf)
    loads: list[float] = []
    out = 0
    for motion, hinge in blocks:
        begin = begin or {name: float(motion[name][0]) for name in MOTION}
        outside = np.zeros(len(motion["nz"]), bool)
        for name, (low, high) in bounds.items():
            outside |= (motion[name] < np.float64(low)) | (motion[name] > np.float64(high))
        out += int(outside.sum())
        for name in MOTION:
            least[name] = float(np.minimum(least[name], np.min(motion[name])))  # what is no number stays
            most[name] = float(np.maximum(most[name], np.max(motion[name])))
        peaks = [float(np.abs(moment).max()) for moment in hinge]
        loads = [float(np.maximum(a, b)) for a, b in zip(loads or peaks, peaks)]
    if not begin:
        return None
    phi = max(most["phi"] - begin["phi"], begin["phi"] - least["phi"])
    values = (
        *(least["nz"], most["nz"], begin["h"] - least["h"], math.degrees(phi)),
        *((begin["cas"] - least["cas"]) / M_S_PER_KT, (most["cas"] - begin["cas"]) / M_S_PER_KT),
        *(max(loads), out * dt),
    )
    return {name: float(value) for name, value in zip(NAMES, values)}
