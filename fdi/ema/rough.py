"""Which sensor has become noisy? The second difference of each reading, over what a healthy one shows.

    v = y - 2 y- + y--   of slots of 5 ms,   r = sqrt(lag of v^2) / threshold

A drive cannot move so: at the stall current the position's second difference is 0.06 mm, that of a sensor as it should
be 0.25 mm. Of the velocity the filter's innovation is taken, since demands do move it. One sample counts for no more
than SPIKE thresholds, so that a step or a spike is no noise.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.ema.ema_kalman import POSITION, VELOCITY

SURFACE = 4.0  # index into the culprits of `vote`
WHO = (POSITION, VELOCITY, SURFACE)
TAU = 0.3  # lag of the power [s]
SPIKE = 2.0  # thresholds that one sample may fill: a spike is three of them, and twelve a second are no noise
CONFIRM = 0.1  # [s]
STANDS = 0.8  # of the threshold: so much of it keeps the alarm

PARAMS = [
    ("th_rough", "f8", (3,), "m, rad/s, m"),  # rms of the second difference: position, innovation, surface
]
STATE = [
    ("rough_sum", "f8", (4,), "m, rad/s, m, rad/s"),  # sums of the slot that is open, and their samples
    ("rough_n", "f8", (4,), "-"),
    ("rough_1", "f8", (4,), "m, rad/s, m, rad/s"),  # the slots before
    ("rough_2", "f8", (4,), "m, rad/s, m, rad/s"),
    ("rough_run", "f8", (4,), "-"),  # slots in a row
    ("rough_power", "f8", (4,), "m2, rad2/s2, m2, rad2/s2"),
    ("rough_timer", "f8", (3,), "s"),
    ("rough_hot", "f8", (3,), "-"),  # confirmed
    ("r_rough", "f8", "-"),  # the largest over its threshold
]


@kernel
def take(x, k, value, seen):
    """Take a sample of reading `k` where it was `seen`."""
    if seen:
        x.rough_sum[k] += value
        x.rough_n[k] += 1.0


@kernel
def judge(x, p, dt):
    """End a slot of `p.n_sub` ticks: power of each second difference, and its test."""
    h = p.n_sub * dt
    for k in range(4):
        if x.rough_n[k] > 0.0:
            y = x.rough_sum[k] / x.rough_n[k]
            if x.rough_run[k] >= 2.0:
                v, most = y - 2.0 * x.rough_1[k] + x.rough_2[k], SPIKE * p.th_rough[k if k < 3 else 1]
                x.rough_power[k] += h / TAU * (min(v * v, most * most) - x.rough_power[k])
            x.rough_2[k] = x.rough_1[k]
            x.rough_1[k] = y
            x.rough_run[k] += 1.0
        else:
            x.rough_run[k] = 0.0
            x.rough_power[k] -= h / TAU * x.rough_power[k]
        x.rough_sum[k] = x.rough_n[k] = 0.0
    x.r_rough = 0.0
    for k in range(3):
        power = x.rough_power[k] if k != 1 else min(x.rough_power[1], x.rough_power[3])
        r = math.sqrt(power) / p.th_rough[k]
        beyond = r >= (STANDS if x.rough_hot[k] > 0.5 else 1.0) and x.age >= p.t_start
        x.rough_timer[k], x.rough_hot[k] = confirm(
            x.rough_timer[k], x.rough_hot[k], beyond, h, CONFIRM, p.t_release)
        x.r_rough = max(x.r_rough, r)


@kernel
def noisy(x):
    """Return the one sensor that is noisy, -1 where several are, 0 for none."""
    who = 0.0
    for k in range(3):
        if x.rough_hot[k] > 0.5:
            who = WHO[k] if who == 0.0 else -1.0
    return who
