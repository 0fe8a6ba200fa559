"""Which segment alone does not follow its command, from the position sensors of its side.

    e_outer = e + d / 2,  e_inner = e - d / 2,  d = outer - inner - (m_outer - m_inner) - d_0

e is the side's position less that of the servos' model (fdi/rfafe/servo.py), d the difference of its two segments less
that of their models and its mean d_0 while the trim was learned. Of the segments of the sides declared the two largest
mean squares are compared, of what oscillates while an oscillation is declared, otherwise of all: below ONE^2 of the
first the second is healthy, from BOTH^2 on both are moved, between the two the last answer stands.
"""

import math

from actuators.block import kernel
from actuators.constants import RAD_PER_DEG
from fdi.rfafe.core import AIRFRAME
from fdi.rfafe.servo import D, R

ONE, BOTH = 0.3, 0.45  # amplitude of one segment over that of the other
NAMES = ("", "elevator_left_outer", "elevator_left_inner", "elevator_right_inner", "elevator_right_outer")

STATE = [
    ("apart", "f8", (2,), "deg"),  # d_0 of each side
    ("part_slow", "f8", (4,), "deg"),  # slow part of each segment's residual
    ("part_power", "f8", (4,), "deg2"),  # mean square of the rest
    ("segment", "f8", "-"),  # that alone does not follow, index into NAMES; 0: several, or open
]


@kernel
def compare(x, u, p, dt):
    """Learn d_0 with the trim, then take the residuals of this sample; x.y holds positions, trim included."""
    a, b = 1.0 - math.exp(-dt / p.tau_slow), 1.0 - math.exp(-dt / p.tau_energy)
    for j in range(2):
        one, two = 2 * j, 2 * j + 1
        d = (u.surface[one] - u.surface[two]) / RAD_PER_DEG
        d -= x.ref[one, R] - x.ref[one, D] - x.ref[two, R] + x.ref[two, D]
        if x.seen < p.n_trim:
            x.apart[j] += (d - x.apart[j]) / max(x.seen, 1.0)
            continue
        d -= x.apart[j]
        e = x.y[AIRFRAME + j] - x.y0[AIRFRAME + j] - (x.act[j] - p.gain[j] * x.u0[j])
        for i in range(one, two + 1):
            own = e + (0.5 * d if i == one else -0.5 * d)
            x.part_slow[i] += a * (own - x.part_slow[i])
            own -= x.part_slow[i]
            x.part_power[i] += b * (own * own - x.part_power[i])


@kernel
def name(x):
    """Set the segment of the sides declared."""
    if x.alarm < 0.5:
        x.segment = 0.0
        return
    still = 0.0 if x.ofc_timer[0] + x.ofc_timer[1] > 0.0 else 1.0
    which, most, next_ = 0.0, 0.0, 0.0
    for i in range(4):
        if x.isolated_part == 3.0 or (i < 2) == (x.isolated_part < 1.5):
            size = x.part_power[i] + still * x.part_slow[i] * x.part_slow[i]
            if size > most:
                which, most, next_ = 1.0 + i, size, most
            else:
                next_ = max(next_, size)
    if next_ >= BOTH * BOTH * most:
        x.segment = 0.0
    elif next_ < ONE * ONE * most:
        x.segment = which
