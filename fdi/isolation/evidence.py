"""Evidence of fault hypotheses over one window: Student-t likelihoods of innovations with normal priors, by Cholesky.

    theta ~ N(m, diag sd^2),    Q = E - 2 b'm + m'J m - r'(J + P^-1)^-1 r,    r = b - J m
    L = -(NU + n) / 2 ln(1 + Q / NU) - 1/2 ln det(I + P J)                              [Basseville93] section 7.2

An oscillation is LINES sines of an octave together, so that its frequency may lie between them: the steady responses of
the filter (`response`). They meet the gain's column only, the last one, so that the factor of the others serves all.
"""

import math

from actuators.block import kernel
from fdi.common.decision import lever_variance
from fdi.isolation.filter import FAST, FLOW, FRICTION, GAIN, LEAK, OFFSET, SCALE, SENSORS, SOFT, SUPPLY, N
from fdi.isolation.sums import ENERGY, LINES, MEAN, NEXT, NUMBER, OCTAVES, PAIRS, PARTED, WAVES, gather

ADDED, IN_PLACE, SWING_ROD, SWING_SURFACE, SWING_PRESSURE, SWING_LOAD = range(6)  # oscillations
LOSS, LEAKAGE, LOW_SUPPLY, SOFT_OIL, RUBS, OPEN, FREE = range(6, 13)
NOISE_ROD, NOISE_SURFACE, NOISE_PRESSURE, PAIR, OFF_PRESSURE, SCALED_PRESSURE, DRIVEN = range(13, 20)
HYPOTHESES = 20
NU = 50.0
APART = 0.1  # least share of the gain's column that no oscillation explains: responses are those of rest
GUST = 2.0  # times what the load of this air usually swings by, that it may swing by
WHITE = 0.1  # noise is not correlated more from tick to tick
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
    ("scale_sd", "f8", "-"),  # of one whose scale is
    ("slow_flow_sd", "f8", "m/s"),  # flow that a slow oscillation adds
    ("open_sd", "f8", "m/s"),  # flow of a valve that stands open
    ("bypass", "f8", "m/s"),  # leakage of an actuator that lets go
    ("occam", "f8", "-"),  # what a hypothesis of noise costs
    ("memory", "f8", "s"),  # of what the flight teaches
    ("floor", "f8", "-"),  # of a learned error's standard deviation, over the tolerance's
]
PRIORS = {
    "sine_sd": (4e-4, 1e-3, 1e-3, 0.08, 0.05),
    "loss_mean": -0.45, "loss_sd": 0.18,  # 10 to 80 % within two sigma: beyond, it is as good as gone
    "gone_sd": 0.03, "slow_sd": 0.7, "offset_sd": 0.15, "scale_sd": 0.3,
    "worse_mean": (0.0, 0.0, 0.0, -0.7, 0.5, 0.15, 0.3, 0.0, 0.0, 0.0),
    "worse_sd": (1.0, 1.0, 1.0, 0.25, 0.25, 0.1, 0.3, 1.0, 1.0, 1.0),
    "slow_flow_sd": 0.01,  # 2 to 6 mm at 0.1 to 0.45 Hz
    "open_sd": 0.2, "bypass": 1.0,  # 9 deg/s to 45 deg/s within its sigma; that of actuators/hydraulic/actuator.py
    "occam": 6.0, "memory": 30.0, "floor": 0.3,
}  # fmt: skip
STATE = [
    ("LL", "f8", (PAIRS,)),  # Cholesky factor at hand, packed by rows
    ("yy", "f8", (N,)),
    ("y2", "f8", (N,)),
    ("info", "f8", (N,)),  # of each column alone: information,
    ("pull", "f8", (N,)),  # and its product with the column's value
    ("prior", "f8", (2, N)),  # means and standard deviations of the hypothesis at hand
    ("gram", "f8", (LINES * (LINES + 1) // 2, 4)),  # of two lines' waves: cos cos, cos sin, sin cos, sin sin
    ("cb", "f8", (WAVES,)),  # products of an oscillation's columns with the innovations, then the solution
    ("cx", "f8", (WAVES,)),  # with the gain's
    ("cf", "f8", (WAVES,)),  # with that of its fast part
    ("ca", "f8", (WAVES,)),  # amplitudes
    ("ev_octave", "f8"),  # last evaluated octave, -1 for none at this tick
    ("ev_n", "f8"),
    ("ev_Q", "f8", (HYPOTHESES + 1,)),  # what each leaves; the last: health
    ("ev", "f8", (HYPOTHESES,)),  # evidence against health
    ("ev_base", "f8"),  # logarithm of the likelihood of health
    ("ev_told", "f8", (PARTED,)),  # evidence of oscillations, perhaps in the parts of the window
    ("ev_hz", "f8", (6,), "Hz"),
    ("ev_air", "f8"),  # evidence that a load swings no more than it usually does in this air
    ("ev_load2", "f8"),  # mean square of the amplitudes of a load that swings
    ("air_load2", "f8", (OCTAVES,)),  # what that usually is in this air, by octave
]


@kernel
def at(a, b):
    """Return the place of (a, b) in the packed lower triangle."""
    return a * (a + 1) // 2 + b if a >= b else b * (b + 1) // 2 + a


@kernel
def factor(x, first):
    """Write rows and columns from `first` on of the Cholesky factor of J + P^-1 with x.prior; return what they add to
    ln det(I + P J). Where the columns before `first` have the priors they had, what they left stands."""
    L, det = x.LL, 1.0
    for a in range(first, N):
        i = a * (a + 1) // 2
        for b in range(first, a):
            k = b * (b + 1) // 2
            v = x.JJ[i + b]
            for c in range(b):
                v -= L[i + c] * L[k + c]
            L[i + b] = v / L[k + b]
        variance = x.prior[1, a] * x.prior[1, a]
        v = x.JJ[i + a] + 1.0 / variance
        for c in range(a):
            v -= L[i + c] * L[i + c]
        v = max(v, 1e-12)
        det *= v * variance
        L[i + a] = math.sqrt(v)
    return math.log(det)


@kernel
def left(x):
    """Return Q with x.prior and its factor; write y."""
    Q = 0.0
    for j in range(SENSORS):
        Q += x.tt[ENERGY, j]
    first = 0  # column with a mean
    while first < N and x.prior[0, first] == 0.0:
        first += 1
    for a in range(N):
        r, m = x.bb[a], x.prior[0, a]
        Jm = 0.0
        for b in range(first, N):
            Jm += x.JJ[at(a, b)] * x.prior[0, b]
        Q += m * (Jm - 2.0 * r)
        r -= Jm
        i = a * (a + 1) // 2
        for k in range(a):
            r -= x.LL[i + k] * x.yy[k]
        x.yy[a] = r / x.LL[i + a]
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
def powers(c, s, c_turn, s_turn):
    """Return sum z^n over n = 1 ... m by its real and imaginary part, where z^m = c + i s and z = c_turn + i s_turn:
    z (1 - z^m) / (1 - z)."""
    a, b = c_turn * (1.0 - c) + s_turn * s, s_turn * (1.0 - c) - c_turn * s
    down, up = 1.0 - c_turn, -s_turn
    over = 1.0 / max(down * down + up * up, 1e-300)
    return (a * down + b * up) * over, (b * down - a * up) * over


@kernel
def waves(x, p, w):
    """Write the sums of products of the waves of window `w`, over blocks, in closed form."""
    i = 0
    for k in range(LINES):
        c, s, c1, s1 = x.phase_c[w, k], x.phase_s[w, k], p.turn_c[w, k], p.turn_s[w, k]
        for l in range(k + 1):
            d, t, d1, t1 = x.phase_c[w, l], x.phase_s[w, l], p.turn_c[w, l], p.turn_s[w, l]
            sum_c, sum_s = powers(c * d - s * t, s * d + c * t, c1 * d1 - s1 * t1, s1 * d1 + c1 * t1)
            apart_c, apart_s = x.window_age[w], 0.0
            if l < k:
                apart_c, apart_s = powers(c * d + s * t, s * d - c * t, c1 * d1 + s1 * t1, s1 * d1 - c1 * t1)
            x.gram[i, 0], x.gram[i, 1] = 0.5 * (apart_c + sum_c), 0.5 * (sum_s - apart_s)
            x.gram[i, 2], x.gram[i, 3] = 0.5 * (sum_s + apart_s), 0.5 * (apart_c - sum_c)
            i += 1


@kernel
def columns(x, p, w, ears, place):
    """Write the sums of an oscillation's columns at `place`: with each other, packed in x.LL, with the innovations and
    with the gain's signature."""
    response = p.response[ears, place, w]
    for k in range(WAVES):
        x.cb[k] = x.cx[k] = x.cf[k] = 0.0
    for k in range(WAVES * (WAVES + 1) // 2):
        x.LL[k] = 0.0
    for j in range(SENSORS):
        if x.tt[NUMBER, j] <= 0.0:
            continue
        m = x.tt[NUMBER, j] / (x.window_age[w] * x.noise[j])  # ticks of a block, in units of the noise
        unit = 1.0 / math.sqrt(x.noise[j])
        pair = 0
        for k in range(LINES):
            a, b = response[k, 2 * j], response[k, 2 * j + 1]
            i = 2 * k
            e, g, f = x.window_D[w, 0, j], x.window_D[w, 1, j], x.window_D[w, 2, j]
            x.cb[i] += unit * (a * e[i] - b * e[i + 1])
            x.cb[i + 1] += unit * (b * e[i] + a * e[i + 1])
            x.cx[i] += unit * (a * g[i] - b * g[i + 1])
            x.cx[i + 1] += unit * (b * g[i] + a * g[i + 1])
            if place == 0:
                x.cf[i] += unit * (a * f[i] - b * f[i + 1])
                x.cf[i + 1] += unit * (b * f[i] + a * f[i + 1])
            for l in range(k + 1):
                c, d = response[l, 2 * j], response[l, 2 * j + 1]
                n = 2 * l
                cc, cs, sc, ss = x.gram[pair, 0], x.gram[pair, 1], x.gram[pair, 2], x.gram[pair, 3]
                pair += 1
                # rows (a, -b), (b, a) of the one, (c, -d), (d, c) of the other
                up, down = i * (i + 1) // 2 + n, (i + 1) * (i + 2) // 2 + n
                x.LL[up] += m * (a * (c * cc - d * cs) - b * (c * sc - d * ss))
                x.LL[down] += m * (b * (c * cc - d * cs) + a * (c * sc - d * ss))
                x.LL[down + 1] += m * (b * (d * cc + c * cs) + a * (d * sc + c * ss))
                if l < k:
                    x.LL[up + 1] += m * (a * (d * cc + c * cs) - b * (d * sc + c * ss))


@kernel
def factor_columns(x, sd):
    """Factor the sums of an oscillation's columns in x.LL, solve for cb, cx and cf in place; return ln det."""
    L, det, variance = x.LL, 1.0, sd * sd
    for a in range(WAVES):
        i = a * (a + 1) // 2
        for b in range(a):
            k = b * (b + 1) // 2
            v = L[i + b]
            for c in range(b):
                v -= L[i + c] * L[k + c]
            L[i + b] = v / L[k + b]
        v = L[i + a] + 1.0 / variance
        l, r, f = x.cx[a], x.cb[a], x.cf[a]
        for c in range(a):
            v -= L[i + c] * L[i + c]
            l -= L[i + c] * x.cx[c]
            r -= L[i + c] * x.cb[c]
            f -= L[i + c] * x.cf[c]
        v = max(v, 1e-3 / variance)
        det *= v * variance
        L[i + a] = math.sqrt(v)
        x.cx[a], x.cb[a], x.cf[a] = l / L[i + a], r / L[i + a], f / L[i + a]
    return math.log(det)


@kernel
def beside(x, Q, r, pivot2):
    """Return (Q, ln det) of a hypothesis with these columns besides; Q, r and pivot2 are its own without the gain.
    The amplitudes are in x.ca."""
    own, shared = 0.0, 0.0
    for a in range(WAVES):
        Q -= x.cb[a] * x.cb[a]
        own += x.cx[a] * x.cx[a]
        shared += x.cx[a] * x.cb[a]
    d = max(pivot2 - own, APART * pivot2)
    t = (r - shared) / d
    for a in range(WAVES - 1, -1, -1):
        v = x.cb[a] - x.cx[a] * t
        for k in range(a + 1, WAVES):
            v -= x.LL[k * (k + 1) // 2 + a] * x.ca[k]
        x.ca[a] = v / x.LL[a * (a + 3) // 2]
    return Q - t * t * d, math.log(d / pivot2)


@kernel
def heard(x, p, o, h):
    """Write the frequency of the fitted oscillation."""
    total, weighed = 0.0, 0.0
    for k in range(LINES):
        a2 = x.ca[2 * k] * x.ca[2 * k] + x.ca[2 * k + 1] * x.ca[2 * k + 1]
        total += a2
        weighed += a2 * p.hz[o, k]
    x.ev_hz[h] = weighed / max(total, 1e-300)


@kernel
def inverse(x, i):
    """Return element (i, i) of the inverse of J + P^-1, the variance of column `i`, by the factor."""
    L, total = x.LL, 0.0
    for a in range(i, N):
        v = 1.0 if a == i else 0.0
        for k in range(i, a):
            v -= L[a * (a + 1) // 2 + k] * x.y2[k]
        x.y2[a] = v / L[a * (a + 3) // 2]
        total += x.y2[a] * x.y2[a]
    return total


@kernel
def alone(x):
    """Write what the sums say of each column that is asked alone, the others at the priors of the factor and solution
    at hand (means 0): information w and its product b with the column's value, for `other`."""
    for a in range(N - 1, -1, -1):
        v = x.yy[a]
        for k in range(a + 1, N):
            v -= x.LL[k * (k + 1) // 2 + a] * x.pull[k]
        x.pull[a] = v / x.LL[a * (a + 3) // 2]
    for i in range(OFFSET, FLOW + 1):
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
    gather(x, o)
    n, E = 0.0, 0.0
    for j in range(SENSORS):
        n += x.tt[NUMBER, j]
        E += x.tt[ENERGY, j]
    x.ev_octave, x.ev_n = o, n
    health(x)
    logdet0 = factor(x, 0)
    first = 1.0  # determinant of the columns before LEAK, whose priors are the same for all
    for a in range(LEAK):
        pivot = x.LL[a * (a + 3) // 2] * x.sd[a]
        first *= pivot * pivot
    first = math.log(first)
    Q0 = left(x)
    base = logarithm(Q0, n) - 0.5 * logdet0
    x.ev_Q[HYPOTHESES], x.ev_base = Q0, base
    alone(x)
    health(x)
    for i in range(FAST, GAIN + 1):
        x.prior[0, i], x.prior[1, i] = p.loss_mean - x.mu[i], p.loss_sd
    logdet = first + factor(x, LEAK)
    give(x, LOSS, left(x), logdet, n, base)
    for h in range(LEAKAGE, RUBS + 1):
        i = LEAK if h == LEAKAGE else (SUPPLY if h == LOW_SUPPLY else (SOFT if h == SOFT_OIL else FRICTION))
        mean, w0 = p.worse_mean[i] - x.mu[i], 1.0 / (p.worse_sd[i] * p.worse_sd[i])
        Q, logdet = other(x, Q0, logdet0, i, mean, p.worse_sd[i])
        if (x.pull[i] + w0 * mean) / (x.info[i] + w0) * p.worse_mean[i] < 0.0:  # no leak flows against the pressure
            Q, logdet = Q0, logdet0
        give(x, h, Q, logdet, n, base)
    Q, logdet = other(x, Q0, logdet0, OFFSET, 0.0, p.offset_sd)
    give(x, OFF_PRESSURE, Q, logdet, n, base)
    Q, logdet = other(x, Q0, logdet0, SCALE, 0.0, p.scale_sd)
    give(x, SCALED_PRESSURE, Q, logdet, n, base)
    # what an oscillation slower than the lines adds within a window
    Q, logdet = other(x, Q0, logdet0, FLOW, 0.0, p.slow_flow_sd)
    give(x, DRIVEN, Q, logdet, n, base)
    # a valve that stands open
    gone = -1.0 - x.mu[GAIN]
    health(x)
    x.prior[0, GAIN], x.prior[1, GAIN] = gone, p.gone_sd
    x.prior[0, FAST], x.prior[1, FAST] = -1.0 - x.mu[FAST], p.gone_sd
    x.prior[1, FLOW] = p.open_sd
    logdet = first + factor(x, LEAK)
    give(x, OPEN, left(x), logdet, n, base)
    # free-floating: the valve passes nothing, the chambers are joined
    x.prior[1, FLOW] = x.sd[FLOW]
    x.prior[0, LEAK], x.prior[1, LEAK] = p.bypass, 0.3 * p.bypass
    logdet = first + factor(x, LEAK)
    give(x, FREE, left(x), logdet, n, base)
    for j in range(SENSORS):
        m = x.tt[NUMBER, j]
        ratio = max(x.tt[ENERGY, j] / max(m, 1.0), 1.0)
        if x.tt[NEXT, j] > WHITE * x.tt[ENERGY, j]:
            ratio = 1.0
        give(x, NOISE_ROD + j, Q0 - m * (ratio - 1.0), logdet0 + m * math.log(ratio) + p.occam, n, base)
    # rod and surface apart
    ears, b, J = int(x.heard), 0.0, 0.0
    for j in range(SENSORS):
        H = p.still[ears, 2, j] / math.sqrt(x.noise[j])
        b += H * x.tt[MEAN, j]
        J += H * H * x.tt[NUMBER, j]
    sd = p.sine_sd[2]
    d = J + 1.0 / (sd * sd)
    give(x, PAIR, Q0 - b * b / d, logdet0 + math.log(d * sd * sd), n, base)
    known = max(lever_variance(x, x.h_hat[0]), 1e-300)  # less that of a lever not known better
    d = J + 1.0 / known
    x.ev[PAIR] -= max(logarithm(Q0 - b * b / d, n) - 0.5 * (logdet0 + math.log(d * known)) - base, 0.0)
    # beside an oscillation the other errors stand as they were learned: only the gain's signature meets its columns
    J, r = x.JJ[at(GAIN, GAIN)], x.bb[GAIN]
    pivot2_health = J + 1.0 / (x.sd[GAIN] * x.sd[GAIN])
    logdet_health = math.log(pivot2_health * x.sd[GAIN] * x.sd[GAIN])
    # in place: the fast part of the command does not come through, of the slow part some or all or nothing
    m, F = -1.0 - x.mu[FAST], x.JJ[at(FAST, FAST)]
    Q_gone = E + m * (m * F - 2.0 * x.bb[FAST])
    r_gone = r - m * x.JJ[at(GAIN, FAST)]
    pivot2_gone = J + 1.0 / (p.slow_sd * p.slow_sd)
    logdet_gone = math.log(pivot2_gone * p.slow_sd * p.slow_sd)
    waves(x, p, o)
    for place in range(5):
        columns(x, p, o, ears, place)
        sd = p.sine_sd[place] * (6.2831853 * p.hz[o, LINES // 2] if place == 0 else 1.0)
        h = 0 if place == 0 else place + 1
        logdet = factor_columns(x, sd)
        Q, more = beside(x, E, r, pivot2_health)
        give(x, h, Q, logdet_health + logdet + more, n, base)
        heard(x, p, o, h)
        if place == 0:
            for a in range(WAVES):
                x.cb[a] -= m * x.cf[a]
            Q, more = beside(x, Q_gone, r_gone, pivot2_gone)
            give(x, IN_PLACE, Q, logdet_gone + logdet + more, n, base)
            heard(x, p, o, IN_PLACE)
    x.ev_load2 = 0.0
    for a in range(WAVES):
        x.ev_load2 += x.ca[a] * x.ca[a] / WAVES
    usual, x.ev_air = GUST * math.sqrt(x.air_load2[o]), 0.0
    if usual > 0.0 and x.ev[SWING_LOAD] > 0.0:
        columns(x, p, o, ears, 4)
        logdet = factor_columns(x, usual)
        Q, more = beside(x, E, r, pivot2_health)
        x.ev_air = max(logarithm(Q, n) - 0.5 * (logdet_health + logdet + more) - base, 0.0)
        x.ev[SWING_LOAD] -= x.ev_air
