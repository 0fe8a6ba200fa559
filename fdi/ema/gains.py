"""What one drive is off its nominal values, learned in flight, and how it changes.

    i = d - b_motor w,   d = K_gi u / R_loop
    f = y - i = a d + h_1 (i_before - i) + h_2 (i_after - i) + h_3 b_motor turn + m b_motor w + noise

a is the error of the gain, m the share of the magnets that is missing; h_1, h_2 and h_3 are the ages of the readings of
current (older, younger) and rate beyond the expected ones, in ticks, by i of the tick before and after and by what the
rate turns in a tick. All have normal priors (`fdi.isolation.evidence`).

The measured rate stands in f, too, and the demand of the next tick answers its noise: least squares would take that
for magnets (in still air 6 % of the voltage, up to 20 %). So in its place stands the rate that the filter predicted
before this tick's reading [Söderström and Stoica, Instrumental Variable Methods for System Identification, 1983]. A
pole of the amplifier beside its zero looks like an age. By the rate's the filter's innovation is corrected, too.

What a drive has in its first LEARN seconds at work is taken for its own; what changes later is a fault.
"""

import math

from actuators.block import kernel
from fdi.common.decision import confirm
from fdi.isolation.evidence import at, back, factor, inverse, left

GAIN, OLDER, YOUNGER, RATE, MAGNETS = range(5)  # columns
N = 5
# deviations before they are learned: of the gain, two numbers of 10 % over two of 10 %; of the ages a tick; of the
# current that the rate takes away, K_B over K_ic with 10 % of each and .05 to .1 that the amplifier's lag makes of it
PRIOR = (0.25, 1.0, 1.0, 1.0, 0.15)
CHANGE = (1.0, 0.01, 0.01, 0.01, 0.05)  # of changes: an age stays, magnets of the healthy lose 5 %
JITTER = 0.06  # of an age, of 0.5 ms [ticks]
LEARN = 10.0  # of work: a drive at rest tells nothing of itself [s]
TAU_MOST, TAU_NOW = 60.0, 0.3  # longest and shortest memory of changes [s]
KNOWN_A, KNOWN_B = 0.0025, 0.03  # deviations of gain and magnets: what is told so well of both is forgotten
STANDS = 0.7  # of a gain's threshold: keeps the alarm
RELEASE = 0.5  # [s]: what shows it has a memory of its own

PARAMS = [
    # sizes from which a gain is a fault; how often a healthy one alarms is z_gain's
    ("th_a", "f8", "-"),  # gain error of the current: a winding 39 % up, 100 K warm, takes .0095, one 80 % up .0195
    ("th_b", "f8", "-"),  # share of the magnets: beyond two tolerances of 5 %
    ("z_gain", "f8", "-"),  # by so many deviations beyond it, by `python -m cosim.training ema`
]
STATE = [
    ("column", "f8", (N,), "A"),  # of this tick
    ("own", "f8", (N,), "-"),  # errors of this drive, as learned
    ("own_sd", "f8", (N,), "-"),  # their deviations
    ("gain_J", "f8", (N * (N + 1) // 2,)),  # sums of products of the columns, in units of the noise, packed
    ("gain_b", "f8", (N,)),  # with what f has beyond `own`
    ("gain_E", "f8"),  # energy of that, and samples
    ("gain_n", "f8", "-"),
    ("gain_age", "f8", "s"),  # for which the drive has worked and nothing was wrong
    ("change", "f8", (N,), "-"),  # what they have changed by
    ("change_sd", "f8", (N,), "-"),
    ("r_gain", "f8", "-"),  # the larger of gain and magnets over its threshold
    ("gain_timer", "f8", "s"),
    ("hot_gain", "f8", "-"),  # 1 while a gain is off
]


@kernel
def doubt(x):
    """Return by how much gain and magnets of this drive may differ from what they are taken for."""
    return 2.0 * x.own_sd[GAIN] + 1e-3, 2.0 * x.own_sd[MAGNETS] + 5e-3


@kernel
def accumulate(x, f, predicted, p, dt):
    """Take the products of a tick: error `f` [A] and the columns, the rate as it was `predicted` [rad/s]; forget by
    what they tell, so that a drive at work is judged at once, one at rest at all."""
    z, over = x.column, 1.0 / (p.sigma_f * p.sigma_f * p.even)
    of_d, of_w = KNOWN_A * z[GAIN], KNOWN_B * p.b_motor * predicted
    told = min(of_d * of_d, of_w * of_w) * over
    x.gain_age += dt
    keep = 1.0 if x.gain_age < LEARN else 1.0 - min(max(told, dt / TAU_MOST), dt / TAU_NOW)
    z[MAGNETS] = p.b_motor * predicted
    x.gain_n = keep * x.gain_n + 1.0 / p.even
    x.gain_E = keep * x.gain_E + over * f * f
    for i in range(N):
        x.gain_b[i] = keep * x.gain_b[i] + over * z[i] * f
        for j in range(i + 1):
            x.gain_J[at(i, j)] = keep * x.gain_J[at(i, j)] + over * z[i] * z[j]


@kernel
def solve(x):
    """Write `change` and its deviations, those of all that is learned while it is."""
    for i in range(N):
        x.prior[0, i] = -x.own[i] if x.gain_age < LEARN else 0.0
        x.prior[1, i] = PRIOR[i] if x.gain_age < LEARN else x.own_sd[i] + CHANGE[i]
    factor(x.gain_J, x.LL, x.prior[1], 0, N, 1e-9)
    unexplained = left(x.gain_J, x.LL, x.gain_b, x.prior[0], x.yy, x.gain_E, N)
    scale = max(unexplained / max(x.gain_n, 1.0), 1.0)  # is noise
    back(x.LL, x.yy, x.change, N)
    for i in range(N):
        x.change[i] += x.prior[0, i]
        x.change_sd[i] = min(math.sqrt(scale * inverse(x.LL, i, x.row, N)), x.prior[1, i])


@kernel
def learn(x):
    """Take what has changed for the drive's own."""
    for i in range(N):
        x.own[i] += x.change[i]
        x.own_sd[i] = x.change_sd[i]
        x.gain_E -= x.change[i] * x.gain_b[i]  # before the loop b, after it b - J change
        for j in range(N):
            x.gain_b[i] -= x.gain_J[at(i, j)] * x.change[j]
        x.gain_E -= x.change[i] * x.gain_b[i]


@kernel
def forget(x):
    """Forget what has changed: of a rate that is wrong nothing is learned."""
    x.gain_E = x.gain_n = x.gain_timer = x.hot_gain = 0.0
    x.gain_J[:] = 0.0
    x.gain_b[:] = 0.0


@kernel
def beyond(x, i, p):
    """Return by how much column `i` has changed beyond what may be chance."""
    sd = math.sqrt(x.change_sd[i] * x.change_sd[i] + x.own_sd[i] * x.own_sd[i])
    return math.fabs(x.change[i]) - p.z_gain * sd


@kernel
def test(x, p, dt):
    """Learn, then test the gains of current and magnets."""
    solve(x)
    if x.gain_age < LEARN:
        learn(x)
        return
    x.r_gain = max(beyond(x, GAIN, p) / p.th_a, beyond(x, MAGNETS, p) / p.th_b)
    shows = x.r_gain >= (STANDS if x.hot_gain > 0.5 else 1.0)
    x.gain_timer, x.hot_gain = confirm(x.gain_timer, x.hot_gain, shows, p.even * dt, 0.2, RELEASE)
