"""The range in which a detector may judge, as a kernel sees it: bounds of what it reads, by its record's `range`.

The bounds of motion are those of the fault-free flights from which the thresholds come (training `aircraft`), all
manoeuvres, protections and gusts included, rounded outward; within the tables of the force model.
"""

from actuators.block import kernel
from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from fdi.common.decision import usable

# True airspeed of an airframe that flies [m/s]: from the least at which a flight may start (`cas_kt` of the aircraft's
# records; on the apron or in the take-off roll no relation between forces, attitude and motion holds that is used here)
# to the speed of sound at sea level, beyond every aerodynamic table.
FLYING = (100.0 * M_S_PER_KT, 340.0)
MACH = (0.19, 0.95)
ALPHA = (-6.0 * RAD_PER_DEG, 20.0 * RAD_PER_DEG)  # angle of attack [rad]


@kernel
def box(value, valid, low, high, code, why):
    """Return `why` where it is a reason already, `code` where a usable measurement lies outside low <= value <= high,
    else 0.0: one that is lost is not outside."""
    if why > 0.5:
        return why
    return code if usable(value, valid) > 0.5 and not low <= value <= high else 0.0
