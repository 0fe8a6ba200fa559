"""Backlash between rod and surface: their difference is plus or minus half the gap, and nothing between.

    d = rod - surface = +-h                  the surface leans on one flank or on the other, as its load drives it

A sensor with a bias keeps to one side. One that swings has no level: of a sine (|d| - h)^2 has 1 - 8 / pi^2 = 0.19 of
d^2, of noise more. One of wrong scale is apart in proportion to the rod's position: a line leaves less than that. The
gap may be of any size, and it needs no onset; while the load keeps its side a gap and a bias are the same. What takes
both sides and has no two levels is no gap.
"""

import math

from actuators.block import kernel

SWINGS = 0.5 * (1.0 - 8.0 / (math.pi * math.pi))  # share of d^2 that two levels may leave: half of what a sine has left
NO_LEVELS = 1.5  # times SWINGS, from which on d has no two levels
SIDE_S = 0.1  # on either side, three lags of d [s]

STATE = [
    ("gap_s", "f8", (2,), "s"),  # time since the alarm that d was below and above zero
    ("gap_d", "f8", (2,), "m s"),  # sums of its size over these
    ("gap_dd", "f8", "m^2 s"),  # of its square,
    ("gap_q", "f8", "m s"),  # the rod,
    ("gap_qq", "f8", "m^2 s"),
    ("gap_qd", "f8", "m^2 s"),
    ("loose", "f8", "-"),  # 1 while they show two levels and nothing between
]


@kernel
def update(x, q, dt):
    """Take a tick's rod [m] and x.pair_d; while x.sensor says that rod and surface are apart, tell whether by a gap.

    Takes back x.backlash_suspected, that it may be one, where it is none.
    """
    if x.sensor < 0.5:
        for i in range(2):
            x.gap_s[i] = x.gap_d[i] = 0.0
        x.gap_dd = x.gap_q = x.gap_qq = x.gap_qd = x.loose = 0.0
        return
    if x.pair_age < SIDE_S:
        return
    d, i = x.pair_d, 1 if x.pair_d > 0.0 else 0
    x.gap_s[i] += dt
    x.gap_d[i] += dt * math.fabs(d)
    x.gap_dd += dt * d * d
    x.gap_q += dt * q
    x.gap_qq += dt * q * q
    x.gap_qd += dt * q * d
    n, total, mean = x.gap_s[0] + x.gap_s[1], x.gap_d[0] + x.gap_d[1], x.gap_d[1] - x.gap_d[0]
    level = total / n
    if min(x.gap_s[0], x.gap_s[1]) <= SIDE_S:
        return
    held = True  # each side has the level
    for i in range(2):
        held = held and x.gap_d[i] > 0.5 * level * x.gap_s[i]
    left = x.gap_dd - level * total
    qq, qd = x.gap_qq - x.gap_q * x.gap_q / n, x.gap_qd - x.gap_q * mean / n
    line = x.gap_dd - mean * mean / n - (qd * qd / qq if qq > 0.0 else 0.0)
    x.loose = 1.0 if held and left < SWINGS * x.gap_dd and left < 0.5 * line else 0.0
    if left > NO_LEVELS * SWINGS * x.gap_dd:
        x.backlash_suspected = 0.0
