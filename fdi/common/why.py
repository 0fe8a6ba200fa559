"""Why a detector cannot judge: codes of the output `why`, 0 while it can.

A detector that has `why` in its OUTPUTS says at every tick what its `valid` of 0 comes from; the first reason that
holds, in the order below, is given. `valid == (why == 0)`.

Where it may judge stands in its record's `range`. The bounds of motion are those of the fault-free flights from which
the thresholds come (training `aircraft`), all manoeuvres, protections and gusts included, rounded outward; within the
tables of the force model.
"""

from actuators import block, constants
from fdi.common.decision import usable

VALID = 0.0
NOT_READY = 1.0  # not started, settling, or learning its offsets
LOST_SENSOR = 2.0  # an input that it cannot do without has no valid sample
BOX_MASS = 3.0  # outside the region for which the observer was designed and verified: mass
BOX_CG = 4.0  # centre of gravity
BOX_SPEED = 5.0  # airspeed
BOX_MACH = 6.0  # Mach number
BOX_ALPHA = 7.0  # angle of attack too far from trim for a linear model
BANK = 8.0  # bank angle beyond what its equations hold for
RATE = 9.0  # the command runs ahead of the actuators' rate limit
GUSTS = 10.0  # gusts larger than any of the flights that its thresholds come from
NOT_FINITE = block.NOT_FINITE  # its numbers have overflowed: a value of its state is infinite or not a number

WORDS = (
    "valid",
    "not ready",
    "lost sensor",
    "outside its box (mass)",
    "outside its box (centre of gravity)",
    "outside its box (speed)",
    "outside its box (Mach)",
    "outside its box (angle of attack)",
    "bank angle",
    "command beyond the rate limit",
    "gusts beyond its training",
    "its state is not finite",
)

# True airspeed of an airframe that flies [m/s]: from the least at which a flight may start (`cas_kt` of the aircraft's
# records; on the apron or in the take-off roll no relation between forces, attitude and motion holds that is used here)
# to the speed of sound at sea level, beyond every aerodynamic table.
FLYING = (100.0 * constants.M_S_PER_KT, 340.0)
MACH = (0.19, 0.95)
ALPHA = (-6.0 * constants.RAD_PER_DEG, 20.0 * constants.RAD_PER_DEG)  # angle of attack [rad]


@block.kernel
def box(value, valid, bounds, code, why):
    """Return `why` where it is a reason already, `code` where a usable measurement lies outside `bounds` = (least,
    largest), else 0.0: one that is lost is not outside."""
    outside = usable(value, valid) > 0.5 and not bounds[0] <= value <= bounds[1]
    return why if why > 0.5 or not outside else code


def words(code: float) -> str:
    """Return reason `code` in words; a value that is no code raises ValueError."""
    k = int(code)
    if k != code or not 0 <= k < len(WORDS):
        raise ValueError(f"{code!r} is no reason code")
    return WORDS[k]
