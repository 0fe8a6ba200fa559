"""The envelope: where the aircraft trims, with what in hand, and where its elevator actuators stall.

A point that does not trim carries the reason; one that does carries alpha, stabiliser, throttle and the angles at which
the hinge moment of a segment equals the actuator's stall moment, M_stall = |HM0 + HM_delta delta|, cut at the travel.
"""

import itertools
import math

import pandas as pd

from cosim.errors import TrimError
from cosim.plant import LIMITS, Flight, Plant

STALL_MOMENT = 35e3 * 0.30  # [N m] stall force of Lu17's actuator on the rod arm (DESIGN section 3)
MASSES_T, CGS_PCT = (200.0, 260.0, 320.0, 375.0, 405.0), (25.0, 30.0, 36.0)
ALTITUDES_FT, SPEEDS_KT = (0.0, 10000.0, 20000.0, 30000.0, 38000.0), tuple(range(150, 391, 20))


def trim_map(masses_t=MASSES_T, cgs_pct=CGS_PCT, altitudes_ft=ALTITUDES_FT, cas_kt=SPEEDS_KT, stall=STALL_MOMENT):
    """Return a table of every combination of the four.

    Columns: mass_t, cg_pct, altitude_ft, cas_kt, reason ("" when it trims; stall, thrust, speed, stabiliser), mach,
    alpha_deg, throttle, stabilizer_deg, elevator_up_deg, elevator_down_deg (reach of an actuator of `stall` N m).
    """
    rows = []
    for mass, cg, altitude, cas in itertools.product(masses_t, cgs_pct, altitudes_ft, cas_kt):
        row = {"mass_t": mass, "cg_pct": cg, "altitude_ft": altitude, "cas_kt": float(cas), "reason": ""}
        plant = Plant(Flight.at(mass, cg, altitude, cas_kt=cas))
        try:
            trim = plant.trim()
        except TrimError as error:
            row["reason"] = error.problem.split(":")[0]
            rows.append(row)
            continue
        truth = plant.truth()[0]
        up, down = reach(truth.hm0_lo, truth.hmd_lo, stall)
        row |= {"mach": float(truth.mach), "alpha_deg": math.degrees(trim.alpha), "throttle": trim.throttle}
        row |= {"stabilizer_deg": math.degrees(trim.stabilizer), "elevator_up_deg": up, "elevator_down_deg": down}
        rows.append(row)
    return pd.DataFrame(rows)


def reach(hm0, hmd, stall_moment=STALL_MOMENT):
    """Return the (up, down) angles [deg] that `stall_moment` [N m] holds against HM0 + HM_delta delta, hmd < 0."""
    low, high = (math.degrees(v) for v in LIMITS["elevator"])
    up = math.degrees((stall_moment - hm0) / hmd)  # trailing edge up: the air drives down with +stall_moment
    down = math.degrees((-stall_moment - hm0) / hmd)
    return max(up, low), min(down, high)
