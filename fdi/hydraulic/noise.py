"""Is a sensor noisier than it was? The second difference of its samples knows no motion: what is left of it is noise.

sigma^2 = mean (e_k - 2 e_k-1 + e_k-2)^2 / 6 of white samples. The rod's own reading serves as e: no actuator turns
within two samples. The pressure does, as the valve does; its innovation does where the valve does not do what it is
told: the lesser of the two differences serves. From LOUD times the variance that the filter assumes on
the sensor is noisy, until it is back below CALM times; one sample counts for no more than MOST, so that a jump is none.
"""

import math

from actuators.block import kernel

LOUD, CALM, MOST = 12.0, 5.0, 50.0  # of the variance that the filter assumes
USUAL = 1.7  # up to here it is what flights are trained with
SHORT_TICK = 0.0075  # over longer ones the valve's own steps fill a fourth difference [s]
FOURTH = math.sqrt(6.0 / 70.0)  # of white noise: size of a second difference over that of a fourth
# from so many times on nothing that rests on the rod is worth anything; one sample counts for no more than WILD_MOST
WILD, WILD_MOST = 900.0, 5000.0
TAU = 0.15  # lag of the variance [s]

STATE = [
    ("rod_last", "f8", (2,), "m"),  # last readings of the rod, newest first
    ("rod_rough", "f8", "m^2"),  # variance of its noise
    ("rod_wild", "f8", "m^2"),  # the same, which a single sample may raise by more
    ("rod_noisy", "f8", "-"),  # 1 while it is noisy
    ("dp_before_last", "f8", (4,), "-"),  # last readings of the pressure
    ("dp_innovation", "f8", (4,), "-"),  # last innovations of the pressure
    ("dp_noise", "f8", "-"),  # variance of its noise
    ("dp_noisy", "f8", "-"),  # 1 while it is noisy
]


@kernel
def variance(before, d, usual, most, dt):
    """Return the lagged variance of the noise whose second difference is `d`, from the one `before`."""
    return before + (1.0 - math.exp(-dt / TAU)) * (min(d * d / 6.0, most * usual) - before)


@kernel
def fourth(last, y):
    """Return the fourth difference that the sample `y` makes with the `last` four, newest first; keep it."""
    d = y - 4.0 * last[0] + 6.0 * last[1] - 4.0 * last[2] + last[3]
    last[3], last[2], last[1], last[0] = last[2], last[1], last[0], y
    return d


@kernel
def noisy(before, value, usual):
    """Return 1.0 while a variance is LOUD, until it is CALM again."""
    if value > LOUD * usual:
        return 1.0
    return 0.0 if value < CALM * usual else before


@kernel
def listen(x, rod_good, y_rod, dp_good, y_dp, e_dp, p, dt):
    """Take a sample of the rod [m], of the pressure and its innovation, each where it is good; judge both."""
    if rod_good > 0.5:
        d = y_rod - 2.0 * x.rod_last[0] + x.rod_last[1]
        x.rod_rough = variance(x.rod_rough, d, p.r_rod, MOST, dt)
        x.rod_wild = variance(x.rod_wild, d, p.r_rod, WILD_MOST, dt)
        x.rod_last[1], x.rod_last[0] = x.rod_last[0], y_rod
        x.rod_noisy = noisy(x.rod_noisy, x.rod_rough, p.r_rod)
    if dp_good > 0.5:
        d2 = y_dp - 2.0 * x.dp_before_last[0] + x.dp_before_last[1]
        e2 = e_dp - 2.0 * x.dp_innovation[0] + x.dp_innovation[1]
        d = FOURTH * fourth(x.dp_before_last, y_dp)
        e = FOURTH * fourth(x.dp_innovation, e_dp)
        if dt > SHORT_TICK:
            d, e = d2, e2
        x.dp_noise = variance(x.dp_noise, min(math.fabs(d), math.fabs(e)), p.r_dp, MOST, dt)
        x.dp_noisy = noisy(x.dp_noisy, x.dp_noise, p.r_dp)
