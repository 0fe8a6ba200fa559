"""Regression with a random walk, whitening, and the likelihood ratio of an oscillation, as kernels on the records of
`fdi.pitch_moment_glr.pitch_moment_glr`. Sources there.
"""

import math

from actuators.block import kernel
from fdi.pitch_moment_glr.moment import NX

NA = 8  # order of the whitening filter
NF = 60  # frequencies
NW = 2  # windows of each that begin half a window apart
NH = NF * NW
F_LOW, F_HIGH = 0.29, 6.2  # [Hz]


@kernel
def levinson(x):
    """Fill x.ar (NA,) with the predictor of the residual from its autocorrelations x.auto, by Levinson's recursion."""
    power = x.auto[0] * 1.0001
    for i in range(NA):
        x.ar[i] = 0.0
    for m in range(NA):
        k = x.auto[m + 1]
        for i in range(m):
            k -= x.ar[i] * x.auto[m - i]
        k /= power
        for i in range(m):
            x.ar_1[i] = x.ar[i] - k * x.ar[m - 1 - i]
        for i in range(m):
            x.ar[i] = x.ar_1[i]
        x.ar[m] = k
        power *= 1.0 - k * k
    return power


@kernel
def whiten(x, y):
    """Fill x.xw, the terms through 1 - sum a_i z^-i, and return y through it; take both into their rings."""
    now = int(x.place)
    for j in range(NX):
        x.xw[j] = x.high[j]
    yw = y
    for i in range(NA):
        k = (now + NA - 1 - i) % NA
        a = x.ar[i]
        yw -= a * x.past_y[k]
        for j in range(NX):
            x.xw[j] -= a * x.past[k, j]
    x.past_y[now] = y
    for j in range(NX):
        x.past[now, j] = x.high[j]
    x.place = (now + 1) % NA
    return yw


@kernel
def gain(x, p, ts):
    """Let theta walk for a sample, fill its gain x.K, return the variance of the innovation."""
    s = x.noise
    for i in range(NX):
        x.P[i, i] = min(x.P[i, i] + p.walk[i] * ts, p.prior[i] * p.prior[i])
    for i in range(NX):
        v = 0.0
        for j in range(NX):
            v += x.P[i, j] * x.xw[j]
        x.K[i] = v
        s += v * x.xw[i]
    return s


@kernel
def correct(x, e, s):
    """Correct theta and P by the innovation `e` of variance `s`."""
    for i in range(NX):
        x.theta[i] += x.K[i] / s * e
        for j in range(i + 1):
            x.P[i, j] -= x.K[i] * x.K[j] / s
            x.P[j, i] = x.P[i, j]
    for i in range(NX):
        x.K[i] /= s


@kernel
def correlate(x, p, e, s, ts):
    """Advance all hypotheses by the innovation `e` of variance `s`: an oscillation since the window's beginning.

    G = c - xw' d,  d' = d + K G,  z += G e / s,  M += G G' / s: what the oscillation leaves in the innovation once theta
    has learned its part of it.
    """
    for f in range(NF):
        c, d = x.cosine[f], x.sine[f]
        x.cosine[f] = p.turn_c[f] * c - p.turn_s[f] * d
        x.sine[f] = p.turn_s[f] * c + p.turn_c[f] * d
        for w in range(NW):
            h = w * NF + f
            x.left[h] -= ts
            x.G_c[h], x.G_s[h] = x.cosine[f], x.sine[f]
            if x.left[h] <= 0.0:  # a new window
                x.left[h] += p.window[f]
                x.z_c[h], x.z_s[h], x.z_g[h] = 0.0, 0.0, 0.0
                x.M_cc[h], x.M_cs[h], x.M_ss[h], x.M_gg[h] = 0.0, 0.0, 0.0, 0.0
                for i in range(3):
                    x.L_c[i, h], x.L_s[i, h] = 0.0, 0.0
                for j in range(NX):
                    x.d_c[j, h], x.d_s[j, h] = 0.0, 0.0
    for j in range(NX):
        v = x.xw[j]
        for h in range(NH):
            x.G_c[h] -= v * x.d_c[j, h]
            x.G_s[h] -= v * x.d_s[j, h]
    for j in range(NX):
        k = x.K[j]
        for h in range(NH):
            x.d_c[j, h] += k * x.G_c[h]
            x.d_s[j, h] += k * x.G_s[h]
    g, b0, b1, b2 = e / s, x.xw[0] / s, x.xw[2] / s, x.xw[3] / s
    own, ownz = x.xw[3] * b2, x.xw[3] * g
    for h in range(NH):
        c, d = x.G_c[h], x.G_s[h]
        x.z_c[h] += c * g
        x.z_s[h] += d * g
        x.M_cc[h] += c * c / s
        x.M_cs[h] += c * d / s
        x.M_ss[h] += d * d / s
        x.L_c[0, h] += c * b0
        x.L_s[0, h] += d * b0
        x.L_c[1, h] += c * b1
        x.L_s[1, h] += d * b1
        x.L_c[2, h] += c * b2
        x.L_s[2, h] += d * b2
        x.M_gg[h] += own
        x.z_g[h] += ownz


@kernel
def ratio(x, p, h):
    """Return twice the log likelihood ratio of hypothesis h, over what wrong coefficients of the flown terms add to it."""
    mcc, mcs, mss = x.M_cc[h], x.M_cs[h], x.M_ss[h]
    det = mcc * mss - mcs * mcs
    if det <= 1e-9 * mcc * mss or mcc <= 0.0:
        return 0.0
    zc, zs = x.z_c[h], x.z_s[h]
    value = (mss * zc * zc - 2.0 * mcs * zc * zs + mcc * zs * zs) / det
    leak = 0.0
    for i in range(3):
        lc, ls = x.L_c[i, h], x.L_s[i, h]
        leak += (mss * lc * lc - 2.0 * mcs * lc * ls + mcc * ls * ls) / det
    return value / (1.0 + p.share * p.share * leak)
