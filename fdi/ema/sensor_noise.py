"""Noisy and frozen sensors of an EMA: the second difference of each reading, over that of a healthy one.

    v = y - 2 y- + y--   of slots of 5 ms,   r = sqrt(lag of v^2) / threshold

A drive cannot move so: at the stall current the position's second difference is 0.06 mm, that of a sensor as it should
be 0.25 mm. Of velocity and current the difference from the model is taken, since demands do move them. One sample
counts for no more than SPIKE thresholds, so that a step or a spike is no noise. What f does to the innovation is no
noise of the velocity, nor what is left of the demand's own noise, where the drive does not follow it, one of the
current. A reading that had noise and now repeats itself to the last digit for T_SAME is frozen.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm, usable
from fdi.ema.ema_kalman import CURRENT, POSITION, VELOCITY

SURFACE = 4.0  # index into the isolable_parts of `vote`
WHO = (POSITION, VELOCITY, SURFACE, CURRENT)
N = len(WHO)
LESS_F, DEMAND = N, N + 1  # beside them: innovation less what f has done, current that the demand makes
TAU = 0.3  # lag of the power [s]
SPIKE = 2.0  # thresholds that one sample may fill: a spike is three of them, and twelve a second are no noise
CONFIRM = 0.1  # [s]
STANDS = 0.8  # of the threshold: so much of it keeps the alarm
T_SAME, SAME = 0.1, 20.0  # a reading that repeats itself for so long, and so many samples, is frozen [s]
# of the current's: nine times what its sensor's 0.1 A make; an amplifier off its zero and pole both ways makes six
TH_CURRENT = 9.0 * math.sqrt(6.0) * 0.1
LIVELY = 0.08  # of the threshold: a reading with less noise before, as one without any has, may well repeat itself

PARAMS = [
    ("th_rough", "f8", (N,), "m, rad/s, m, A"),  # rms of the second difference: position, innovation, surface, f
]
STATE = [
    ("rough_sum", "f8", (N + 2,)),  # sums of the open slot, and their samples; last: LESS_F, DEMAND
    ("rough_n", "f8", (N + 2,), "-"),
    ("rough_1", "f8", (N + 2,)),  # the slots before
    ("rough_2", "f8", (N + 2,)),
    ("rough_run", "f8", (N + 2,), "-"),  # slots in a row
    ("rough_power", "f8", (N + 2,)),
    ("rough_both", "f8", "A2"),  # product of the current's and the demand's
    ("rough_timer", "f8", (N,), "s"),
    ("rough_hot", "f8", (N,), "-"),  # confirmed
    ("same_last", "f8", (N,)),  # last readings
    ("same_n", "f8", (N,), "-"),  # how often each has repeated itself
    ("r_rough", "f8", "-"),  # the largest over its threshold
]


@kernel
def watch(x, u, gamma, current, told, p, dt):
    """Take the readings `u` of a tick, the innovation `gamma` [rad/s] where it is `told`, and what the `current` is off
    by; count how often each reading has repeated itself."""
    position, surface = usable(u.y_position, u.position_valid) > 0.5, usable(u.y_surface, u.surface_valid) > 0.5
    raw = (u.y_position, u.y_velocity, u.y_surface, u.y_current)
    good = (position, usable(u.y_velocity, u.velocity_valid) > 0.5, surface, current)
    value = (u.y_position, gamma, p.arm * u.y_surface, x.f_now, gamma - x.twin[0, 0], u.y_current - x.f_now)
    seen = (position, told, surface, current, told, current)
    for k in range(N):
        if good[k]:
            x.same_n[k] = x.same_n[k] + 1.0 if raw[k] == x.same_last[k] else 0.0
            x.same_last[k] = raw[k]
    for k in range(N + 2):
        if seen[k]:
            x.rough_sum[k] += value[k]
            x.rough_n[k] += 1.0
    if x.count == 0.0:
        judge(x, p, dt)


@kernel
def power(x, k):
    """Return the power of a sensor's second difference that is its own."""
    own = x.rough_power[k]
    if k == 1:
        return min(own, x.rough_power[LESS_F])
    return max(own - x.rough_both * x.rough_both / max(x.rough_power[DEMAND], 1e-9), 0.0) if k == 3 else own


@kernel
def judge(x, p, dt):
    """End a slot of `p.n_sub` ticks: power of each second difference, and its test."""
    h = p.n_sub * dt
    both, told = 1.0, 0
    for k in range(N + 2):
        if x.rough_n[k] > 0.0:
            y = x.rough_sum[k] / x.rough_n[k]
            if x.rough_run[k] >= 2.0:
                v, most = y - 2.0 * x.rough_1[k] + x.rough_2[k], SPIKE * p.th_rough[k if k < N else 2 * k - 2 * N + 1]
                v = min(max(v, -most), most)
                x.rough_power[k] += h / TAU * (v * v - x.rough_power[k])
                if k == 3 or k == DEMAND:
                    both, told = both * v, told + 1
            x.rough_2[k] = x.rough_1[k]
            x.rough_1[k] = y
            x.rough_run[k] += 1.0
        else:
            x.rough_run[k] = 0.0
            x.rough_power[k] -= h / TAU * x.rough_power[k]
        x.rough_sum[k] = x.rough_n[k] = 0.0
    x.rough_both += h / TAU * ((both if told == 2 else 0.0) - x.rough_both)
    x.r_rough = 0.0
    for k in range(N):
        own = power(x, k)
        r = math.sqrt(own) / p.th_rough[k]
        asked = x.age >= p.t_start if k < 3 else x.gain_learned > 1.5  # an age looks like noise until it is learned
        beyond = asked and r >= (STANDS if x.rough_hot[k] > 0.5 else 1.0)
        x.rough_timer[k], x.rough_hot[k] = confirm(
            x.rough_timer[k], x.rough_hot[k], beyond, h, CONFIRM, p.t_release)
        x.r_rough = max(x.r_rough, r)


@kernel
def wrong(x, p, dt):
    """Return the sensor that repeats itself, else the one that is noisy, -1 where several are, 0 for none; one that is
    frozen stays so until its reading changes."""
    noisy = 0.0
    for k in range(N):
        lively = x.rough_power[k] > LIVELY * LIVELY * p.th_rough[k] * p.th_rough[k] or x.isolated_part == WHO[k]
        if lively and x.same_n[k] >= SAME and x.same_n[k] * dt >= T_SAME:
            return WHO[k]
        if x.rough_hot[k] > 0.5:
            noisy = WHO[k] if noisy == 0.0 else -1.0
    return noisy
