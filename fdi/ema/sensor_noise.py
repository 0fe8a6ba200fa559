"""Noisy and frozen sensors of an EMA: the second difference of each reading, over that of a healthy one.

    v = y - 2 y- + y--,   r = sqrt(lag of v(reading) v(error)) / threshold

A drive cannot move so: at the stall current the position's second difference is 0.06 mm, that of a sensor as it should
be 0.25 mm. `error` of velocity and current is what they are off the model by, since demands do move them; where the
drive does not follow a demand that answers a sensor's noise the model is noisy, and the reading is not. One sample
counts for no more than SPIKE thresholds, so that a step or a spike is no noise. A reading that had noise and now
repeats itself to the last digit for T_SAME is frozen.
"""

import math

from actuators.block import kernel
from fdi.common.decision import clipped, confirm, usable
from fdi.ema.ema_kalman import CURRENT, POSITION, VELOCITY

SURFACE = 4.0  # index into the isolable_parts of `vote`
WHO = (POSITION, VELOCITY, SURFACE, CURRENT)
N = len(WHO)
TAU = 0.3  # lag of the power [s]
SPIKE = 2.0  # thresholds that one sample may fill: a spike is three of them, and twelve a second are no noise
CONFIRM = 0.1  # [s]
STANDS = 0.8  # of the threshold: so much of it keeps the alarm
T_AGE = 4.0  # an age of the current looks like noise until it is learned [s]
T_SAME, SAME = 0.1, 20.0  # a reading that repeats itself for so long, and so many samples, is frozen [s]
# of the current's: nine times what its sensor's 0.1 A make; an amplifier off its zero and pole both ways makes six
TH_CURRENT = 9.0 * math.sqrt(6.0) * 0.1
LIVELY = 0.06  # of the threshold: a reading with less noise before, as one without any has, may well repeat itself

PARAMS = [
    ("th_rough", "f8", (N,), "m, rad/s, m, A"),  # rms of the second difference: position, innovation, surface, f
]
STATE = [
    ("rough_last", "f8", (N, 2, 2)),  # reading and error of the two samples before
    ("rough_run", "f8", (N,), "-"),  # samples in a row
    ("rough_power", "f8", (N,)),
    ("lively", "f8", (N,)),  # power of the reading alone
    ("rough_timer", "f8", (N,), "s"),
    ("rough_hot", "f8", (N,), "-"),  # confirmed
    ("same_last", "f8", (N,)),  # last readings
    ("same_n", "f8", (N,), "-"),  # how often each has repeated itself
    ("r_rough", "f8", "-"),  # the largest over its threshold
]


@kernel
def judge(x, k, y, e, seen, p, dt):
    """Test the noise of sensor `k`, which reads `y`, by `e` more than the model, where it is `seen`; return it over its
    threshold."""
    of_y, of_e, last, most = 0.0, 0.0, x.rough_last[k], SPIKE * p.th_rough[k]
    if seen and x.rough_run[k] >= 2.0:
        of_y = clipped(y - 2.0 * last[0, 0] + last[0, 1], most)
        of_e = clipped(e - 2.0 * last[1, 0] + last[1, 1], most)
    x.rough_run[k] = x.rough_run[k] + 1.0 if seen else 0.0
    x.rough_power[k] += dt / TAU * (of_y * of_e - x.rough_power[k])
    x.lively[k] += dt / TAU * (of_y * of_y - x.lively[k])
    for i, new in enumerate((y, e) if seen else (0.0, 0.0)):
        last[i, 1], last[i, 0] = last[i, 0], new
    r = math.sqrt(max(x.rough_power[k], 0.0)) / p.th_rough[k]
    asked = x.age >= (p.t_start if k < 3 else T_AGE)
    beyond = asked and r >= (STANDS if x.rough_hot[k] > 0.5 else 1.0)
    x.rough_timer[k], x.rough_hot[k] = confirm(x.rough_timer[k], x.rough_hot[k], beyond, dt, CONFIRM, p.t_release)
    return r


@kernel
def watch(x, u, gamma, current, told, p, dt):
    """Take the readings `u` of a tick, the innovation `gamma` [rad/s] where it is `told`, and what the `current` is off
    by; count how often each reading has repeated itself."""
    position, surface = usable(u.y_position, u.position_valid) > 0.5, usable(u.y_surface, u.surface_valid) > 0.5
    reading = (u.y_position, u.y_velocity, p.arm * u.y_surface, u.y_current)
    good = (position, usable(u.y_velocity, u.velocity_valid) > 0.5, surface, current)
    error = (u.y_position, gamma, p.arm * u.y_surface, x.f_now)
    x.r_rough = 0.0
    for k in range(N):
        if good[k]:
            x.same_n[k] = x.same_n[k] + 1.0 if reading[k] == x.same_last[k] else 0.0
            x.same_last[k] = reading[k]
        x.r_rough = max(x.r_rough, judge(x, k, reading[k], error[k], told if k == 1 else good[k], p, dt))


@kernel
def wrong(x, p, dt):
    """Return the sensor that repeats itself, else the one that is noisy, -1 where several are, 0 for none; one that is
    frozen stays so until its reading changes."""
    noisy = 0.0
    for k in range(N):
        lively = x.lively[k] > LIVELY * LIVELY * p.th_rough[k] * p.th_rough[k] or x.isolated_part == WHO[k]
        if lively and x.same_n[k] >= SAME and x.same_n[k] * dt >= T_SAME:
            return WHO[k]
        if x.rough_hot[k] > 0.5:
            noisy = WHO[k] if noisy == 0.0 else -1.0
    return noisy
