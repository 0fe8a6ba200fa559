"""Regression with a random walk, whitening, and the likelihood ratio of an oscillation, as kernels on the records of
`fdi.pitch_moment_glr.pitch_moment_glr`. Sources there.
"""


from actuators.block import kernel
from fdi.pitch_moment_glr.moment import NX

NA = 8  # order of the whitening filter
NF = 56  # frequencies
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
def correlate(x, p, e, s, roll):
    """Advance all hypotheses by the innovation `e` of variance `s`: an oscillation that grows with the memory's rate.

    G = c - xw' d,  d' = k (d + K G),  z' = k z + G e / s,  M' = k^2 M + G G' / s: d is what theta has learned of the
    oscillation, followed for the terms that a manoeuvre moves, and G what is left of it in the innovation. Whatever G
    is, as long as it comes from the past, M is the variance of z. `roll` is the whitened roll acceleration.
    """
    terms, gains = (x.xw[0], x.xw[1], x.xw[2], x.xw[3]), (x.K[0], x.K[1], x.K[2], x.K[3])
    g, own = 1.0 / s, terms[2]
    for f in range(NF):
        cc, ss = x.cosine[f], x.sine[f]
        c, d = p.turn_c[f] * cc - p.turn_s[f] * ss, p.turn_s[f] * cc + p.turn_c[f] * ss
        x.cosine[f], x.sine[f] = c, d
        keep = p.keep[f]
        twice = keep * keep
        G, H = c, d
        for i in range(4):
            G -= terms[i] * x.d_c[i, f]
            H -= terms[i] * x.d_s[i, f]
        for i in range(4):
            x.d_c[i, f] = keep * (x.d_c[i, f] + gains[i] * G)
            x.d_s[i, f] = keep * (x.d_s[i, f] + gains[i] * H)
        G_s, H_s = G * g, H * g
        x.z_c[f] = keep * x.z_c[f] + G_s * e
        x.z_s[f] = keep * x.z_s[f] + H_s * e
        x.z_g[f] = keep * x.z_g[f] + own * g * e
        x.M_cc[f] = twice * x.M_cc[f] + G_s * G
        x.M_cs[f] = twice * x.M_cs[f] + G_s * H
        x.M_ss[f] = twice * x.M_ss[f] + H_s * H
        x.M_gg[f] = twice * x.M_gg[f] + own * g * own
        for i in range(2):  # of the static moment and of the elevator's
            x.L_c[i, f] = twice * x.L_c[i, f] + G_s * terms[2 * i]
            x.L_s[i, f] = twice * x.L_s[i, f] + H_s * terms[2 * i]
        x.R_c[f] = keep * x.R_c[f] + c * roll
        x.R_s[f] = keep * x.R_s[f] + d * roll


@kernel
def ratio(x, p, f):
    """Return twice the log likelihood ratio of frequency f.

    Its variance grows by `share` of the moments of angle of attack and elevator, which no coefficient takes out.
    """
    mcc, mcs, mss = x.M_cc[f], x.M_cs[f], x.M_ss[f]
    det = mcc * mss - mcs * mcs
    if det <= 1e-9 * mcc * mss or mcc <= 0.0:
        return 0.0
    zc, zs = x.z_c[f], x.z_s[f]
    value = (mss * zc * zc - 2.0 * mcs * zc * zs + mcc * zs * zs) / det
    leak = 0.0
    for i in range(2):
        lc, ls = x.L_c[i, f], x.L_s[i, f]
        leak += (mss * lc * lc - 2.0 * mcs * lc * ls + mcc * ls * ls) / det
    return value / (1.0 + p.share * p.share * leak)
