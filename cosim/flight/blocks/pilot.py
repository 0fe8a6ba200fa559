"""From a scenario's manoeuvre to the table of demands that flies it."""

import math
from typing import Any

from cosim.flight.blocks.manoeuvre import doublet, three_two_one_one
from cosim.scenario.manoeuvre import Inputs

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


def _steps(k):
    table: list = []
    match k.kind:
        case "inputs":  # cosim/flight/user_inputs.py
            return {"steps": table, "hold_psi": "heading_deg" in k.columns, "hold_h": k.hold_altitude}
        case "aoa_protection":
            table = _pulse(k.start_s, k.duration_s, "nz_dem", FULL_STICK_G * k.stick)
        case "nose_up" | "pitch_protection":
            table = _pulse(k.start_s, k.duration_s, "nz_dem", k.amplitude_g)
        case "coordinated_turn":
            table = _pulse(k.start_s, k.duration_s, "phi_dem", math.radians(k.bank_deg))
            return {"steps": table, "hold_h": True}
        case "yaw_angle":
            table = [(k.start_s, {"psi_dem": math.radians(k.heading_deg)})]
            return {"steps": table, "hold_psi": True, "hold_h": True}
        case "nz_doublet":
            table = doublet(k.start_s, k.width_s, "nz_dem", k.amplitude_g)
        case "three_two_one_one" if "amplitude_deg" in k.model_extra:
            table = three_two_one_one(k.start_s, k.unit_s, "de_add", math.radians(k.amplitude_deg))
        case "three_two_one_one":
            table = three_two_one_one(k.start_s, k.unit_s, "nz_dem", k.amplitude_g)
    return {"steps": table}
