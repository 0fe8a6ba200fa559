"""Evidence of fault hypotheses over one window: Student-t likelihoods of innovations with normal priors, by Cholesky.

    theta ~ N(m, diag sd^2),    Q = E - 2 b'm + m'J m - r'(J + P^-1)^-1 r,    r = b - J m
    L = -(NU + n) / 2 ln(1 + Q / NU) - 1/2 ln det(I + P J)                              [Basseville93] section 7.2

An oscillation is LINES sines of an octave together, so that its frequency may lie between them: the steady responses of
the filter (`response`). They meet the gain's column only, the last one, so that the factor of the others serves all.
"""

import math

from actuators.block import kernel
from fdi.isolation.filter import FAST, FLOW, FRICTION, GAIN, LEAK, OFFSET, SCALE, SENSORS, SOFT, SUPPLY, N
from fdi.isolation.sums import LINES, PAIRS, WAVES

ADDED, IN_PLACE, SWING_ROD, SWING_SURFACE, SWING_PRESSURE, SWING_LOAD = range(6)  # oscillations
LOSS, LEAKAGE, LOW_SUPPLY, SOFT_OIL, RUBS, OPEN, SCALED, FREE = range(6, 14)
NOISE_ROD, NOISE_SURFACE, NOISE_PRESSURE, PAIR, OFF_PRESSURE = range(14, 19)
HYPOTHESES = 19
NU = 50.0
NOISE_LEAST = 0.05  # of the sensors' variance: one that reports no noise at all is not that good
APART = 0.1  # least share of the gain's column that no oscillation explains: responses are those of rest
WHITE = 0.3  # noise is not correlated more from tick to tick
LEAST = 3.0  # Q is no less than noise leaves, by so many sigma

PARAMS = [
    ("sine_sd", "f8", (5,)),  # amplitudes that are expected: rod of a valve's [m], rod, surface [m], pressure, load [1]
    ("loss_mean", "f8", "-"),  # of a lossy valve's gain
    ("loss_sd", "f8", "-"),
    ("gone_sd", "f8", "-"),  # of the gain where nothing comes through, -1
    ("slow_sd", "f8", "-"),  # of the slow part's gain where an oscillation is in its place
    ("worse_mean", "f8", (N,)),  # of the columns where they are a fault
    ("worse_sd", "f8", (N,)),
    ("offset_sd", "f8", "-"),  # of a pressure sensor that is wrong
    ("scale_sd", "f8", "-"),  # of a pressure sensor whose scale is wrong
    ("open_sd", "f8", "m/s"),  # flow of a valve that stands open
    ("bypass", "f8", "m/s"),  # leakage of an actuator that lets go
    ("occam", "f8", "-"),  # what a hypothesis of noise costs
    ("memory", "f8", "s"),  # of what the flight teaches
    ("floor", "f8", "-"),  # of a learned error's standard deviation, over the tolerance's
]
PRIORS = {
    "sine_sd": (4e-4, 1e-3, 1e-3, 0.08, 0.05),
    "loss_mean": -0.45, "loss_sd": 0.18,  # 10 to 80 % within two sigma: beyond, it is as good as gone
    "gone_sd": 0.03, "slow_sd": 0.7, "offset_sd": 0.15, "scale_sd": 0.35,
    "worse_mean": (0.3, -0.7, 0.5, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "worse_sd": (0.3, 0.25, 0.25, 0.1, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    "open_sd": 0.2, "bypass": 1.0,  # 9 deg/s to 45 deg/s within its sigma; that of actuators/hydraulic/actuator.py
    "occam": 6.0, "memory": 30.0, "floor": 0.1,
}  # fmt: skip
STATE = [
    ("JJ", "f8", (PAIRS,)),  # sums of the window at hand
    ("bb", "f8", (N,)),
    ("EE", "f8"),
    ("LL", "f8", (N, N)),  # scratch
    ("yy", "f8", (N,)),
    ("y2", "f8", (N,)),
    ("info", "f8", (N,)),  # of each column alone: information,
    ("pull", "f8", (N,)),  # and its product with the column's value
    ("prior", "f8", (2, N)),  # means and standard deviations of the hypothesis at hand
    ("C", "f8", (WAVES, WAVES)),  # an oscillation's columns
    ("LC", "f8", (WAVES, WAVES)),
    ("cb", "f8", (WAVES,)),
    ("cx", "f8", (WAVES,)),  # with the gain's
    ("cf", "f8", (WAVES,)),  # with that of its fast part
    ("cy", "f8", (WAVES,)),
    ("cl", "f8", (WAVES,)),
    ("cg", "f8", (WAVES,)),
    ("ca", "f8", (WAVES,)),
    ("ev_octave", "f8"),  # last evaluated octave, -1 for none at this tick
    ("ev_n", "f8"),
    ("ev_Q", "f8", (HYPOTHESES + 1,)),  # what each leaves; the last: health
    ("ev", "f8", (HYPOTHESES,)),  # evidence against health
    ("ev_hz", "f8", (6,), "Hz"),
    ("ev_amplitude", "f8", (6,)),
]


@kernel
def at(a, b):
    """Return the place of (a, b) in the packed lower triangle."""
    return a * (a + 1) // 2 + b if a >= b else b * (b + 1) // 2 + a


@kernel
def gather(x, w, over):
    """Copy the sums of window `w`, in units of the noise."""
    for i in range(PAIRS):
        x.JJ[i] = x.window_J[w, i] * over
    for i in range(N):
        x.bb[i] = x.window_b[w, i] * over
    x.EE = 0.0
    for j in range(SENSORS):
        x.EE += x.window_E[w, j] * over


@kernel
def factor(x):
    """Write the Cholesky factor of J + P^-1 with x.prior; return ln det(I + P J)."""
    L, det = x.LL, 1.0
    for a in range(N):
        for b in range(a + 1):
            v = x.JJ[at(a, b)]
            if a == b:
                v += 1.0 / (x.prior[1, a] * x.prior[1, a])
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                v = max(v, 1e-12)
                det *= v * x.prior[1, a] * x.prior[1, a]
                L[a, a] = math.sqrt(v)
            else:
                L[a, b] = v / L[b, b]
    return math.log(det)


@kernel
def left(x):
    """Return Q with x.prior and its factor; write y."""
    Q = x.EE
    for a in range(N):
        r, m = x.bb[a], x.prior[0, a]
        Jm = 0.0
        for b in range(N):
            if x.prior[0, b] != 0.0:
                Jm += x.JJ[at(a, b)] * x.prior[0, b]
        Q += m * (Jm - 2.0 * r)
        r -= Jm
        for k in range(a):
            r -= x.LL[a, k] * x.yy[k]
        x.yy[a] = r / x.LL[a, a]
        Q -= x.yy[a] * x.yy[a]
    return Q


@kernel
def logarithm(Q, n):
    """Return the logarithm of the marginal likelihood but for its determinant."""
    return -0.5 * (NU + n) * math.log(1.0 + max(Q, n - LEAST * math.sqrt(2.0 * n)) / NU)


@kernel
def health(x):
    """Take what the flight has taught as the prior."""
    for i in range(N):
        x.prior[0, i] = 0.0
        x.prior[1, i] = x.sd[i]


@kernel
def columns(x, p, w, o, place, over):
    """Write the sums of an oscillation's columns at `place`: with each other, the innovations, the gain's signature."""
    for k in range(WAVES):
        x.cb[k] = x.cx[k] = x.cf[k] = 0.0
        for l in range(k + 1):
            x.C[k, l] = 0.0
    for j in range(SENSORS):
        if x.window_n[w, j] <= 0.0:
            continue
        m = over * x.window_n[w, j] / x.window_age[w]  # ticks of a block
        for k in range(LINES):
            a, b = p.response[place, o, k, 2 * j], p.response[place, o, k, 2 * j + 1]
            i = 2 * k
            e, g, f = x.window_D[w, 0, j], x.window_D[w, 1, j], x.window_D[w, 2, j]
            x.cb[i] += (a * e[i] - b * e[i + 1]) * over
            x.cb[i + 1] += (b * e[i] + a * e[i + 1]) * over
            x.cx[i] += (a * g[i] - b * g[i + 1]) * over
            x.cx[i + 1] += (b * g[i] + a * g[i + 1]) * over
            if place == 0:
                x.cf[i] += (a * f[i] - b * f[i + 1]) * over
                x.cf[i + 1] += (b * f[i] + a * f[i + 1]) * over
            for l in range(k + 1):
                c, d = p.response[place, o, l, 2 * j], p.response[place, o, l, 2 * j + 1]
                n = 2 * l
                cc, cs = x.gram[w, at(i, n)], x.gram[w, at(i, n + 1)]
                sc, ss = x.gram[w, at(i + 1, n)], x.gram[w, at(i + 1, n + 1)]
                # rows (a, -b), (b, a) of the one, (c, -d), (d, c) of the other
                x.C[i, n] += m * (a * (c * cc - d * cs) - b * (c * sc - d * ss))
                x.C[i, n + 1] += m * (a * (d * cc + c * cs) - b * (d * sc + c * ss))
                x.C[i + 1, n] += m * (b * (c * cc - d * cs) + a * (c * sc - d * ss))
                x.C[i + 1, n + 1] += m * (b * (d * cc + c * cs) + a * (d * sc + c * ss))


@kernel
def factor_columns(x, sd):
    """Factor the sums of an oscillation's columns; return ln det. x.cl becomes what they share with the gain's."""
    L, det = x.LC, 1.0
    for a in range(WAVES):
        for b in range(a + 1):
            v = x.C[a, b]
            if a == b:
                v += 1.0 / (sd * sd)
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                v = max(v, 1e-3 / (sd * sd))
                det *= v * sd * sd
                L[a, a] = math.sqrt(v)
            else:
                L[a, b] = v / L[b, b]
        l, r, f = x.cx[a], x.cb[a], x.cf[a]
        for k in range(a):
            l -= L[a, k] * x.cl[k]
            r -= L[a, k] * x.cy[k]
            f -= L[a, k] * x.cg[k]
        x.cl[a] = l / L[a, a]
        x.cy[a] = r / L[a, a]
        x.cg[a] = f / L[a, a]
    return math.log(det)


@kernel
def beside(x, Q, r, pivot2):
    """Return (Q, ln det) of a hypothesis with these columns besides; Q, r and pivot2 are its own without the gain.
    The amplitudes are in x.ca."""
    own, shared = 0.0, 0.0
    for a in range(WAVES):
        Q -= x.cy[a] * x.cy[a]
        own += x.cl[a] * x.cl[a]
        shared += x.cl[a] * x.cy[a]
    d = max(pivot2 - own, APART * pivot2)
    t = (r - shared) / d
    for a in range(WAVES - 1, -1, -1):
        v = x.cy[a] - x.cl[a] * t
        for k in range(a + 1, WAVES):
            v -= x.LC[k, a] * x.ca[k]
        x.ca[a] = v / x.LC[a, a]
    return Q - t * t * d, math.log(d / pivot2)


@kernel
def heard(x, p, o, h):
    """Write frequency and amplitude of the fitted oscillation."""
    total, weighed = 0.0, 0.0
    for k in range(LINES):
        a2 = x.ca[2 * k] * x.ca[2 * k] + x.ca[2 * k + 1] * x.ca[2 * k + 1]
        total += a2
        weighed += a2 * p.hz[o, k]
    x.ev_hz[h] = weighed / max(total, 1e-300)
    x.ev_amplitude[h] = math.sqrt(total)


@kernel
def inverse(x, i):
    """Return element (i, i) of the inverse of J + P^-1, the variance of column `i`, by the factor."""
    L, total = x.LL, 0.0
    for a in range(i, N):
        v = 1.0 if a == i else 0.0
        for k in range(i, a):
            v -= L[a, k] * x.y2[k]
        x.y2[a] = v / L[a, a]
        total += x.y2[a] * x.y2[a]
    return total


@kernel
def alone(x):
    """Write what the sums say of each column, all others at the priors of the factor and solution at hand (means 0):
    information w and its product b with the column's value, for `other`."""
    for a in range(N - 1, -1, -1):
        v = x.yy[a]
        for k in range(a + 1, N):
            v -= x.LL[k, a] * x.pull[k]
        x.pull[a] = v / x.LL[a, a]
    for i in range(N):
        variance = inverse(x, i)
        x.info[i] = max(1.0 / variance - 1.0 / (x.prior[1, i] * x.prior[1, i]), 0.0)
        x.pull[i] /= variance


@kernel
def other(x, Q0, logdet0, i, mean, sd):
    """Return (Q, ln det) where column `i` has the prior N(mean, sd^2) instead of that of health, which left
    (Q0, logdet0): Q0 + b^2 / (w + 1 / sd0^2) - 2 b mean + w mean^2 - (b - w mean)^2 / (w + 1 / sd^2)."""
    w, b, sd0 = x.info[i], x.pull[i], x.sd[i]
    r = b - w * mean
    Q = Q0 + b * b / (w + 1.0 / (sd0 * sd0)) + mean * (w * mean - 2.0 * b) - r * r / (w + 1.0 / (sd * sd))
    return Q, logdet0 + math.log((1.0 + w * sd * sd) / (1.0 + w * sd0 * sd0))


@kernel
def give(x, h, Q, logdet, n, base):
    """Keep what hypothesis `h` leaves and its evidence."""
    x.ev_Q[h] = Q
    x.ev[h] = logarithm(Q, n) - 0.5 * logdet - base


@kernel
def evaluate(x, p, o):
    """Write the evidence of every hypothesis over the window of octave `o`."""
    w = o
    n = 0.0
    for j in range(SENSORS):
        n += x.window_n[w, j]
    x.ev_octave, x.ev_n = o, n
    over = 1.0 / x.noise_scale
    gather(x, w, over)
    health(x)
    logdet0 = factor(x)
    Q0 = left(x)
    base = logarithm(Q0, n) - 0.5 * logdet0
    x.ev_Q[HYPOTHESES] = Q0
    alone(x)
    # beside an oscillation the other errors stand as they were learned: only the gain's signature meets its columns
    gone = -1.0 - x.mu[GAIN]
    J, r = x.JJ[at(GAIN, GAIN)], x.bb[GAIN]
    pivot2_health = J + 1.0 / (x.sd[GAIN] * x.sd[GAIN])
    logdet_health = math.log(pivot2_health * x.sd[GAIN] * x.sd[GAIN])
    # in place: the fast part of the command does not come through, of the slow part some or all or nothing
    m, F = -1.0 - x.mu[FAST], x.JJ[at(FAST, FAST)]
    Q_gone = x.EE + m * (m * F - 2.0 * x.bb[FAST])
    r_gone = r - m * x.JJ[at(GAIN, FAST)]
    pivot2_gone = J + 1.0 / (p.slow_sd * p.slow_sd)
    logdet_gone = math.log(pivot2_gone * p.slow_sd * p.slow_sd)
    for place in range(5):
        columns(x, p, w, o, place, over)
        sd = p.sine_sd[place] * (6.2831853 * p.hz[o, 1] if place == 0 else 1.0)
        h = 0 if place == 0 else place + 1
        logdet = factor_columns(x, sd)
        Q, more = beside(x, x.EE, r, pivot2_health)
        give(x, h, Q, logdet_health + logdet + more, n, base)
        heard(x, p, o, h)
        if place == 0:
            for a in range(WAVES):
                x.cy[a] -= m * x.cg[a]
            Q, more = beside(x, Q_gone, r_gone, pivot2_gone)
            give(x, IN_PLACE, Q, logdet_gone + logdet + more, n, base)
            heard(x, p, o, IN_PLACE)
    health(x)
    for i in range(FAST, GAIN + 1):
        x.prior[0, i], x.prior[1, i] = p.loss_mean - x.mu[i], p.loss_sd
    logdet = factor(x)
    give(x, LOSS, left(x), logdet, n, base)
    for h in range(LEAKAGE, RUBS + 1):
        i = LEAK if h == LEAKAGE else (SUPPLY if h == LOW_SUPPLY else (SOFT if h == SOFT_OIL else FRICTION))
        Q, logdet = other(x, Q0, logdet0, i, p.worse_mean[i] - x.mu[i], p.worse_sd[i])
        give(x, h, Q, logdet, n, base)
    Q, logdet = other(x, Q0, logdet0, OFFSET, 0.0, p.offset_sd)
    give(x, OFF_PRESSURE, Q, logdet, n, base)
    Q, logdet = other(x, Q0, logdet0, SCALE, 0.0, p.scale_sd)
    give(x, SCALED, Q, logdet, n, base)
    # a valve that stands open
    health(x)
    x.prior[0, GAIN], x.prior[1, GAIN] = gone, p.gone_sd
    x.prior[0, FAST], x.prior[1, FAST] = -1.0 - x.mu[FAST], p.gone_sd
    x.prior[1, FLOW] = p.open_sd
    logdet = factor(x)
    give(x, OPEN, left(x), logdet, n, base)
    # let go: the valve is cut off, the chambers are joined
    health(x)
    x.prior[0, GAIN], x.prior[1, GAIN] = gone, p.gone_sd
    x.prior[0, FAST], x.prior[1, FAST] = -1.0 - x.mu[FAST], p.gone_sd
    x.prior[0, LEAK], x.prior[1, LEAK] = p.bypass, 0.3 * p.bypass
    logdet = factor(x)
    give(x, FREE, left(x), logdet, n, base)
    for j in range(SENSORS):
        m = x.window_n[w, j]
        ratio = max(x.window_E[w, j] * over / max(m, 1.0), 1.0)
        if x.c1[w, j] > WHITE * x.window_E[w, j]:
            ratio = 1.0
        give(x, NOISE_ROD + j, Q0 - m * (ratio - 1.0), logdet0 + m * math.log(ratio) + p.occam, n, base)
    # rod and surface apart
    b, J = 0.0, 0.0
    for j in range(SENSORS):
        H = p.still[2, j]
        b += H * x.window_M[w, j]
        J += H * H * x.window_n[w, j]
    b, J, sd = b * over, J * over, p.sine_sd[2]
    d = J + 1.0 / (sd * sd)
    give(x, PAIR, (Q0 - b * b / d) if o < 5 else 1e12, logdet0 + math.log(d * sd * sd), n, base)


@kernel
def teach(x, p, dt):
    """Take the block's lesson of the columns."""
    keep = math.exp(-p.block * dt / p.memory)
    over = 1.0 / x.noise_scale
    for a in range(N):
        lesson = x.block_b[a]
        for b in range(N):
            lesson += x.block_J[at(a, b)] * x.mu[b]
        x.lesson_b[a] = keep * x.lesson_b[a] + lesson * over
    for i in range(PAIRS):
        x.lesson_J[i] = keep * x.lesson_J[i] + x.block_J[i] * over
    E, n = 0.0, 0.0
    for j in range(SENSORS):
        E += x.block_E[j]
        n += x.block_N[j]
    if n > 0.0:
        a = p.block * dt / min(p.memory, max(x.h_clock - 1.0, p.block * dt))
        x.noise_scale = max(x.noise_scale + a * (min(E / n, 2.0 * x.noise_scale) - x.noise_scale), NOISE_LEAST)


@kernel
def solve(x, p):
    """Solve for the learned errors and their standard deviations."""
    L = x.LL
    for a in range(N):
        for b in range(a + 1):
            v = x.lesson_J[at(a, b)]
            if a == b:
                v += 1.0 / (p.prior_sd[a] * p.prior_sd[a])
            for k in range(b):
                v -= L[a, k] * L[b, k]
            L[a, b] = math.sqrt(max(v, 1e-12)) if a == b else v / L[b, b]
    for a in range(N):
        v = x.lesson_b[a] + p.prior_mean[a] / (p.prior_sd[a] * p.prior_sd[a])
        for k in range(a):
            v -= L[a, k] * x.yy[k]
        x.yy[a] = v / L[a, a]
    for a in range(N - 1, -1, -1):
        v = x.yy[a]
        for k in range(a + 1, N):
            v -= L[k, a] * x.mu[k]
        x.mu[a] = v / L[a, a]
    for i in range(N):
        x.sd[i] = math.sqrt(inverse(x, i) + p.floor * p.floor * p.prior_sd[i] * p.prior_sd[i])
