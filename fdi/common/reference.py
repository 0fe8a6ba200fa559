"""The servos' third-order reference as a detector follows it (actuators/common/reference.py), its state an array."""

from actuators.block import kernel
from actuators.common.limits import within


@kernel
def chase(r, away, most, k1, k2, k3, a_max, j_max, dt):
    """Advance r = (position, rate, acceleration) by one tick to a target that is `away`, at most `most` fast."""
    v = within(k1 * away, most)
    a = within(k2 * (v - r[1]), a_max)
    j = within(k3 * (a - r[2]), j_max)
    r[0] += dt * (r[1] + dt * (r[2] / 2.0 + dt * j / 6.0))
    r[1] += dt * (r[2] + dt * j / 2.0)
    r[2] += dt * j
