"""Evidence of fault hypotheses over one window: Student-t likelihoods of innovations with normal priors, by Cholesky.

    theta ~ N(m, diag sd^2),    Q = E - 2 b'm + m'J m - r'(J + P^-1)^-1 r,    r = b - J m
    L = -(NU + n) / 2 ln(1 + Q / NU) - 1/2 ln det(I + P J)                              [Basseville93] section 7.2

An oscillation is LINES sines of an octave together, so that its frequency may lie between them: the steady responses of
the filter (`response`). Of the errors it meets those of timing and the gain's, BESIDE; the others stand as they were
learned, since a steady response and a propagated signature differ by more than the noise.
"""

import math

from actuators.block import kernel
from fdi.common.decision import lever_variance
from fdi.isolation.filter import (
    FAST,
    FLOW,
    FRICTION,
    GAIN,
    LEAK,
    OFFSET,
    SCALE,
    SENSORS,
    SOFT,
    SUPPLY,
    TIMING,
    N,
)  # fmt: skip
from fdi.isolation.sums import ENERGY, LINES, MEAN, NEXT, NUMBER, OCTAVES, PAIRS, PARTED, WAVES, B, gather

ADDED, IN_PLACE, SWING_ROD, SWING_SURFACE, SWING_PRESSURE, SWING_LOAD = range(6)  # oscillations
LOSS, LEAKAGE, LOW_SUPPLY, SOFT_OIL, RUBS, OPEN, FREE = range(6, 13)
NOISE_ROD, NOISE_SURFACE, NOISE_PRESSURE, PAIR, OFF_PRESSURE, SCALED_PRESSURE, DRIVEN = range(13, 20)
HYPOTHESES = 20
WORSE = ((LEAKAGE, LEAK), (LOW_SUPPLY, SUPPLY), (SOFT_OIL, SOFT), (RUBS, FRICTION))  # an error beyond its tolerance
SWINGS = (ADDED, SWING_ROD, SWING_SURFACE, SWING_PRESSURE, SWING_LOAD)  # by place of `response`
NU = 50.0
BY_ITSELF = 0.1  # least share of the gain's column that no oscillation explains: responses are those of rest
GUST = 2.0  # times what the load of this air usually swings by, that it may swing by
WHITE = 0.1  # noise is not correlated more from tick to tick
BELOW = 3.0  # Q is no less than noise leaves, by so many sigma
M = TIMING + WAVES + 1  # columns of an oscillation: of timing, its own, the gain's
FIRST_WAVE, LAST = TIMING, M - 1

PARAMS = [
    ("sine_sd", "f8", (5,)),  # amplitudes that are expected: rod of a valve's [m], rod, surface [m], pressure, load [1]
    ("loss_mean", "f8", "-"),  # of a lossy valve's gain
    ("loss_sd", "f8", "-"),
    ("gone_sd", "f8", "-"),  # of the gain where nothing comes through, -1
    ("slow_sd", "f8", "-"),  # of the slow part's gain where an oscillation is in its place
    ("worse_mean", "f8", (4,)),  # of the errors of WORSE where they are a fault
    ("worse_sd", "f8", (4,)),
    ("offset_sd", "f8", "-"),  # of a pressure sensor that is wrong
    ("scale_sd", "f8", "-"),  # of one whose scale is
    ("slow_flow_sd", "f8", "m/s"),  # flow that a slow oscillation adds
    ("open_sd", "f8", "m/s"),  # flow of a valve that stands open
    ("bypass", "f8", "m/s"),  # leakage of an actuator that lets go
    ("occam", "f8", "-"),  # what a hypothesis of noise costs
    ("memory", "f8", "s"),  # of what the flight teaches
    ("floor", "f8", (N,), "-"),  # of a learned error's standard deviation, over the tolerance's
]
PRIORS = {
    "sine_sd": (4e-4, 1e-3, 1e-3, 0.08, 0.05),
    "loss_mean": -0.45, "loss_sd": 0.18,  # 10 to 80 % within two sigma: beyond, it is as good as gone
    "gone_sd": 0.03, "slow_sd": 0.7, "offset_sd": 0.15, "scale_sd": 0.3,
    "worse_mean": (0.3, 0.5, -0.7, 0.15), "worse_sd": (0.3, 0.25, 0.25, 0.1),
    "slow_flow_sd": 0.01,  # 2 to 6 mm at 0.1 to 0.45 Hz
    "open_sd": 0.2, "bypass": 1.0,  # 9 deg/s to 45 deg/s within its sigma; that of actuators/hydraulic/actuator.py
    "occam": 6.0, "memory": 30.0,
    "floor": (0.03,) * TIMING + (0.3,) * (N - TIMING),  # an age does not change with the manoeuvre
}  # fmt: skip
STATE = [
    ("L", "f8", (PAIRS,)),  # Cholesky factor at hand, packed by rows
    ("y", "f8", (N,)),  # solution of it, of its transpose
    ("theta", "f8", (N,)),
    ("info", "f8", (N,)),  # of each column alone: information,
    ("pull", "f8", (N,)),  # and its product with the column's value
    ("prior", "f8", (2, N)),  # means and standard deviations of the hypothesis at hand
    ("gram", "f8", (WAVES, WAVES)),  # of a window's waves
    ("wave_J", "f8", (M * (M + 1) // 2,)),  # sums of an oscillation's columns with each other, packed,
    ("wave_b", "f8", (M,)),  # with the innovations
    ("wave_f", "f8", (M,)),  # and with the signature of the valve's fast part
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
def factor(J, L, sd, first, n, by_itself):
    """Write rows `first` to n - 1 of the Cholesky factor L of J + diag(1 / sd^2); return what they add to
    ln det(I + P J). No pivot is less than the share `by_itself` of what it is alone."""
    det = 1.0
    for a in range(first, n):
        i, variance = a * (a + 1) // 2, sd[a] * sd[a]
        for b in range(a + 1):
            k = b * (b + 1) // 2
            v = J[i + b]
            for c in range(b):
                v -= L[i + c] * L[k + c]
            if b < a:
                L[i + b] = v / L[k + b]
            else:
                v = max(max(v, 0.0) + 1.0 / variance, by_itself * (J[i + a] + 1.0 / variance))
                det *= v * variance
                L[i + a] = math.sqrt(v)
    return math.log(det)


@kernel
def left(J, L, b, mean, y, E, n):
    """Return Q; write y = L^-1 r."""
    Q = E
    for a in range(n):
        i, Jm = a * (a + 1) // 2, 0.0
        for c in range(n):
            Jm += J[at(a, c)] * mean[c]
        Q += mean[a] * (Jm - 2.0 * b[a])
        r = b[a] - Jm
        for k in range(a):
            r -= L[i + k] * y[k]
        y[a] = r / L[i + a]
        Q -= y[a] * y[a]
    return Q


@kernel
def back(L, y, theta, n):
    """Write theta = L'^-1 y, the columns' values beyond their means."""
    for a in range(n - 1, -1, -1):
        v = y[a]
        for k in range(a + 1, n):
            v -= L[k * (k + 1) // 2 + a] * theta[k]
        theta[a] = v / L[a * (a + 3) // 2]


@kernel
def inverse(L, i, scratch, n):
    """Return element (i, i) of (J + P^-1)^-1, the variance of column `i`, by the factor."""
    total = 0.0
    for a in range(i, n):
        v = 1.0 if a == i else 0.0
        for k in range(i, a):
            v -= L[a * (a + 1) // 2 + k] * scratch[k]
        scratch[a] = v / L[a * (a + 3) // 2]
        total += scratch[a] * scratch[a]
    return total


@kernel
def logarithm(Q, n):
    """Return the logarithm of the marginal likelihood but for its determinant."""
    return -0.5 * (NU + n) * math.log(1.0 + max(Q, n - BELOW * math.sqrt(2.0 * n)) / NU)


@kernel
def give(x, h, Q, logdet):
    """Keep what hypothesis `h` leaves and its evidence."""
    x.ev_Q[h] = Q
    x.ev[h] = logarithm(Q, x.ev_n) - 0.5 * logdet - x.ev_base


@kernel
def health(x):
    """Take what the flight has taught as the prior."""
    for i in range(N):
        x.prior[0, i], x.prior[1, i] = 0.0, x.sd[i]


@kernel
def ask(x, h, logdet, E):
    """Keep the evidence of a hypothesis whose priors differ from LEAK on; `logdet` of the columns before it."""
    J, b = x.total[:PAIRS], x.total[B:ENERGY]
    logdet += factor(J, x.L, x.prior[1], LEAK, N, 0.0)
    give(x, h, left(J, x.L, b, x.prior[0], x.y, E, N), logdet)


@kernel
def alone(x):
    """Write what the sums say of each column that is asked alone, the others at the priors of the factor and solution
    at hand (means 0): information w and its product b with the column's value, for `other`."""
    back(x.L, x.y, x.pull, N)
    for i in range(OFFSET, FLOW + 1):
        variance = inverse(x.L, i, x.theta, N)
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
def of_one_column(x, p, Q0, logdet0):
    """Give the hypotheses that differ from health by one column's prior."""
    for k in range(4):
        h, i = WORSE[k]
        mean, w0 = p.worse_mean[k] - x.mu[i], 1.0 / (p.worse_sd[k] * p.worse_sd[k])
        Q, logdet = other(x, Q0, logdet0, i, mean, p.worse_sd[k])
        if (x.pull[i] + w0 * mean) / (x.info[i] + w0) * p.worse_mean[k] < 0.0:  # no leak flows against the pressure
            Q, logdet = Q0, logdet0
        give(x, h, Q, logdet)
    Q, logdet = other(x, Q0, logdet0, OFFSET, 0.0, p.offset_sd)
    give(x, OFF_PRESSURE, Q, logdet)
    Q, logdet = other(x, Q0, logdet0, SCALE, 0.0, p.scale_sd)
    give(x, SCALED_PRESSURE, Q, logdet)
    # what an oscillation slower than the lines adds within a window
    Q, logdet = other(x, Q0, logdet0, FLOW, 0.0, p.slow_flow_sd)
    give(x, DRIVEN, Q, logdet)


@kernel
def of_the_valve(x, p, logdet, E):
    """Give those of the valve's flow; `logdet` of the columns before LEAK, whose priors are the same for all."""
    for i in range(FAST, GAIN + 1):
        x.prior[0, i], x.prior[1, i] = p.loss_mean - x.mu[i], p.loss_sd
    ask(x, LOSS, logdet, E)
    for i in range(FAST, GAIN + 1):  # a valve that stands open
        x.prior[0, i], x.prior[1, i] = -1.0 - x.mu[i], p.gone_sd
    x.prior[1, FLOW] = p.open_sd
    ask(x, OPEN, logdet, E)
    x.prior[1, FLOW] = x.sd[FLOW]  # free-floating: the valve passes nothing, the chambers are joined
    x.prior[0, LEAK], x.prior[1, LEAK] = p.bypass, 0.3 * p.bypass
    ask(x, FREE, logdet, E)


@kernel
def of_noise(x, p, Q0, logdet0):
    """Give those of a sensor with more noise."""
    for j in range(SENSORS):
        energy, m = x.total[ENERGY + j], x.total[NUMBER + j]
        ratio = max(energy / max(m, 1.0), 1.0)
        if x.total[NEXT + j] > WHITE * energy:
            ratio = 1.0
        give(x, NOISE_ROD + j, Q0 - m * (ratio - 1.0), logdet0 + m * math.log(ratio) + p.occam)


@kernel
def of_the_pair(x, p, Q0, logdet0):
    """Give that of rod and surface apart, less what a lever says that is not known better."""
    b, J, sd = 0.0, 0.0, p.sine_sd[2]
    for j in range(SENSORS):
        H = p.still[int(x.heard), 2, j] / math.sqrt(x.noise[j])
        b += H * x.total[MEAN + j]
        J += H * H * x.total[NUMBER + j]
    d = J + 1.0 / (sd * sd)
    known = max(lever_variance(x, x.h_hat[0], 0.0), 1e-300)
    d_known = J + 1.0 / known
    give(x, PAIR, Q0 - b * b / d_known, logdet0 + math.log(d_known * known))
    by_lever = max(x.ev[PAIR], 0.0)
    give(x, PAIR, Q0 - b * b / d, logdet0 + math.log(d * sd * sd))
    x.ev[PAIR] -= by_lever


@kernel
def powers(c, s, c_turn, s_turn):
    """Return sum z^n over n = 1 ... m by its real and imaginary part, where z^m = c + i s and z = c_turn + i s_turn:
    z (1 - z^m) / (1 - z)."""
    a, b = c_turn * (1.0 - c) + s_turn * s, s_turn * (1.0 - c) - c_turn * s
    down, up = 1.0 - c_turn, -s_turn
    over = 1.0 / max(down * down + up * up, 1e-300)
    return (a * down + b * up) * over, (b * down - a * up) * over


@kernel
def waves(x, p, o):
    """Write the sums of products of the waves of window `o`, over blocks, in closed form."""
    for k in range(LINES):
        c, s, c1, s1 = x.phase_c[o, k], x.phase_s[o, k], p.turn_c[o, k], p.turn_s[o, k]
        for l in range(k + 1):
            d, t, d1, t1 = x.phase_c[o, l], x.phase_s[o, l], p.turn_c[o, l], p.turn_s[o, l]
            sum_c, sum_s = powers(c * d - s * t, s * d + c * t, c1 * d1 - s1 * t1, s1 * d1 + c1 * t1)
            apart_c, apart_s = x.window_age[o], 0.0
            if l < k:
                apart_c, apart_s = powers(c * d + s * t, s * d - c * t, c1 * d1 + s1 * t1, s1 * d1 - c1 * t1)
            x.gram[2 * k, 2 * l], x.gram[2 * k, 2 * l + 1] = 0.5 * (apart_c + sum_c), 0.5 * (sum_s - apart_s)
            x.gram[2 * k + 1, 2 * l], x.gram[2 * k + 1, 2 * l + 1] = 0.5 * (sum_s + apart_s), 0.5 * (apart_c - sum_c)


@kernel
def columns(x, p, o, place):
    """Write the sums of an oscillation's columns at `place`, and of those beside it."""
    J, b, f = x.wave_J, x.wave_b, x.wave_f
    for a in range(M):
        for c in range(a + 1):
            J[at(a, c)] = 0.0
    for k in range(TIMING + 1):
        i, a = (k, k) if k < TIMING else (LAST, GAIN)
        b[i], f[i] = x.total[B + a], x.total[at(a, FAST)]
        for c in range(min(a, TIMING)):
            J[at(i, c)] = x.total[at(a, c)]
        J[at(i, i)] = x.total[at(a, a)]
    for w in range(WAVES):
        b[FIRST_WAVE + w] = f[FIRST_WAVE + w] = 0.0
    for j in range(SENSORS):
        unit = 1.0 / math.sqrt(x.noise[j])
        m = unit * unit * x.total[NUMBER + j] / x.window_age[o]  # ticks of a block, in units of the noise
        D, response = x.window_D[o, :, j], p.response[int(x.heard), place, o, :, j]
        for w in range(WAVES if m > 0.0 else 0):
            i, line = FIRST_WAVE + w, w // 2 * 2
            c, s = unit * response[w, 0], unit * response[w, 1]
            b[i] += c * D[0, line] + s * D[0, line + 1]
            f[i] += c * D[1, line] + s * D[1, line + 1]
            for k in range(TIMING):
                J[at(i, k)] += c * D[2 + k, line] + s * D[2 + k, line + 1]
            J[at(LAST, i)] += c * D[2 + TIMING, line] + s * D[2 + TIMING, line + 1]
            for v in range(w + 1):
                n, g = v // 2 * 2, x.gram
                with_c = response[v, 0] * g[line, n] + response[v, 1] * g[line, n + 1]
                with_s = response[v, 0] * g[line + 1, n] + response[v, 1] * g[line + 1, n + 1]
                J[at(i, FIRST_WAVE + v)] += m * (response[w, 0] * with_c + response[w, 1] * with_s)


@kernel
def swing(x, h, wave_sd, gain_sd, E):
    """Give oscillation `h` of the columns at hand, whose amplitudes have the deviation `wave_sd`."""
    for i in range(M):
        x.prior[0, i], x.prior[1, i] = 0.0, x.sd[i] if i < TIMING else wave_sd
    x.prior[1, LAST] = gain_sd
    logdet = factor(x.wave_J, x.L, x.prior[1], 0, LAST, 0.0)
    logdet += factor(x.wave_J, x.L, x.prior[1], LAST, M, BY_ITSELF)
    give(x, h, left(x.wave_J, x.L, x.wave_b, x.prior[0], x.y, E, M), logdet)


@kernel
def amplitudes(x, p, o, h):
    """Write the frequency of oscillation `h` as fitted; return the mean square of its amplitudes."""
    back(x.L, x.y, x.theta, M)
    total, weighed = 0.0, 0.0
    for k in range(LINES):
        c, s = x.theta[FIRST_WAVE + 2 * k], x.theta[FIRST_WAVE + 2 * k + 1]
        total += c * c + s * s
        weighed += (c * c + s * s) * p.hz[o, k]
    x.ev_hz[h] = weighed / max(total, 1e-300)
    return total / WAVES


@kernel
def of_oscillations(x, p, o, E):
    """Give those of oscillations at every place."""
    waves(x, p, o)
    for place in range(5):
        columns(x, p, o, place)
        sd, h = p.sine_sd[place] * (6.2831853 * p.hz[o, LINES // 2] if place == 0 else 1.0), SWINGS[place]
        swing(x, h, sd, x.sd[GAIN], E)
        x.ev_load2 = amplitudes(x, p, o, h)  # the load's is the last
        if place == 0:  # in place: the fast part of the command does not come through, of the slow part some or all
            m = -1.0 - x.mu[FAST]
            for i in range(M):
                x.wave_b[i] -= m * x.wave_f[i]
            swing(x, IN_PLACE, sd, p.slow_sd, E + m * (m * x.total[at(FAST, FAST)] - 2.0 * x.total[B + FAST]))
            amplitudes(x, p, o, IN_PLACE)
    of_load, x.ev_air, usual = x.ev[SWING_LOAD], 0.0, GUST * math.sqrt(x.air_load2[o])
    if usual > 0.0 and of_load > 0.0:
        Q = x.ev_Q[SWING_LOAD]
        swing(x, SWING_LOAD, usual, x.sd[GAIN], E)
        x.ev_air = max(x.ev[SWING_LOAD], 0.0)
        x.ev_Q[SWING_LOAD], x.ev[SWING_LOAD] = Q, of_load - x.ev_air


@kernel
def evaluate(x, p, o):
    """Write the evidence of every hypothesis over the window of octave `o`."""
    gather(x, o)
    J, b, n, E = x.total[:PAIRS], x.total[B:ENERGY], 0.0, 0.0
    for j in range(SENSORS):
        n += x.total[NUMBER + j]
        E += x.total[ENERGY + j]
    x.ev_octave, x.ev_n = o, n
    health(x)
    first = factor(J, x.L, x.prior[1], 0, LEAK, 0.0)
    logdet0 = first + factor(J, x.L, x.prior[1], LEAK, N, 0.0)
    Q0 = left(J, x.L, b, x.prior[0], x.y, E, N)
    x.ev_Q[HYPOTHESES], x.ev_base = Q0, logarithm(Q0, n) - 0.5 * logdet0
    alone(x)
    of_one_column(x, p, Q0, logdet0)
    of_the_valve(x, p, first, E)
    of_noise(x, p, Q0, logdet0)
    of_the_pair(x, p, Q0, logdet0)
    of_oscillations(x, p, o, E)
