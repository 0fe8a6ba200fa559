"""Gain of the current and strength of the magnets of one drive, as it has them and as they change: f = a d + h e + b w.

e is the part of the demand d above the amplifier's pole: of a zero a beside its pole b the amplifier makes
(s + a) / (s + b) = a / b (1 + (b / a - 1) s / (s + b)), and h is b / a - 1. The measured rate w stands in f, too, and
the demand of the next tick answers its noise: least squares would take that for magnets (in still air 6 % of the
voltage, up to 20 %). So w has an instrument, the rate w' that the filter predicted before this tick's reading: the
normal equations are those of (d, e, w') times (f - a d - h e - b w) = 0, tick by tick [Söderström and Stoica,
Instrumental Variable Methods for System Identification, 1983].

Amplifier, winding and magnets of a healthy drive are a few per cent off their nominal values, the first two by as much
as a warm winding is. What a drive has in its first LEARN seconds is taken for its own, the gain up to TOLERANCE, the
voltage of its rate up to OFF_B where it has moved enough; what changes later is a fault.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm

SUMS = 11
TAU_MOST, TAU_NOW = 60.0, 0.6  # longest and shortest memory of the gains [s]
KNOWN_A, KNOWN_B = 0.0015, 0.02  # deviations of gain and magnets: what is told so well of both is forgotten
KNOWN_NOW = 0.0045  # deviation of the gain when it is asked whether it stands or has healed: under half of `th_a`
STANDS = 0.7  # of a gain's threshold: keeps the alarm
RELEASE = 0.5  # [s]: what shows it has a memory of its own
HEALED, HEALED_B = 2.0, 2.5  # of that: a gain, magnets that surely are less have healed
ENDED = 8.0  # log likelihood of a gain that has ended over one of which STANDS is left
# by how much the gain of the current may be less, and more, than nominal before it is learned. Two numbers of 10 % over
# two of 10 %: .67 to 1.49
TOLERANCE = (0.33, 0.5)
LEARN = (2.0, 4.0, 10.0)  # times at which what the gain is off becomes the drive's own [s]
OFF_AMP = 0.1  # deviation of pole over zero of the amplifier: two numbers of 5 to 10 %
SURE, SURE_B = 0.01, 0.03  # deviations of gain and magnets with which they can be learned
# of the current that the rate takes away, as b: K_B over K_ic with 10 % of each, .82 to 1.22, and .05 to .1 that the
# amplifier's lag makes of it
OFF_B = (0.3, 0.27)
MAGNETS = 0.05  # deviation of healthy ones

PARAMS = [
    # sizes from which a gain is a fault; how often a healthy one alarms is z_gain's
    ("th_a", "f8", "-"),  # gain error of the current: a winding 39 % up, 100 K warm, takes .0095, one 80 % up .0195
    ("th_b", "f8", "-"),  # share of the magnets: beyond two tolerances of 5 %
    ("z_gain", "f8", "-"),  # by so many deviations beyond it, by `python -m cosim.training ema`
    ("amp", "f8", "-"),  # by how much the amplifier's pole follows the demand in a tick
]
STATE = [
    ("amp_lag", "f8", "A"),  # demand behind the amplifier's pole
    ("amp_own", "f8", "-"),  # pole over zero of this drive's amplifier, less one
    ("gain_tick", "f8", (SUMS,)),  # products of a sample: fd, fe, fw', dd, de, dw, ee, ew, w'd, w'e, w'w
    ("gain_sum", "f8", (SUMS,)),  # as long as it takes to know
    ("gain_now", "f8", (SUMS,)),  # over TAU_NOW
    ("gain_fault", "f8", "-"),  # gain error while it shows
    ("gain_ended", "f8", "-"),  # log likelihood that it has ended since, over that it stands (cumulative sum)
    ("gain_own", "f8", "-"),  # of this drive, less one
    ("gain_doubt", "f8", "-"),  # deviation with which it was learned
    ("gain_learned", "f8", "-"),  # times
    ("magnets_own", "f8", "-"),  # voltage per rate of this drive, less one
    ("magnets_doubt", "f8", "-"),
    ("magnets_learned", "f8", "-"),  # 1 where it is
    ("gain_a", "f8", "-"),  # f = a d + b w
    ("gain_b", "f8", "-"),  # b over b_motor
    ("r_gain", "f8", "-"),  # the larger over its threshold
    ("gain_timer", "f8", "s"),
    ("hot_gain", "f8", "-"),  # 1 while a gain is off
    ("weak", "f8", "-"),  # 1 where it is the magnets'
]


@kernel
def tick(x, f, d, fast, w, predicted):
    """Take the products of a tick: error `f` [A], current `d` [A] of the demand at rest, its part `fast` [A] above the
    amplifier's pole, rate `w` [rad/s] and the one that was `predicted`."""
    s = x.gain_tick
    s[0] += f * d
    s[1] += f * fast
    s[2] += f * predicted
    s[3] += d * d
    s[4] += d * fast
    s[5] += d * w
    s[6] += fast * fast
    s[7] += fast * w
    s[8] += predicted * d
    s[9] += predicted * fast
    s[10] += predicted * w


@kernel
def doubt(x):
    """Return by how much the gain of this drive's current may be less, and more, than it is taken for."""
    off = 2.0 * x.gain_doubt + 1e-3
    return TOLERANCE if x.gain_learned < 0.5 else (off, off)


@kernel
def doubt_b(x):
    """Return by how much the share `b` of this drive may be less, and more, than it is taken for."""
    off = 2.0 * x.magnets_doubt + 5e-3
    return OFF_B if x.magnets_learned < 0.5 else (off, off)


@kernel
def outside(v, most):
    """Return by how much `v` is beyond -most[0] to most[1], negative inside."""
    return max(-v - most[0], v - most[1])


@kernel
def learn(x, a, h, da, p):
    """Take what the gain is off, `a` with deviation `da`, and the amplifier's pole over its zero, `h`, for the drive's
    own at the times of LEARN; the voltage of its magnets, too, where it has moved enough.
    """
    k = int(x.gain_learned)
    if k >= 3 or x.age < LEARN[k] or da > SURE or outside(x.gain_own + a * (1.0 + x.gain_own), TOLERANCE) > 0.0:
        return
    both, fast, b, d_both, db = solve(x.gain_sum, p, 0.0)
    known = db / p.b_motor <= SURE_B and outside(b / p.b_motor - x.magnets_own, OFF_B) <= 0.0
    if known and outside(x.gain_own + both * (1.0 + x.gain_own), TOLERANCE) <= 0.0:
        a, h, da = both, fast, d_both
        x.magnets_own -= b / p.b_motor
        x.magnets_doubt = db / p.b_motor
        x.magnets_learned = 1.0
    else:
        b = 0.0
    x.gain_own += a * (1.0 + x.gain_own)
    x.amp_own += h / (1.0 + a)
    x.gain_doubt = da
    x.gain_learned += 1.0
    more = 1.0 + a
    for s in (x.gain_sum, x.gain_now):  # f - a d - h e - b w, (1 + a) d + h e, (1 + a) e
        fd, fe = s[0] - a * s[3] - h * s[4] - b * s[5], s[1] - a * s[4] - h * s[6] - b * s[7]
        s[0], s[1], s[2] = more * fd + h * fe, more * fe, s[2] - a * s[8] - h * s[9] - b * s[10]
        s[3] = more * (more * s[3] + 2.0 * h * s[4]) + h * h * s[6]
        s[4] = more * (more * s[4] + h * s[6])
        s[5] = more * s[5] + h * s[7]
        s[6] *= more * more
        s[7] *= more
        s[8] = more * s[8] + h * s[9]
        s[9] *= more


@kernel
def solve(s, p, sure):
    """Return (a, h, b, deviation of a, of b) of f = a d + h e + b w from sums `s`; `sure` is what is known beforehand
    of b, that it is small: (noise over its deviation)^2.
    """
    ee = s[6] + (p.sigma_f / OFF_AMP) * (p.sigma_f / OFF_AMP)
    d, w = s[4] / ee, s[9] / ee  # of e in the instruments d and w', which is taken out of them
    dd, dw, wd, ww = s[3] - d * s[4], s[5] - d * s[7], s[8] - w * s[4], s[10] + sure - w * s[7]
    fd, fw = s[0] - d * s[1], s[2] - w * s[1]
    det = dd * ww - dw * wd
    if dd <= 0.0 or ww <= 0.0 or det <= 1e-6 * dd * ww:
        return 0.0, 0.0, 0.0, 1e3, 1e3
    a, b = (fd * ww - fw * dw) / det, (fw * dd - fd * wd) / det
    h = (s[1] - s[4] * a - s[7] * b) / ee
    return a, h, b, p.sigma_f * math.sqrt(ww / det), p.sigma_f * math.sqrt(dd / det)


@kernel
def gain_and_magnets(s, p):
    """Return (a, h, b, deviation of a, of b), b over b_motor: healthy magnets are off by MAGNETS, which tells of a,
    and b is within OFF_B until motion tells it.
    """
    sure, wide = p.sigma_f / (MAGNETS * p.b_motor), p.sigma_f / (OFF_B[0] * p.b_motor)
    a, h, _, da, _ = solve(s, p, sure * sure)
    _, _, b, _, db = solve(s, p, wide * wide)
    return a, h, b / p.b_motor, da, db / p.b_motor


@kernel
def gains(x, p, f, d, dt):
    """Take a sample into the gains of current and magnets, and test them."""
    new = x.gain_tick
    h, ka, kb = p.even * dt, KNOWN_A / p.sigma_f, KNOWN_B * p.b_motor / p.sigma_f
    told_a, told_b = ka * ka * new[3] / p.even, kb * kb * max(new[10], 0.0) / p.even
    for k in range(2):
        # forgets by what the sample tells, so that a drive at work is judged at once, one at rest at all
        told = min(told_a, told_b)
        if k == 1:  # magnets at rest are neither weak nor healed
            told = 1.0 if x.weak > 0.5 else (KNOWN_NOW * d / p.sigma_f) * (KNOWN_NOW * d / p.sigma_f)
        keep = 1.0 - min(max(told, h / TAU_MOST), h / TAU_NOW)
        if k == 0 and x.age < LEARN[2]:
            keep = 1.0  # all there is to learn from
        s = x.gain_sum if k == 0 else x.gain_now
        for i in range(SUMS):
            s[i] = keep * s[i] + new[i] / p.even
    a, fast, x.gain_b, da, db = gain_and_magnets(x.gain_sum, p)
    x.gain_a = a
    over_a = math.fabs(a) if x.gain_learned > 0.5 else outside(a, TOLERANCE)
    over_a -= p.z_gain * math.sqrt(da * da + x.gain_doubt * x.gain_doubt)
    over_b = math.fabs(x.gain_b) if x.magnets_learned > 0.5 else outside(x.gain_b, OFF_B)
    over_b -= p.z_gain * math.sqrt(db * db + x.magnets_doubt * x.magnets_doubt)
    x.r_gain = max(over_a / p.th_a, over_b / p.th_b)
    sure = True
    if x.hot_gain > 0.5:  # `gain_now` tells whether it stands or has healed; where nothing moves, neither
        a, _, b, da, db = gain_and_magnets(x.gain_now, p)
        size, off, least, most = math.fabs(a), 2.0 * da, STANDS * p.th_a, HEALED * STANDS * p.th_a
        if x.weak > 0.5:
            size, off, least, most = math.fabs(b), 2.0 * db, STANDS * p.th_b, HEALED_B * STANDS * p.th_b
        shows = size - off > least
        sure = shows or size + off < most
        if x.weak < 0.5:
            if shows and x.gain_ended == 0.0:
                x.gain_fault = a
            f_fault = STANDS * x.gain_fault * d
            likelier = f_fault * (0.5 * f_fault - f) / (p.sigma_f * p.sigma_f)
            x.gain_ended = max(x.gain_ended + likelier, 0.0)
            if x.gain_ended >= ENDED:
                shows, sure = False, True
    else:
        if x.r_gain < 1.0:
            learn(x, a, fast, da, p)
        shows = x.r_gain >= 1.0
        x.gain_fault, x.gain_ended = a, 0.0
        if shows:
            x.weak = 1.0 if over_b / p.th_b > over_a / p.th_a else 0.0
    before = x.hot_gain
    if sure:
        x.gain_timer, x.hot_gain = confirm(x.gain_timer, x.hot_gain, shows, p.even * dt, 0.2, RELEASE)
    if before > 0.5 and x.hot_gain < 0.5:  # healed: what came before is of the fault
        for k in range(SUMS):
            if x.gain_ended >= ENDED:
                x.gain_now[k] = 0.0
            x.gain_sum[k] = x.gain_now[k]
