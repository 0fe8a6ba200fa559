"""Names of the numbers that a scenario may multiply: read from the aircraft and the actuators that fly."""

import functools
import re
from pathlib import Path

MULTIPLIERS = Path(__file__).resolve().parents[2] / "aircraft" / "transport" / "Systems" / "multipliers.xml"
NUMERICAL = ("q_lo", "q_hi", "substeps")  # stops and steps: nothing that wears or is uncertain


@functools.cache
def toleranced(group):
    """Return the names of group "aero", "hydraulic" or "ema"; actuators are imported only when they are asked for."""
    if group == "aero":
        return tuple(dict.fromkeys(re.findall(r"aero/mult/(\w+)", MULTIPLIERS.read_text(encoding="utf-8"))))
    if group == "hydraulic":
        from actuators.hydraulic.actuator import NOMINAL

        return tuple(name for name in NOMINAL if name not in NUMERICAL)
    from actuators.ema.jay import values

    return tuple(values("elevator"))
