"""Which hypothesis is the likeliest, and what it tells of class and side, as kernels on the records of
`fdi.pitch_moment_glr.pitch_moment_glr`.
"""

import math

from actuators.block import kernel
from fdi.common.verdict import AMBIGUOUS, OFC_LIQUID, OFC_SOLID
from fdi.pitch_moment_glr.core import NF, ratio

NB = 4  # bands of frequency with a threshold each, an equal share of the logarithm
TURNS = 4  # samples until every hypothesis has been looked at
YOUNG = 3.0  # periods until a frequency is judged
APART = 0.5  # of the command that is not the oscillation's: with less its own effect cannot be told
CALM = 0.12  # of the lean: with more, roll swings by itself, as in gusts
SEGMENT = (0.45, 1.7)  # of one side, or of a segment of it, inner .62 and outer 1.37, whose moments in roll differ


@kernel
def judge(x, p):
    """Look at a part of the hypotheses; set x.r and where it comes from."""
    turn = int(x.turn)
    x.turn = (turn + 1) % TURNS
    largest, where = 0.0, 0
    for b in range(NB):
        x.raw[b] = 0.0
    for k in range(NF // TURNS):
        f = k * TURNS + turn
        if x.since < YOUNG * p.period[f]:
            continue
        value = ratio(x, p, f)
        b = f * NB // NF
        x.raw[b] = max(x.raw[b], value)
        if value > largest * p.threshold[b]:
            largest, where = value / p.threshold[b], f
    x.best[turn], x.which[turn] = largest, where
    x.r = 0.0
    found = -1
    for i in range(TURNS):
        if x.best[i] > x.r:
            x.r, found = x.best[i], int(x.which[i])
    return found


@kernel
def classify(x, p, f):
    """Name class and side of an oscillation at frequency f.

    M is of squared weights: an oscillation that stays comes out of M^-1 z at twice its size.
    """
    mcc, mcs, mss = x.M_cc[f], x.M_cs[f], x.M_ss[f]
    det = max(mcc * mss - mcs * mcs, 1e-300)
    zc, zs, lc, ls = x.z_c[f], x.z_s[f], x.L_c[1, f], x.L_s[1, f]
    a_c, a_s = (mss * zc - mcs * zs) / det, (mcc * zs - mcs * zc) / det
    b_c, b_s = (mss * lc - mcs * ls) / det, (mcc * ls - mcs * lc) / det
    x.frequency = 1.0 / p.period[f]
    told = max(x.M_gg[f] - b_c * lc - b_s * ls, 1e-300)
    x.lost = 0.5 * (x.z_g[f] - b_c * zc - b_s * zs) / told
    x.lost_sd = min(math.sqrt(0.25 / told + 4e-4), 1e3)
    if told < APART * x.M_gg[f]:  # the command does little but answer the oscillation
        x.verdict = AMBIGUOUS
    elif x.lost + 3.0 * x.lost_sd < -0.1:
        x.verdict = OFC_SOLID
    elif x.lost - 3.0 * x.lost_sd > -0.15:
        x.verdict = OFC_LIQUID
    else:
        x.verdict = AMBIGUOUS
    samples = 1.0 / (1.0 - p.keep[f])  # that the sums remember
    size = max(0.5 * math.hypot(a_c, a_s), 1e-12)
    scale = size * p.swing_roll
    scale = math.copysign(max(math.fabs(scale), 1e-12), scale)
    x.lean = (x.R_c[f] * a_c + x.R_s[f] * a_s) / size / samples / scale
    x.lean_sd = min(math.sqrt(x.local_r / samples) / math.fabs(scale), 1e3)
    x.culprit = 1.0
    if x.lean_sd < CALM and SEGMENT[0] < math.fabs(x.lean) < SEGMENT[1]:
        x.culprit = 2.0 if x.lean > 0.0 else 3.0
