"""The range in which a detector may judge, as a kernel sees it: bounds of what it reads, by its record's `range`."""

from actuators.block import kernel
from actuators.constants import M_S_PER_KT
from fdi.common.decision import usable

# True airspeed of an airframe that flies [m/s]: from the least at which a flight may start (`cas_kt` of the aircraft's
# records; on the apron or in the take-off roll no relation between forces, attitude and motion holds that is used here)
# to the speed of sound at sea level, beyond every aerodynamic table.
FLYING = (100.0 * M_S_PER_KT, 340.0)


@kernel
def outside(value, valid, low, high):
    """Return 1.0 where a usable measurement lies outside low <= value <= high; one that is lost is not outside."""
    return 1.0 if usable(value, valid) > 0.5 and not low <= value <= high else 0.0
