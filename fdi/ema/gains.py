"""Gain of the current and strength of the magnets of one drive, as it has them and as they change: f = a d + b w.

The amplifier's pole over its zero, by which fast demands have another gain than slow ones, is learned from ticks.

Amplifier, winding and magnets of a healthy drive are a few per cent off their nominal values, the first two by as much
as a warm winding is. What a drive has in its first LEARN seconds is taken for its own, the gain up to TOLERANCE, the
voltage of its rate up to OFF_B where it has moved enough; what changes later is a fault.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm

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
    ("z_gain", "f8", "-"),  # by so many deviations beyond it, by `cosim train ema`
    ("amp", "f8", "-"),  # by how much the amplifier's pole follows the demand in a tick
    ("sigma_tick", "f8", "A"),  # noise of the current in a tick
]
STATE = [
    ("amp_lag", "f8", "A"),  # demand behind the amplifier's pole
    ("amp_own", "f8", "-"),  # pole over zero of this drive's amplifier, less one
    ("amp_sum", "f8", (5,), "A2"),  # dd, de, ee, fd, fe of the current d at rest and of its fast part e
    ("gain_sum", "f8", (6,)),  # ff, fd, fw, dd, dw, ww, as long as it takes to know
    ("gain_now", "f8", (6,)),  # over TAU_NOW
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
def amplifier(x, f, d, fast, p, dt):
    """Learn how the amplifier answers fast demands, from the error `f` [A] of a tick, the current `d` [A] of the demand
    at rest and the part `fast` [A] of it above the amplifier's pole b.

    Of a zero a beside it the amplifier makes (s + a) / (s + b) = a / b (1 + (b / a - 1) s / (s + b)): least squares of
    f = g d + (b / a - 1) fast, over TAU_MOST.
    """
    s, keep = x.amp_sum, 1.0 - dt / TAU_MOST
    f += x.amp_own * fast
    s[0] = keep * s[0] + d * d
    s[1] = keep * s[1] + d * fast
    s[2] = keep * s[2] + fast * fast
    s[3] = keep * s[3] + f * d
    s[4] = keep * s[4] + f * fast
    sure = p.sigma_tick / OFF_AMP
    det = s[0] * (s[2] + sure * sure) - s[1] * s[1]
    if det > 0.0:
        x.amp_own = (s[0] * s[4] - s[1] * s[3]) / det


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
def learn(x, a, da, p):
    """Take what the gain is off, `a` with deviation `da`, for the drive's own at the times of LEARN; the voltage of its
    magnets, too, where it has moved enough.
    """
    k = int(x.gain_learned)
    if k >= 3 or x.age < LEARN[k] or da > SURE or outside(x.gain_own + a * (1.0 + x.gain_own), TOLERANCE) > 0.0:
        return
    both, b, d_both, db = solve(x.gain_sum, p.sigma_f, 0.0)
    b, db = b / p.b_motor, db / p.b_motor
    known = db <= SURE_B and outside(b - x.magnets_own, OFF_B) <= 0.0
    if known and outside(x.gain_own + both * (1.0 + x.gain_own), TOLERANCE) <= 0.0:
        a, da = both, d_both
        x.magnets_own -= b
        x.magnets_doubt = db
        x.magnets_learned = 1.0
    else:
        b = 0.0
    x.gain_own += a * (1.0 + x.gain_own)
    x.gain_doubt = da
    x.gain_learned += 1.0
    b *= p.b_motor
    for s in (x.gain_sum, x.gain_now):  # f - a d - b w, (1 + a) d
        s[0] += a * a * s[3] + b * b * s[5] - 2.0 * (a * s[1] + b * s[2] - a * b * s[4])
        s[1] = (1.0 + a) * (s[1] - a * s[3] - b * s[4])
        s[2] -= a * s[4] + b * s[5]
        s[3] *= (1.0 + a) * (1.0 + a)
        s[4] *= 1.0 + a


@kernel
def solve(s, noise, sure):
    """Return (a, b, deviation of a, of b) of f = a d + b w from sums `s` with noise of deviation `noise`; `sure` is
    what is known beforehand of b, that it is small: (noise over its deviation)^2.
    """
    ww = s[5] + sure
    det = s[3] * ww - s[4] * s[4]
    if det <= 1e-6 * s[3] * ww or det <= 0.0:
        return 0.0, 0.0, 1e3, 1e3
    a, b = (s[1] * ww - s[2] * s[4]) / det, (s[2] * s[3] - s[1] * s[4]) / det
    return a, b, noise * math.sqrt(ww / det), noise * math.sqrt(s[3] / det)


@kernel
def gain_and_magnets(s, p):
    """Return (a, b, deviation of a, of b), b over b_motor: healthy magnets are off by MAGNETS, which tells of a."""
    sure = p.sigma_f / (MAGNETS * p.b_motor)
    a, _, da, _ = solve(s, p.sigma_f, sure * sure)
    _, b, _, db = solve(s, p.sigma_f, 0.0)
    return a, b / p.b_motor, da, db / p.b_motor


@kernel
def gains(x, p, f, d, w, dt):
    """Take a sample into the gains of current and magnets, and test them."""
    h, ka, kb = p.even * dt, KNOWN_A * d / p.sigma_f, KNOWN_B * p.b_motor * w / p.sigma_f
    for k in range(2):
        # forgets by what the sample tells, so that a drive at work is judged at once, one at rest at all
        told = min(ka * ka, kb * kb)
        if k == 1:  # magnets at rest are neither weak nor healed
            told = 1.0 if x.weak > 0.5 else (KNOWN_NOW * d / p.sigma_f) * (KNOWN_NOW * d / p.sigma_f)
        keep = 1.0 - min(max(told, h / TAU_MOST), h / TAU_NOW)
        if k == 0 and x.age < LEARN[2]:
            keep = 1.0  # all there is to learn from
        s = x.gain_sum if k == 0 else x.gain_now
        s[0] = keep * s[0] + f * f
        s[1] = keep * s[1] + f * d
        s[2] = keep * s[2] + f * w
        s[3] = keep * s[3] + d * d
        s[4] = keep * s[4] + d * w
        s[5] = keep * s[5] + w * w
    a, x.gain_b, da, db = gain_and_magnets(x.gain_sum, p)
    x.gain_a = a
    over_a = math.fabs(a) if x.gain_learned > 0.5 else outside(a, TOLERANCE)
    over_a -= p.z_gain * math.sqrt(da * da + x.gain_doubt * x.gain_doubt)
    over_b = math.fabs(x.gain_b) if x.magnets_learned > 0.5 else outside(x.gain_b, OFF_B)
    over_b -= p.z_gain * math.sqrt(db * db + x.magnets_doubt * x.magnets_doubt)
    x.r_gain = max(over_a / p.th_a, over_b / p.th_b)
    sure = True
    if x.hot_gain > 0.5:  # `gain_now` tells whether it stands or has healed; where nothing moves, neither
        a, b, da, db = gain_and_magnets(x.gain_now, p)
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
            learn(x, a, da, p)
        shows = x.r_gain >= 1.0
        x.gain_fault, x.gain_ended = a, 0.0
        if shows:
            x.weak = 1.0 if over_b / p.th_b > over_a / p.th_a else 0.0
    before = x.hot_gain
    if sure:
        x.gain_timer, x.hot_gain = confirm(x.gain_timer, x.hot_gain, shows, p.even * dt, 0.2, RELEASE)
    if before > 0.5 and x.hot_gain < 0.5:  # healed: what came before is of the fault
        for k in range(6):
            if x.gain_ended >= ENDED:
                x.gain_now[k] = 0.0
            x.gain_sum[k] = x.gain_now[k]
