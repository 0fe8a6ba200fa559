"""Noise of rod and pressure sensor: the second difference of the samples, which contains next to no motion.

sigma^2 = mean (e_k - 2 e_k-1 + e_k-2)^2 / 6 of white samples. The rod's own reading serves as e: no actuator turns
within two samples of up to SHORT_TICK; in two of 20 ms it does, and there what the surface does not do serves as well.
The pressure does, as the valve does: its sixth difference serves, in which the third harmonic of an oscillation at 10
Hz is 4 times smaller than in the fourth. Its innovation knows what the valve was told, but not what it does instead:
the lesser of the two serves. From LOUD times the variance that the filter assumes on (of pressure from LOUD_DP) the
sensor is noisy, until it is back below CALM times; one sample counts for no more than MOST, so that a jump is none.
"""

import math

from actuators.block import kernel

LOUD, CALM, MOST = 12.0, 5.0, 50.0  # of the variance that the filter assumes
LOUD_DP = 20.0  # ... of the pressure: protections that throw the valve from stop to stop make up to 13.5 (60 flights)
SWUNG = 3.0  # times LOUD for the pressure once an oscillation is held to be there: a valve at its stops is not smooth
USUAL = 1.7  # up to here it is what flights are trained with
SHORT_TICK = 0.0075  # over longer ones the valve's own steps fill a sixth difference [s]
# variance of the pressure's innovation over that of the sensor, as the filter has it at 5 ms. At 20 ms it has 60 to
# 100, as the load may have moved: there the innovation counts by what the filter expects of it
EXPECTED = 3.2
SECOND = math.sqrt(6.0)  # of white noise: size of a second difference over that of a sample
SIXTH = math.sqrt(6.0 / 924.0)  # of white noise: size of a second difference over that of a sixth
# from so many times on nothing that rests on the rod is worth anything; one sample counts for no more than WILD_MOST
WILD, WILD_MOST = 900.0, 5000.0
TAU = 0.15  # lag of the variance [s]

STATE = [
    ("rod_last", "f8", (2,), "m"),  # last readings of the rod, newest first
    ("rod_rough", "f8", "m^2"),  # variance of its noise
    ("rod_wild", "f8", "m^2"),  # the same, which a single sample may raise by more
    ("rod_noisy", "f8", "-"),  # 1 while it is noisy
    ("dp_before_last", "f8", (6,), "-"),  # last readings of the pressure
    ("dp_innovation", "f8", (6,), "-"),  # last innovations of the pressure
    ("dp_noise", "f8", "-"),  # variance of its noise
    ("dp_noisy", "f8", "-"),  # 1 while it is noisy
]


@kernel
def variance(before, d, usual, most, a):
    """Return the variance of the noise whose second difference is `d`, lagged by share `a` from the one `before`."""
    return before + a * (min(d * d / 6.0, most * usual) - before)


@kernel
def sixth(last, y):
    """Return the sixth difference that the sample `y` makes with the `last` six, newest first; keep it."""
    d = y - 6.0 * (last[0] + last[4]) + 15.0 * (last[1] + last[3]) - 20.0 * last[2] + last[5]
    for i in range(5, 0, -1):
        last[i] = last[i - 1]
    last[0] = y
    return d


@kernel
def noisy(before, value, usual, loud):
    """Return 1.0 while a variance is `loud`, until it is CALM again."""
    if value > loud * usual:
        return 1.0
    return 0.0 if value < CALM * usual else before


@kernel
def update(x, rod_good, y_rod, e_rod, dp_good, y_dp, e_dp, steps, p, dt):
    """Take a sample of the rod [m] and what is fast in it beside the surface, of the pressure and its innovation, each
    where it is good; judge both. `steps` is the second difference that the valve's own steps may leave in the latter.
    """
    a = 1.0 - math.exp(-dt / TAU)
    if rod_good > 0.5:
        d = y_rod - 2.0 * x.rod_last[0] + x.rod_last[1]
        if dt > SHORT_TICK:
            d = min(math.fabs(d), SECOND * math.fabs(e_rod))
        x.rod_rough = variance(x.rod_rough, d, p.r_rod, MOST, a)
        x.rod_wild = variance(x.rod_wild, d, p.r_rod, WILD_MOST, a)
        x.rod_last[1], x.rod_last[0] = x.rod_last[0], y_rod
        x.rod_noisy = noisy(x.rod_noisy, x.rod_rough, p.r_rod, LOUD)
    if dp_good > 0.5:
        d2 = y_dp - 2.0 * x.dp_before_last[0] + x.dp_before_last[1]
        expected = 1.0
        if dt > SHORT_TICK and x.nis_dp > 0.0:
            expected = math.sqrt(EXPECTED * p.r_dp * x.nis_dp) / math.fabs(x.gamma_dp)
            e_dp = expected * x.gamma_dp
        e2 = e_dp - 2.0 * x.dp_innovation[0] + x.dp_innovation[1]
        d = SIXTH * sixth(x.dp_before_last, y_dp)
        e = SIXTH * sixth(x.dp_innovation, e_dp)
        if dt > SHORT_TICK:
            d, e = d2, max(math.fabs(e2) - expected * steps, 0.0)
        x.dp_noise = variance(x.dp_noise, min(math.fabs(d), math.fabs(e)), p.r_dp, MOST, a)
        x.dp_noisy = noisy(x.dp_noisy, x.dp_noise, p.r_dp, SWUNG * LOUD if x.ofc_timer > 0.0 else LOUD_DP)
