"""What the current does that the demand does not ask for: hypotheses of its shape and of what the motor has felt.

f is the measured current less that of the model, c what the drive was told in fact, d = c - f what it should have been,
w the motor's rate. Samples since f began and the innovations of the velocity (`torque`) are one linear model

    f = a cos + b sin + g d + m b_motor w + o + l t + noise,    gamma = felt push(f) + misread read(f) + noise

Each hypothesis is a normal prior of its eight numbers; the evidence is the likelihood of `fdi.isolation.evidence`:

| hypothesis | f | felt | misread |
|---|---|---|---|
| added | sine | 1 | 0 |
| in place | -d + sine | 1 | 0 |
| stuck | -d + const | 1 | 0 |
| loss | -g d | 1 | 0 |
| gone | -d + b_motor w: no current | 1 | 0 |
| magnets | m w (and little g d): the voltage that the motor makes is missing | any | 0 |
| current sensor: offset or drift, sine, scale | o + l t, sine, g d + m w | 0 | 0 |
| no name: a torque of which the current does not tell | sine | 0 +- 4 | 0 +- 4 |
| velocity sensor, but for an offset | sine, m w | 1 | 1 |

The current loop settles in 0.3 ms and no load enters, so that a fault of the drive is in f whole and at once. Friction
keeps a part of what the drive does from the motor: of K_T f it feels at least

    must = sum |f| max(|f| - T / K_T, 0) / sum f^2,   T the most that a healthy drive rubs.
"""

import math

import numpy as np

from actuators.block import kernel
from fdi.common.sinusoid import beside
from fdi.common.verdict import EFFECTIVENESS, NONE, OFC_LIQUID, OFC_SOLID, RUNAWAY, SENSOR
from fdi.ema.ema_kalman import CURRENT, VELOCITY
from fdi.ema.gains import RELEASE
from fdi.isolation.evidence import at, factor, left, logarithm

RING, EVEN_S = 100, 0.02  # samples of the ring; a sample [s]
F, C, W_ROW, PAIR, ROD = range(5)  # signals of the ring
COS, SIN, D, W, ONE, T = range(6)
N = 6  # columns
ADDED, IN_PLACE, STUCK, LOSS, MAGNETS, OFFSET, SWINGS, SCALED, MISREAD, GONE, UNTOLD, HEALTH = range(12)
HYPOTHESES = 12
NAME_OF = (OFC_LIQUID, OFC_SOLID, RUNAWAY, EFFECTIVENESS, EFFECTIVENESS, SENSOR, SENSOR, SENSOR, SENSOR,
           EFFECTIVENESS, NONE, NONE)  # fmt: skip
WHO = (0.0, 0.0, 0.0, 0.0, 0.0, CURRENT, CURRENT, CURRENT, VELOCITY, 0.0, 0.0, 0.0)
LOST = (0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0)  # for `drive_lost`
PRIORS: dict[int, dict[int, tuple[float, float]]] = {  # column: mean, deviation; currents over the largest
    ADDED: {COS: (0, 0.15), SIN: (0, 0.15)},
    IN_PLACE: {COS: (0, 0.15), SIN: (0, 0.15), D: (-1, 1e-3)},
    STUCK: {ONE: (0, 0.5), D: (-1, 1e-3)},
    LOSS: {D: (-0.5, 0.3)},
    MAGNETS: {W: (0.5, 0.3), D: (0, 0.08)},  # a rate that is read late looks like a gain
    OFFSET: {ONE: (0, 0.15), T: (0, 0.15)},
    SWINGS: {COS: (0, 0.15), SIN: (0, 0.15)},
    SCALED: {D: (0, 0.3), W: (0, 0.3)},
    MISREAD: {COS: (0, 0.15), SIN: (0, 0.15), W: (0, 0.3)},
    GONE: {D: (-1, 1e-3), W: (0.47, 0.1)},
    UNTOLD: {COS: (0, 0.15), SIN: (0, 0.15)},
    HEALTH: {},
}
CURRENTS = (COS, SIN, ONE, T)
# (felt, deviation), (misread, deviation); deviation 0: as much as friction lets through
OF_DRIVE, OF_CURRENT, OF_VELOCITY = ((1.0, 0.0), (0.0, 0.1)), ((0.0, 0.1), (0.0, 0.1)), ((1.0, 0.2), (1.0, 0.2))
OF_LOOP = ((0.2, 0.25), (0.0, 0.1))  # an offset may be in the drive's own loop: the load estimate takes what is felt
OTHER = ((0.0, 4.0), (0.0, 4.0))  # a torque of which the current does not tell
ANY = ((0.5, 1.0), (0.0, 1.0))
SHARES = (OF_DRIVE, OF_DRIVE, OF_DRIVE, OF_DRIVE, ANY, OF_LOOP, OF_CURRENT, OF_CURRENT, OF_VELOCITY, OF_DRIVE,
          OTHER, ANY)  # fmt: skip
# deviation with which the two shares are known at best; what friction adds, over the share that it may keep
FELT_LEAST, FRICTION = 0.1, 0.1
FELT_SD = 0.05  # of what the motor has felt of a fault of the drive
ABSENT = 1e-6  # deviation of a column that a hypothesis has not
LEAST, EVERY = 8, 2  # samples before a name, and from one evaluation to the next
SCALE_MOST = 0.8  # by which a sensor's scale may be off
LOSS_SAMPLES = 30  # before a loss
PERIODS = 1.0  # of a sine that a window must hold
SURE, LEAD = 3.5, 0.008  # odds e^3.5 over every other name, and this share of the evidence
PLAIN = 0.2  # share of what health leaves that a hypothesis may leave beyond noise
OFF = 0.002  # share of the demand that the model may err by
VOTES = 3.0  # evaluations in a row that must agree
STUCK_LEAST = 0.3  # of the largest current: less is a loss of the drive
HEALTHY = 0.03  # of the stall torque: one and a half times the friction of a healthy drive (actuators.ema.actuator)
LOW_HZ, HIGH_HZ, RATIO = 0.09, 11.0, 1.18  # frequencies of an oscillation [Hz]

PARAMS = [
    ("even", "f8", "-"),  # ticks of a sample
    ("sigma_f", "f8", "A"),  # noise of a sample of f: the sensor's 0.1 A over four ticks, and the demand's own
    ("b_motor", "f8", "A s/rad"),  # current per rate that weaker magnets would cause, all lost
    ("shape_mean", "f8", (HYPOTHESES, N)),
    ("shape_sd", "f8", (HYPOTHESES, N)),  # 0: as the flight has taught
    ("felt_mean", "f8", (HYPOTHESES, 2)),  # shares felt and misread
    ("felt_sd", "f8", (HYPOTHESES, 2)),
]
STATE = [
    ("even_sum", "f8", (5,)),
    ("even_ticks", "f8", "-"),
    ("even_head", "f8", "-"),
    ("even_ring", "f8", (5, RING)),
    ("f_age", "f8", "-"),  # samples since f began, 0 while there is nothing
    ("JJ", "f8", (N * (N + 1) // 2,)),  # sums over the window, in units of the noise
    ("bb", "f8", (N,)),
    ("shape_n", "f8", "-"),  # samples, and their energy
    ("shape_energy", "f8"),
    ("LL", "f8", (N * (N + 1) // 2,)),  # Cholesky factor at hand, packed by rows
    ("yy", "f8", (N,)),
    ("prior", "f8", (2, N)),
    ("row", "f8", (N,)),  # columns of a sample
    ("must", "f8", "-"),  # share of f that the motor must feel, were f real
    ("shape_L", "f8", (HYPOTHESES,)),  # evidence
    ("shape_left", "f8", (HYPOTHESES,)),  # Q
    ("sine_hz", "f8", (2,), "Hz"),  # of the best sine of f, of c
    ("drive_vote", "f8", (2,), "-"),  # hypothesis that leads now, and evaluations in a row that it has
    ("drive_name", "f8", "-"),  # class of the hypothesis that leads, or NONE
    ("drive_who", "f8", "-"),  # and its sensor
    ("drive_lost", "f8", "-"),  # of the demand: 1 a part does not arrive, 2 nothing arrives
]


def priors(largest: float) -> dict[str, np.ndarray]:
    """Return the PARAMS fields for a drive of the `largest` current [A]."""
    made = np.zeros((2, HYPOTHESES, N))
    for h, columns in PRIORS.items():
        for c, both in columns.items():
            made[:, h, c] = np.array(both) * (largest if c in CURRENTS else 1.0)
    shares = np.array(SHARES)
    return {"shape_mean": made[0], "shape_sd": made[1], "felt_mean": shares[:, :, 0], "felt_sd": shares[:, :, 1]}


@kernel
def best_sine(F, first, n, hz):
    """Return (least energy that a sine of `hz` or more leaves of the last `n` samples of ring `F`, its frequency
    [Hz])."""
    least, best, step = 1e300, 0.0, RATIO
    while hz <= HIGH_HZ:
        e = beside(F, F, first, n, 6.283185307179586 * hz * EVEN_S)[0]
        if e < least:
            least, best = e, hz
        hz *= RATIO
    for _ in range(7):  # halve the step about the best
        step = math.sqrt(step)
        for hz in (best * step, best / step):
            e = beside(F, F, first, n, 6.283185307179586 * hz * EVEN_S)[0]
            if e < least:
                least, best = e, hz
    return least, best


@kernel
def gather(x, p, first, n, hz):
    """Write the sums of the columns over the last `n` samples, a sine of `hz` among them, in units of the noise and of
    what the model may err by; return the mean of c [A]."""
    x.JJ[:] = 0.0
    x.bb[:] = 0.0
    z, i, energy, beyond = x.row, first, 0.0, 0.0
    for k in range(n):
        f, phase = x.even_ring[F, i], 6.283185307179586 * hz * EVEN_S * (k - 0.5 * (n - 1))
        z[COS], z[SIN], z[D], z[W] = math.cos(phase), math.sin(phase), x.even_ring[C, i] - f, x.even_ring[W_ROW, i]
        z[W], z[ONE], z[T] = p.b_motor * z[W], 1.0, (2.0 * k + 1.0) / n - 1.0
        j = 0
        for a in range(N):
            x.bb[a] += z[a] * f
            for b in range(a + 1):
                x.JJ[j] += z[a] * z[b]
                j += 1
        energy += f * f
        beyond += math.fabs(f) * max(math.fabs(f) - HEALTHY * p.I_max, 0.0)
        i = 0 if i == RING - 1 else i + 1
    x.must = beyond / max(energy, 1e-9)
    mean = (x.bb[ONE] + x.JJ[at(ONE, D)]) / n
    over = 1.0 / (p.sigma_f * p.sigma_f + OFF * OFF * x.JJ[at(D, D)] / n)
    for a in range(N):
        x.bb[a] *= over
    for j in range(x.JJ.size):
        x.JJ[j] *= over
    x.shape_energy, x.shape_n = energy * over, n
    return mean


@kernel
def heard(x, felt, felt_sd, misread, misread_sd):
    """Return the log likelihood of what the motor has felt, and misread, with normal priors."""
    J, b = x.felt_J, x.felt_b
    det = J[0] * J[2] - J[1] * J[1]
    if det <= 1e-6 * J[0] * J[2]:
        return 0.0
    known = (FELT_LEAST + FRICTION * (1.0 - x.must)) * (FELT_LEAST + FRICTION * (1.0 - x.must))
    s, r, t = J[2] / det + known + felt_sd * felt_sd, -J[1] / det, J[0] / det + known + misread_sd * misread_sd
    d, e = (J[2] * b[0] - J[1] * b[1]) / det - felt, (J[0] * b[1] - J[1] * b[0]) / det - misread
    det = s * t - r * r
    return -0.5 * ((t * d * d - 2.0 * r * d * e + s * e * e) / det + math.log(det))


@kernel
def ask(x, p, h, own, magnets):
    """Write the evidence of hypothesis `h`, see `weigh`."""
    for c in range(N):
        x.prior[0, c], x.prior[1, c] = p.shape_mean[h, c], max(p.shape_sd[h, c], ABSENT)
    if p.shape_sd[h, D] == 0.0:
        x.prior[1, D] = own
    if p.shape_sd[h, W] == 0.0:
        x.prior[1, W] = magnets
    logdet = factor(x.JJ, x.LL, x.prior[1], 0, N, 1e-9)
    x.shape_left[h] = left(x.JJ, x.LL, x.bb, x.prior[0], x.yy, x.shape_energy, N)
    x.shape_L[h] = logarithm(x.shape_n, x.shape_left[h], 0.0) - 0.5 * logdet
    share, sd = p.felt_mean[h], p.felt_sd[h]
    if sd[0] == 0.0:
        rubs = 1.0 - x.must
        x.shape_L[h] += heard(x, 1.0 - 0.5 * rubs, 0.3 * rubs + FELT_SD, 0.0, rubs + FELT_LEAST)
    else:
        x.shape_L[h] += heard(x, share[0], sd[0], share[1], sd[1])


@kernel
def leader(x):
    """Return the hypothesis that leads every other name, HEALTH where none does."""
    best, other = HEALTH, -1e300
    for h in range(HYPOTHESES):
        if x.shape_L[h] > x.shape_L[best]:
            best = h
    for h in range(HYPOTHESES):
        if NAME_OF[h] != NAME_OF[best] or WHO[h] != WHO[best]:
            other = max(other, x.shape_L[h])
    n, evidence = x.shape_n, x.shape_L[best] - x.shape_L[HEALTH]
    fits = x.shape_left[best] - n < PLAIN * (x.shape_left[HEALTH] - n)
    return best if fits and x.shape_L[best] - other > max(SURE, LEAD * evidence) else HEALTH


@kernel
def weigh(x, p, own, magnets):
    """Weigh the hypotheses over the samples since f began; name what leads. `own` and `magnets` are deviations of gain
    and magnets of a healthy drive."""
    n = min(int(x.f_age), RING)
    if n < LEAST:
        return
    first = int(x.even_head) - n
    first = first + RING if first < 0 else first
    mean = 0.0
    for row in range(2):
        _, x.sine_hz[row] = best_sine(x.even_ring[row], first, n, LOW_HZ)
        mean = gather(x, p, first, n, x.sine_hz[row])
        for h in range(HYPOTHESES):
            if (h == IN_PLACE) == (row == C):
                ask(x, p, h, own, magnets)
    if not 0.0 < -x.bb[D] < 1.1 * x.JJ[at(D, D)]:  # from all to nothing arrives
        x.shape_L[LOSS] = -1e300
    if x.shape_energy > x.JJ[at(W, W)]:  # more than magnets have
        x.shape_L[MAGNETS] = -1e300
    if math.fabs(x.bb[D]) > SCALE_MOST * x.JJ[at(D, D)]:
        x.shape_L[SCALED] = -1e300
    h = leader(x)
    if (h == ADDED and x.sine_hz[F] * n * EVEN_S < PERIODS) or (h == IN_PLACE and x.sine_hz[C] * n * EVEN_S < PERIODS):
        h = HEALTH
    elif (h == LOSS or h == GONE) and (n < LOSS_SAMPLES or (h == GONE and x.shape_left[GONE] > 2.0 * n)):
        h = HEALTH
    elif h == STUCK and math.fabs(mean) < STUCK_LEAST * p.I_max:
        h = LOSS if n == RING else HEALTH
    x.drive_vote[1] = x.drive_vote[1] + 1.0 if x.drive_vote[0] == h else 1.0
    x.drive_vote[0] = h
    if h != HEALTH and x.drive_vote[1] >= VOTES:
        x.drive_name, x.drive_who, x.drive_lost = NAME_OF[h], WHO[h], LOST[h]
        if h == MAGNETS:  # stays until motion tells otherwise: at rest magnets are neither weak nor healed
            x.hot_gain = x.weak = 1.0
            x.gain_timer = RELEASE
            x.gain_sum[:] = 0.0
