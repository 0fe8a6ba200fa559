"""Evidence of fault hypotheses over one window: Student-t likelihoods of innovations with normal priors, by Cholesky.

    theta ~ N(m, diag sd^2),    Q = E - 2 b'm + m'J m - r'(J + P^-1)^-1 r,    r = b - J m
    L = -(NU + n) / 2 ln(1 + Q / NU) - 1/2 ln det(I + P J)                              [Basseville93] section 7.2

A hypothesis is a row of priors. Of the errors of `filter` (all N columns) a fault has other priors for some and those
that the flight has taught for the rest. An oscillation is LINES sines of an octave together, so that its frequency may
lie between them: the steady responses of the filter (`response`). It meets the columns BESIDE alone; the others stand
as they were learned, since a steady response and a propagated signature differ by more than the noise. A sensor with
more noise is health with another variance.
"""

import math

import numpy as np

from actuators.block import kernel
from fdi.common.decision import lever_variance
from fdi.isolation.filter import (
    APART,
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
from fdi.isolation.sums import BESIDE, ENERGY, LINES, NEXT, NUMBER, OCTAVES, PAIRS, WAVES, B, gather

ADDED, IN_PLACE, SWING_ROD, SWING_SURFACE, SWING_PRESSURE, SWING_LOAD = range(6)  # oscillations
LOSS, LEAKAGE, LOW_SUPPLY, SOFT_OIL, RUBS, OPEN, FREE, PAIR, OFF_PRESSURE, SCALED_PRESSURE, DRIVEN = range(6, 17)
NOISE_ROD, NOISE_SURFACE, NOISE_PRESSURE = range(17, 20)
SWINGS, HYPOTHESES = 6, 20
ERRORS = NOISE_ROD - SWINGS
PLACES = ("valve", "rod", "surface", "pressure", "load")  # where an oscillation enters
PLACE = (0, 0, 1, 2, 3, 4)  # of the oscillations, in PLACES
# position sensors that are heard: both, rod alone, surface alone; the pressure always is
HEARD = ((0, 1, 2), (0, 2), (1, 2))
# mean squared flows: the larger, the more the filter is in doubt of its prediction and hears its sensors [m^2/s^2]
FLOWS2 = (0.0, 4e-4, 1.6e-3, 6.4e-3, 2.56e-2)
NU = 50.0
BY_ITSELF = 0.1  # least share of the gain's column that no oscillation explains: responses are those of rest
WHITE = 0.1  # noise is not correlated more from tick to tick
ASKED, REFUSED = 0.7, -1e12  # share of a window that its parts must have been asked for; samples of one without it
BELOW = 3.0  # Q is no less than noise leaves, by so many sigma
FIRST_WAVE, M = len(BESIDE) - 1, len(BESIDE) + WAVES  # columns of an oscillation: BESIDE but the gain's, its own,
OF_FAST, OF_GAIN = FIRST_WAVE - 1, M - 1  # and the gain's
# (mean, deviation) of the columns that a fault has others of than health
BYPASS = 1.0  # leakage of an actuator that lets go, as in actuators/hydraulic [m/s]
GONE = (-1.0, 0.03)  # of the valve's gain, where nothing comes through
SLOW_SD = (0.3, 0.7)  # of the gain beside an oscillation that is added, whose size changes it, and in its place
FAULTS = {
    LOSS: {FAST: (-0.45, 0.18), GAIN: (-0.45, 0.18)},  # 10 to 80 % within two sigma: beyond, it is as good as gone
    LEAKAGE: {LEAK: (0.3, 0.3)},
    LOW_SUPPLY: {SUPPLY: (0.5, 0.25)},
    SOFT_OIL: {SOFT: (-0.7, 0.25)},
    RUBS: {FRICTION: (0.15, 0.1)},
    OPEN: {FAST: GONE, GAIN: GONE, FLOW: (0.0, 0.2)},  # 9 deg/s to 45 deg/s within its sigma
    FREE: {FAST: GONE, GAIN: GONE, LEAK: (BYPASS, 0.3)},  # its chambers are joined
    PAIR: {APART: (0.0, 1e-3)},
    OFF_PRESSURE: {OFFSET: (0.0, 0.15)},
    SCALED_PRESSURE: {SCALE: (0.0, 0.3)},
    DRIVEN: {FLOW: (0.0, 0.01)},  # a slow oscillation, 2 to 6 mm at 0.1 to 0.45 Hz, adds flow within a window
}

PARAMS = [
    ("fault_mean", "f8", (ERRORS, N)),
    ("fault_sd", "f8", (ERRORS, N)),  # 0: as in health
    ("sine_sd", "f8", (SWINGS,)),  # amplitudes expected: rod of a valve's, rod, surface [m], pressure, load [1]
    ("occam", "f8", "-"),  # what a hypothesis of noise costs
    ("memory", "f8", "s"),  # of what the flight teaches
    ("floor", "f8", (N,), "-"),  # of a learned error's standard deviation, over the tolerance's
]
STATE = [
    ("L", "f8", (PAIRS,)),  # Cholesky factor at hand, packed by rows
    ("y", "f8", (N,)),  # solution of it, of its transpose
    ("theta", "f8", (N,)),
    ("prior", "f8", (2, N)),  # means and standard deviations of the hypothesis at hand
    ("wave_J", "f8", (M * (M + 1) // 2,)),  # sums of an oscillation's columns with each other, packed,
    ("wave_b", "f8", (M,)),  # with the innovations
    ("ev_octave", "f8"),  # last evaluated octave, -1 for none at this tick
    ("ev_n", "f8"),
    ("ev_E", "f8"),  # squared innovations
    ("ev_Q", "f8", (HYPOTHESES + 1,)),  # what each leaves; the last: health
    ("ev", "f8", (HYPOTHESES,)),  # evidence against health
    ("ev_base", "f8"),  # logarithm of the likelihood of health
    ("ev_hz", "f8", (SWINGS,), "Hz"),
    # (Q, ln det, samples, frequency [Hz]) of an oscillation in a window, or in its parts together
    ("told", "f8", (OCTAVES, SWINGS, 4)),
    ("parts", "f8", (OCTAVES, SWINGS, 3)),  # sums of these over the windows half as long that are over in this one
]


def design() -> dict:
    """Return the PARAMS fields."""
    prior = np.zeros((2, ERRORS, N))
    for h, columns in FAULTS.items():
        for i, own in columns.items():
            prior[:, h - SWINGS, i] = own
    return {"fault_mean": prior[0], "fault_sd": prior[1], "sine_sd": (4e-4, 4e-4, 1e-3, 1e-3, 0.08, 0.05), "occam": 6.0,
            "memory": 30.0,
            # an age does not change with the manoeuvre
            "floor": (0.03,) * TIMING + (0.3,) * (N - TIMING)}  # fmt: skip


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
def logarithm(n, Q, logdet):
    """Return the logarithm of the marginal likelihood of `n` samples."""
    return -0.5 * ((NU + n) * math.log(1.0 + max(Q, n - BELOW * math.sqrt(2.0 * n)) / NU) + logdet)


@kernel
def give(x, h, Q, logdet):
    """Keep what hypothesis `h` leaves and its evidence."""
    x.ev_Q[h], x.ev[h] = Q, logarithm(x.ev_n, Q, logdet) - x.ev_base


@kernel
def of_errors(x, p, E, Q0, logdet0):
    """Give the faults that are errors beyond what the flight has taught."""
    J, b = x.total[:PAIRS], x.total[B:ENERGY]
    for h in range(ERRORS):
        for i in range(N):
            own = p.fault_sd[h, i] > 0.0
            x.prior[0, i] = p.fault_mean[h, i] - x.mu[i] if own else 0.0
            x.prior[1, i] = p.fault_sd[h, i] if own else x.sd[i]
        logdet = factor(J, x.L, x.prior[1], 0, N, 0.0)
        Q = left(J, x.L, b, x.prior[0], x.y, E, N)
        back(x.L, x.y, x.theta, N)
        for i in range(N):
            if (x.prior[0, i] + x.theta[i]) * p.fault_mean[h, i] < 0.0:  # no leak flows against the pressure
                Q, logdet = Q0, logdet0
        give(x, SWINGS + h, Q, logdet)


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
def columns(x, p, o, place):
    """Write the sums of an oscillation's columns at `place`, and of those beside it."""
    J, b, level = x.wave_J, x.wave_b, math.log(max(x.flow2, FLOWS2[1] / 4.0) / FLOWS2[1]) / math.log(4.0) + 1.5
    table = p.response[int(x.heard), int(min(level, len(FLOWS2) - 1.0)), place, o]
    for k in range(len(BESIDE)):
        i, a = k if k < FIRST_WAVE else OF_GAIN, BESIDE[k]
        b[i] = x.total[B + a]
        for c in range(k + 1):
            J[at(i, c if c < FIRST_WAVE else OF_GAIN)] = x.total[at(a, BESIDE[c])]
    for i in range(FIRST_WAVE, OF_GAIN):
        b[i] = J[at(OF_GAIN, i)] = 0.0
        for c in range(i + 1):
            J[at(i, c)] = 0.0
    for j in range(SENSORS):
        unit = 1.0 / math.sqrt(x.noise[j])
        m = unit * unit * x.total[NUMBER + j] / x.window_age[o]  # ticks of a block, in units of the noise
        D, G, response = x.window_D[o, :, j], x.window_G[o], table[:, j]
        for w in range(WAVES if m > 0.0 else 0):
            i, line = FIRST_WAVE + w, w // 2 * 2
            c, s = response[w, 0], response[w, 1]
            b[i] += unit * (c * D[0, line] + s * D[0, line + 1])
            for k in range(len(BESIDE)):
                J[at(k if k < FIRST_WAVE else OF_GAIN, i)] += unit * (c * D[1 + k, line] + s * D[1 + k, line + 1])
            for v in range(w + 1):
                n, c_v, s_v = v // 2 * 2, response[v, 0], response[v, 1]
                with_c = c_v * G[line, n] + s_v * G[line, n + 1]
                with_s = c_v * G[line + 1, n] + s_v * G[line + 1, n + 1]
                J[at(i, FIRST_WAVE + v)] += m * (c * with_c + s * with_s)


@kernel
def swing(x, o, h, Q, logdet, hz):
    """Give oscillation `h` of octave `o`. One that is too fast for the lines swings in the parts of the window, a sine
    in each that shows it: what they leave, of one unknown scale of noise, and their determinants are added up."""
    give(x, h, Q, logdet)
    n, told, parts = x.ev_n, x.told[o, h], x.parts[o, h]
    told[0], told[1], told[2], told[3] = Q, logdet, n if x.ev[h] > 0.0 else REFUSED, hz
    if o > 0 and (h <= IN_PLACE or h == SWING_PRESSURE):
        part = x.told[o - 1, h]
        m = parts[2] + part[2]
        if m > ASKED * n and logarithm(n, (parts[0] + part[0]) * n / m, parts[1] + part[1]) - x.ev_base > x.ev[h]:
            told[0], told[1], told[2], told[3] = parts[0] + part[0], parts[1] + part[1], m, part[3]
            give(x, h, told[0] * n / m, told[1])
    x.ev_hz[h] = told[3]


@kernel
def of_oscillations(x, p, o, E):
    """Give the oscillations; in the valve's place the fast part of the command does not come through, of the slow part
    some or all."""
    for h in range(SWINGS):
        if h != IN_PLACE:
            columns(x, p, o, PLACE[h])
        per_rate = 6.2831853 * p.hz[o, LINES // 2] if h <= IN_PLACE else 1.0  # of a flow
        for i in range(M):
            x.prior[0, i], x.prior[1, i] = 0.0, x.sd[BESIDE[i]] if i < FIRST_WAVE else p.sine_sd[h] * per_rate
        x.prior[1, OF_GAIN] = SLOW_SD[h] if h <= IN_PLACE else x.sd[GAIN]
        if h == IN_PLACE:
            x.prior[0, OF_FAST], x.prior[1, OF_FAST] = -1.0 - x.mu[FAST], GONE[1]
        logdet = factor(x.wave_J, x.L, x.prior[1], 0, OF_GAIN, 0.0)
        logdet += factor(x.wave_J, x.L, x.prior[1], OF_GAIN, M, BY_ITSELF)
        Q = left(x.wave_J, x.L, x.wave_b, x.prior[0], x.y, E, M)
        back(x.L, x.y, x.theta, M)
        total, weighed = 1e-300, 0.0
        for w in range(WAVES):
            amplitude = x.theta[FIRST_WAVE + w]
            total += amplitude * amplitude
            weighed += amplitude * amplitude * p.hz[o, w // 2]
        swing(x, o, h, Q, logdet, weighed / total)


@kernel
def evaluate(x, p, o):
    """Write the evidence of every hypothesis over the window of octave `o`, and over its parts."""
    gather(x, o)
    x.ev_octave, x.ev_n, x.ev_E = o, 0.0, 0.0
    for j in range(SENSORS):
        x.ev_n += x.total[NUMBER + j]
        x.ev_E += x.total[ENERGY + j]
    x.sd[APART] = math.sqrt(lever_variance(x, x.h_hat[0], 0.0))
    for i in range(N):
        x.prior[0, i], x.prior[1, i] = 0.0, x.sd[i]
    J = x.total[:PAIRS]
    logdet0 = factor(J, x.L, x.prior[1], 0, N, 0.0)
    Q0 = left(J, x.L, x.total[B:ENERGY], x.prior[0], x.y, x.ev_E, N)
    x.ev_Q[HYPOTHESES], x.ev_base = Q0, logarithm(x.ev_n, Q0, logdet0)
    of_errors(x, p, x.ev_E, Q0, logdet0)
    of_noise(x, p, Q0, logdet0)
    of_oscillations(x, p, o, x.ev_E)
