"""From a scenario's manoeuvre to the table of demands that flies it."""

import math
from typing import Any

from cosim.flight.blocks.manoeuvre import doublet, three_two_one_one
from cosim.scenario import manoeuvre as m
from cosim.scenario.inputs import Inputs

FULL_STICK_G = 2.0  # the stop of the stick is beyond every limit of the law: 2.5 g in a climb, too


def _pulse(start, length, channel, value):
    return [(start, {channel: value}), (start + length, {channel: 0.0})]


def steps(manoeuvre: Any, trim: Any = None) -> dict[str, Any]:
    """Return the arguments of `manoeuvre.params` (table of steps, holds engaged) for a scenario's manoeuvre.

    A `trim` in a climb or a turn is held until the manoeuvre asks for another bank or load factor: its bank, its
    altitude or vertical speed, and its speed by the throttles. A table of own inputs says itself what is held.
    """
    told = {**_steps(manoeuvre), "hold_v": manoeuvre.hold_speed}
    if trim is None or trim.level:
        return told
    holds = {} if isinstance(manoeuvre, Inputs) else {"hold_h": trim.gamma == 0.0, "hold_v": True}
    return {**told, **holds, "phi_0": trim.phi}


def _steps(manoeuvre):
    k = manoeuvre
    if isinstance(k, Inputs):  # cosim/flight/user_inputs.py
        heading = k.heading_deg is not None
        return {"steps": [], "hold_psi": heading, "hold_h": k.hold_altitude}
    if isinstance(k, m.Cruise):
        table = []
    elif isinstance(k, m.AoaProtection):
        table = _pulse(k.start_s, k.duration_s, "nz_dem", FULL_STICK_G * k.stick)
    elif isinstance(k, m.NoseUp | m.PitchProtection):
        table = _pulse(k.start_s, k.duration_s, "nz_dem", k.amplitude_g)
    elif isinstance(k, m.CoordinatedTurn):
        table = _pulse(k.start_s, k.duration_s, "phi_dem", math.radians(k.bank_deg))
        return {"steps": table, "hold_h": True}
    elif isinstance(k, m.YawAngle):
        table = [(k.start_s, {"psi_dem": math.radians(k.heading_deg)})]
        return {"steps": table, "hold_psi": True, "hold_h": True}
    elif isinstance(k, m.NzDoublet):
        table = doublet(k.start_s, k.width_s, "nz_dem", k.amplitude_g)
    elif k.amplitude_deg is not None:
        table = three_two_one_one(k.start_s, k.unit_s, "de_add", math.radians(k.amplitude_deg))
    else:
        table = three_two_one_one(k.start_s, k.unit_s, "nz_dem", k.amplitude_g)
    return {"steps": table}
