"""Numbers that a scenario may multiply: read from the aircraft and the actuators that fly, with what they mean."""

import functools
import inspect
import re

from cosim.scenario.aircraft import load_aircraft

NUMERICAL = ("q_lo", "q_hi", "substeps")  # stops and steps: nothing that wears or is uncertain
GROUPS = ("aero", "hydraulic", "ema")
COEFFICIENTS = {
    "CL": "lift", "CD": "drag", "CY": "side force", "Cl": "rolling moment", "Cm": "pitching moment",
    "Cn": "yawing moment", "Ch": "hinge moment of the elevator segments",
}  # fmt: skip
PER = {
    "0": "at zero angle of attack", "alpha": "over angle of attack", "beta": "over sideslip",
    "p": "over roll rate", "q": "over pitch rate", "r": "over yaw rate", "alphadot": "over rate of angle of attack",
    "de": "over elevator", "ds": "over stabiliser", "da": "over aileron", "dr": "over rudder",
    "delta": "over its angle",
}  # fmt: skip
_FIELD = re.compile(r'\(\s*"(\w+)",\s*"f8",?\s*\),\s*#\s*(.*?)\s*(?:\[([^\]]*)\])?\s*$', re.M)


@functools.cache
def toleranced(group: str) -> tuple[str, ...]:
    """Return the names of group "aero", "hydraulic" or "ema"; actuators are imported only when they are asked for."""
    if group == "aero":
        return load_aircraft().multipliers
    if group == "hydraulic":
        from actuators.hydraulic.actuator import NOMINAL

        return tuple(name for name in NOMINAL if name not in NUMERICAL)
    from actuators.ema.jay import values

    return tuple(values("elevator"))


def meanings(group: str) -> dict[str, tuple[str, str]]:
    """Return {name: (what it is, unit)} of what `toleranced(group)` names."""
    if group == "aero":
        return {name: (_coefficient(name), "-") for name in toleranced(group)}
    if group == "hydraulic":
        from actuators.hydraulic import actuator, lu17

        modules = [lu17, actuator]
    else:
        from actuators.ema import actuator as ema

        modules = [ema]
    fields = {name: (text, unit) for m in modules for name, text, unit in _FIELD.findall(inspect.getsource(m))}
    return {name: fields.get(name, ("", "")) for name in toleranced(group)}


def _coefficient(name):
    what, _, over = name.partition("_")
    return f"{COEFFICIENTS[what]} {PER[over]}"
