"""Gain of the current, age of its reading and strength of the magnets of one drive, as they are and as they change.

    f = a d + h e + b w + noise,    e = d of the tick before less d: h is the age of the reading beyond the expected one

The measured rate w stands in f, too, and the demand of the next tick answers its noise: least squares would take that
for magnets (in still air 6 % of the voltage, up to 20 %). So w has an instrument, the rate w' that the filter predicted
before this tick's reading: sum z (f - a d - h e - b w) = 0 with z = (d, e, w') [Söderström and Stoica, Instrumental
Variable Methods for System Identification, 1983]. A pole of the amplifier beside its zero looks like an age.

Amplifier, winding and magnets of a healthy drive are a few per cent off their nominal values, the first two by as much
as a warm winding is. What a drive has in its first LEARN seconds is taken for its own, the voltage of
its rate where it has moved enough; what changes later is a fault.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm

TAU_MOST, TAU_NOW = 60.0, 0.3  # longest and shortest memory of the gains [s]
KNOWN_A, KNOWN_B = 0.0015, 0.02  # deviations of gain and magnets: what is told so well of both is forgotten
KNOWN_NOW = 0.0045  # deviation of the gain when it is asked whether it stands or has healed: under half of `th_a`
STANDS = 0.7  # of a gain's threshold: keeps the alarm
RELEASE = 0.5  # [s]: what shows it has a memory of its own
# deviations before they are learned: of the gain, two numbers of 10 % over two of 10 %; of the current that the rate
# takes away, K_B over K_ic with 10 % of each and .05 to .1 that the amplifier's lag makes of it
GAIN, MAGNETS_AT_FIRST = 0.25, 0.15
LEARN = (2.0, 4.0, 10.0)  # times at which what the gain is off becomes the drive's own [s]
AGE, JITTER = 1.0, 0.06  # of the reading: deviation before it is learned, and of its jitter of 0.5 ms [ticks]
SURE, SURE_B = 0.01, 0.015  # deviations of gain and magnets with which they can be learned
MAGNETS = 0.05  # deviation of healthy ones

PARAMS = [
    # sizes from which a gain is a fault; how often a healthy one alarms is z_gain's
    ("th_a", "f8", "-"),  # gain error of the current: a winding 39 % up, 100 K warm, takes .0095, one 80 % up .0195
    ("th_b", "f8", "-"),  # share of the magnets: beyond two tolerances of 5 %
    ("z_gain", "f8", "-"),  # by so many deviations beyond it, by `python -m cosim.training ema`
]
STATE = [
    ("age_own", "f8", "-"),  # of the reading of the current, beyond the expected one [ticks]
    ("gain_sum", "f8", (3, 4)),  # products of d, e, w' with d, e, w, f, as long as it takes to know
    ("gain_own", "f8", "-"),  # of this drive, less one
    ("gain_doubt", "f8", "-"),  # deviation with which it was learned
    ("gain_learned", "f8", "-"),  # times
    ("magnets_own", "f8", "-"),  # voltage per rate of this drive, less one
    ("magnets_doubt", "f8", "-"),
    ("age_sigma", "f8", "-"),  # of the age, then of its jitter [ticks]
    ("gain_a", "f8", "-"),  # f = a d + b w
    ("gain_b", "f8", "-"),  # b over b_motor
    ("r_gain", "f8", "-"),  # the larger over its threshold
    ("gain_timer", "f8", "s"),
    ("hot_gain", "f8", "-"),  # 1 while a gain is off
    ("weak", "f8", "-"),  # 1 where it is the magnets'
]


@kernel
def doubt(x):
    """Return by how much gain and magnets of this drive may differ from what they are taken for."""
    return 2.0 * x.gain_doubt + 1e-3, 2.0 * x.magnets_doubt + 5e-3


@kernel
def solve(s, p, sure):
    """Return (a, h, b, deviation of a, of b) from sums `s`; `sure` is what is known beforehand of b, that it is small:
    (noise over its deviation)^2.
    """
    ee = s[1, 1] + (p.sigma_f / AGE) * (p.sigma_f / AGE)
    d, w = s[0, 1] / ee, s[2, 1] / ee  # of e in the instruments d and w', which is taken out of them
    dd, dw, fd = s[0, 0] - d * s[1, 0], s[0, 2] - d * s[1, 2], s[0, 3] - d * s[1, 3]
    wd, ww, fw = s[2, 0] - w * s[1, 0], s[2, 2] + sure - w * s[1, 2], s[2, 3] - w * s[1, 3]
    det = dd * ww - dw * wd
    if dd <= 0.0 or ww <= 0.0 or det <= 1e-6 * dd * ww:
        return 0.0, 0.0, 0.0, 1e3, 1e3
    a, b = (fd * ww - fw * dw) / det, (fw * dd - fd * wd) / det
    h = (s[1, 3] - s[1, 0] * a - s[1, 2] * b) / ee
    return a, h, b, p.sigma_f * math.sqrt(ww / det), p.sigma_f * math.sqrt(dd / det)


@kernel
def gain_and_magnets(s, p):
    """Return (a, h, b, deviation of a, of b), b over b_motor: healthy magnets are off by MAGNETS, which tells of a."""
    a, h, b, da, db = solve(s, p, (p.sigma_f / (MAGNETS * p.b_motor)) * (p.sigma_f / (MAGNETS * p.b_motor)))
    return a, h, b / p.b_motor, da, db / p.b_motor


@kernel
def learn(x, a, h, da, p):
    """Take what the gain is off, `a` with deviation `da`, and the age `h` for the drive's own at the times of LEARN;
    the voltage of its magnets, too, where it has moved enough.
    """
    k = int(x.gain_learned)
    if k >= 3 or x.age < LEARN[k] or da > SURE or math.fabs(x.gain_own + a * (1.0 + x.gain_own)) > 2.0 * GAIN:
        return
    both, change, b, d_both, db = solve(x.gain_sum, p, 0.0)
    if db > SURE_B * p.b_motor or math.fabs(x.magnets_own - b / p.b_motor) > 2.0 * MAGNETS_AT_FIRST:
        b = 0.0
    else:
        a, h, da = both, change, d_both
        x.magnets_own -= b / p.b_motor
        x.magnets_doubt = db / p.b_motor
    x.gain_own += a * (1.0 + x.gain_own)
    x.age_own += h / (1.0 + a)
    x.gain_doubt, x.age_sigma = da, JITTER
    x.gain_learned += 1.0
    for s in x.gain_sum:
        s[3] -= a * s[0] + h * s[1] + b * s[2]


@kernel
def accumulate(x, f, d, change, w, predicted, p, dt):
    """Take the products of a tick: error `f` [A], current `d` [A] of the demand at rest, that of the tick before less
    this one's, `change` [A], rate `w` [rad/s] and the one that was `predicted`; forget by what they tell, so that a
    drive at work is judged at once, one at rest at all."""
    of_d, of_w = KNOWN_A * d / p.sigma_f, KNOWN_B * p.b_motor / p.sigma_f
    told = min(of_d * of_d, of_w * of_w * max(w * predicted, 0.0))
    if x.hot_gain > 0.5:  # magnets at rest are neither weak nor healed
        told = 1.0 if x.weak > 0.5 else (KNOWN_NOW * d / p.sigma_f) * (KNOWN_NOW * d / p.sigma_f)
    keep = 1.0 if x.age < LEARN[2] else 1.0 - min(max(told / p.even, dt / TAU_MOST), dt / TAU_NOW)
    for i, z in enumerate((d, change, predicted)):
        for j, v in enumerate((d, change, w, f)):
            x.gain_sum[i, j] = keep * x.gain_sum[i, j] + z * v / p.even


@kernel
def test(x, p, dt):
    """Test the gains of current and magnets."""
    x.gain_a, change, x.gain_b, da, db = gain_and_magnets(x.gain_sum, p)
    a, b = math.fabs(x.gain_a), math.fabs(x.gain_b)
    over_a = a - p.z_gain * math.sqrt(da * da + x.gain_doubt * x.gain_doubt)
    over_b = b - p.z_gain * math.sqrt(db * db + x.magnets_doubt * x.magnets_doubt)
    x.r_gain = max(over_a / p.th_a, over_b / p.th_b)
    shows, sure = x.r_gain >= 1.0 and x.age >= LEARN[0], True
    if x.hot_gain > 0.5:  # where nothing moves, it neither stands nor has healed
        size, off, least = (b, db, STANDS * p.th_b) if x.weak > 0.5 else (a, da, STANDS * p.th_a)
        shows = size - 2.0 * off > least
        sure = shows or size + 2.0 * off < 2.0 * least
    elif shows:
        x.weak = 1.0 if over_b / p.th_b > over_a / p.th_a else 0.0
    else:
        learn(x, x.gain_a, change, da, p)
    if sure:
        x.gain_timer, x.hot_gain = confirm(x.gain_timer, x.hot_gain, shows, p.even * dt, 0.2, RELEASE)
