"""Numbers that a scenario may multiply: read from the aircraft and the actuators that fly, with what they mean."""

import functools
import inspect
import re

from cosim.scenario.aircraft import load_aircraft
from cosim.scenario.catalog import TECHNOLOGIES

GROUPS = ("aero", *(name for name, t in TECHNOLOGIES.items() if t.servo))
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
_FIELD = re.compile(
    r'\(\s*"(\w+)",\s*"f8"(?:,\s*"([^"]*)")?,?\s*\),\s*#\s*(.*?)\s*(?:\[([^\]]*)\])?\s*$', re.M
)  # of a dtype: name, unit, what it is, unit where it stands behind


@functools.cache
def toleranced(group: str) -> tuple[str, ...]:
    """Return the names of group "aero" or of a technology; its blocks are imported only when they are asked for."""
    return load_aircraft().multipliers if group == "aero" else TECHNOLOGIES[group].tolerances


def meanings(group: str) -> dict[str, tuple[str, str]]:
    """Return {name: (what it is, unit)} of what `toleranced(group)` names."""
    if group == "aero":
        parts = {name: name.partition("_") for name in toleranced(group)}
        return {name: (f"{COEFFICIENTS[what]} {PER[over]}", "-") for name, (what, _, over) in parts.items()}
    actuator = TECHNOLOGIES[group].modules()[1]
    package = actuator.__name__.rpartition(".")[0]
    around = [m for m in vars(actuator).values() if inspect.ismodule(m) and m.__name__.startswith(package)]
    sources = [inspect.getsource(m) for m in (*around, actuator)]
    found = (field for source in sources for field in _FIELD.findall(source))
    fields = {name: (text, unit or behind) for name, unit, text, behind in found}
    return {name: fields.get(name, ("", "")) for name in toleranced(group)}
