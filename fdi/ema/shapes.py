"""What the current does that the demand does not ask for: hypotheses of its shape and of what the motor has felt.

f is the measured current less that of the model, c what the drive was told in fact, d = c - f what it should have been,
w the motor's rate. Samples since f began and the innovations of the velocity (`torque`) are one linear model

    f = a cos + b sin + g d + m b_motor w + o + l t + noise,    gamma = felt push(f) + misread read(f) + noise

Each hypothesis is a normal prior of its eight numbers (`PRIORS`); the evidence is the likelihood of
`fdi.isolation.evidence`, of both:

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
| velocity sensor, but for an offset: sine or scale, noise | sine, m w | 1 | 1 |

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
from fdi.isolation.evidence import at, factor, left, logarithm

RING, EVEN_S = 100, 0.02  # samples of the ring; a sample [s]
F, C, W_ROW = range(3)  # signals of the ring
FELT, READ, COS, SIN, D, W, ONE, T = range(8)
N = 8  # columns
ADDED, IN_PLACE, STUCK, LOSS, MAGNETS, OFFSET, SWINGS, SCALED, MISREAD, NOISY, GONE, UNTOLD, HEALTH = range(13)
HYPOTHESES = 13
NAME_OF = (OFC_LIQUID, OFC_SOLID, RUNAWAY, EFFECTIVENESS, EFFECTIVENESS, SENSOR, SENSOR, SENSOR, SENSOR,
           SENSOR, EFFECTIVENESS, NONE, NONE)  # fmt: skip
WHO = (0.0, 0.0, 0.0, 0.0, 0.0, CURRENT, CURRENT, CURRENT, VELOCITY, VELOCITY, 0.0, 0.0, 0.0)
LOST = (0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0)  # for `drive_lost`
LOSES = (0, 0, 0, D, W, 0, 0, D, 0, 0, 0, 0, 0)  # column of what is lost
DRIVE = {FELT: (1, 0), READ: (0, 0)}  # deviation 0: as much as friction lets through
UNFELT = {FELT: (0, 0.18), READ: (0, 0.18)}
ANY = {FELT: (0.5, 1.0), READ: (0, 1.0)}
SINE = {COS: (0, 0.15), SIN: (0, 0.15)}
GIVEN_UP = {D: (-1, 1e-3)}
PRIORS: dict[int, dict[int, tuple[float, float]]] = {  # column: mean, deviation; currents over the largest
    ADDED: {**SINE, **DRIVE},
    IN_PLACE: {**SINE, **GIVEN_UP, **DRIVE},
    STUCK: {ONE: (0, 0.5), **GIVEN_UP, **DRIVE},
    LOSS: {D: (-0.5, 0.3), **DRIVE},
    MAGNETS: {W: (0.5, 0.3), D: (0, 0.08), **ANY},  # a rate that is read late looks like a gain
    # an offset may be in the drive's own loop: the load estimate takes what is felt
    OFFSET: {ONE: (0, 0.15), T: (0, 0.15), FELT: (0.2, 0.3), READ: (0, 0.18)},
    SWINGS: {**SINE, **UNFELT},
    SCALED: {D: (0, 0.3), W: (0, 0.3), **UNFELT},
    MISREAD: {**SINE, W: (0, 0.3), FELT: (1, 0.25), READ: (1, 0.25)},
    NOISY: {W: (0.6, 0.5), FELT: (1, 0.25), READ: (1, 0.25)},
    GONE: {**GIVEN_UP, W: (0.47, 0.1), **DRIVE},
    UNTOLD: {**SINE, FELT: (0, 4), READ: (0, 4)},  # a torque of which the current does not tell
    HEALTH: ANY,
}
CURRENTS = (COS, SIN, ONE, T)
RUBS = 0.3  # deviation of what the motor feels of a fault of the drive, over the share that friction may keep
FELT_LEAST = 0.1  # of the two shares at best
ABSENT = 1e-6  # deviation of a column that a hypothesis has not
LEAST, EVERY = 8, 2  # samples before a name, and from one evaluation to the next
SAMPLES = (LEAST, LEAST, LEAST, 30, *(LEAST,) * 6, 30, LEAST, LEAST)  # before a name: a loss is told late
SURE = 3.5  # odds e^3.5 over every other name
VOTES = 3.0  # evaluations in a row that must agree
HEALTHY = 0.03  # of the stall torque: one and a half times the friction of a healthy drive (actuators.ema.actuator)
LOW_HZ, HIGH_HZ, RATIO = 0.09, 11.0, 1.18  # frequencies of an oscillation [Hz]

PARAMS = [
    ("even", "f8", "-"),  # ticks of a sample
    ("sigma_f", "f8", "A"),  # noise of a sample of f: the sensor's 0.1 A over four ticks, and the demand's own
    ("b_motor", "f8", "A s/rad"),  # current per rate that weaker magnets would cause, all lost
    ("shape_mean", "f8", (HYPOTHESES, N)),
    ("shape_sd", "f8", (HYPOTHESES, N)),  # 0: as the flight has taught
]
STATE = [
    ("even_sum", "f8", (3,)),
    ("even_ticks", "f8", "-"),
    ("even_head", "f8", "-"),
    ("even_ring", "f8", (3, RING)),
    ("f_age", "f8", "-"),  # samples since f began, 0 while there is nothing
    ("JJ", "f8", (N * (N + 1) // 2,)),  # sums over the window, in units of the noise
    ("bb", "f8", (N,)),
    ("shape_n", "f8", "-"),  # samples, and their energy
    ("shape_energy", "f8"),
    ("LL", "f8", (N * (N + 1) // 2,)),  # Cholesky factor at hand, packed by rows
    ("yy", "f8", (N,)),
    ("prior", "f8", (2, N)),
    ("usual", "f8", (N,)),  # deviations that a hypothesis leaves to the flight
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
    return {"shape_mean": made[0], "shape_sd": made[1]}


@kernel
def best_sine(F, first, n, hz):
    """Return the frequency [Hz], `hz` or more, of the sine that leaves the least of the last `n` samples of ring `F`.
    """
    least, best, step = 1e300, 0.0, RATIO
    while hz <= HIGH_HZ:
        e = beside(F, F, first, n, 6.283185307179586 * hz * EVEN_S, 0.0)[0]
        if e < least:
            least, best = e, hz
        hz *= RATIO
    for _ in range(7):  # halve the step about the best
        step = math.sqrt(step)
        for hz in (best * step, best / step):
            e = beside(F, F, first, n, 6.283185307179586 * hz * EVEN_S, 0.0)[0]
            if e < least:
                least, best = e, hz
    return best


@kernel
def gather(x, p, first, n, hz):
    """Write the sums of the columns over the last `n` samples, a sine of `hz` among them, in units of the noise."""
    x.JJ[:] = 0.0
    x.bb[:] = 0.0
    z, i, energy, beyond, over = x.row, first, 0.0, 0.0, 1.0 / p.sigma_f
    for k in range(n):
        f, phase = x.even_ring[F, i], 6.283185307179586 * hz * EVEN_S * (k - 0.5 * (n - 1))
        z[COS], z[SIN], z[D], z[W] = math.cos(phase), math.sin(phase), x.even_ring[C, i] - f, x.even_ring[W_ROW, i]
        z[W], z[ONE], z[T] = p.b_motor * z[W], 1.0, (2.0 * k + 1.0) / n - 1.0
        for a in range(COS, N):
            z[a] *= over
            x.bb[a] += z[a] * over * f
            for b in range(COS, a + 1):
                x.JJ[at(a, b)] += z[a] * z[b]
        energy += f * f
        beyond += math.fabs(f) * max(math.fabs(f) - HEALTHY * p.I_max, 0.0)
        i = 0 if i == RING - 1 else i + 1
    x.must = beyond / max(energy, 1e-9)
    x.JJ[0], x.JJ[1], x.JJ[2], x.bb[FELT], x.bb[READ] = x.felt[0], x.felt[1], x.felt[2], x.felt[3], x.felt[4]
    x.shape_energy, x.shape_n = energy * over * over, n


@kernel
def ask(x, p, h):
    """Write the evidence of hypothesis `h`; what it leaves to the flight has the deviations `usual`."""
    for c in range(N):
        x.prior[0, c] = p.shape_mean[h, c]
        x.prior[1, c] = p.shape_sd[h, c] if p.shape_sd[h, c] > 0.0 else x.usual[c]
    if p.shape_sd[h, FELT] == 0.0:
        x.prior[0, FELT] -= 0.5 * (1.0 - x.must)
    logdet = factor(x.JJ, x.LL, x.prior[1], 0, N, 1e-9)
    of_felt = left(x.JJ, x.LL, x.bb, x.prior[0], x.yy, x.felt[5], COS)  # columns that share no sample with the others
    x.shape_left[h] = left(x.JJ, x.LL, x.bb, x.prior[0], x.yy, x.shape_energy + x.felt[5], N) - of_felt
    x.shape_L[h] = logarithm(x.shape_n, x.shape_left[h], 0.0) - 0.5 * (of_felt + logdet)
    if LOSES[h] > 0 and x.shape_energy > x.JJ[at(LOSES[h], LOSES[h])]:  # nothing loses more than it has
        x.shape_L[h] = -1e300


@kernel
def leader(x, n):
    """Return the hypothesis that leads every other name by SURE, HEALTH where none does or `n` samples do not suffice.
    """
    best, other = HEALTH, -1e300
    for h in range(HYPOTHESES):
        if x.shape_L[h] > x.shape_L[best]:
            best = h
    for h in range(HYPOTHESES):
        if NAME_OF[h] != NAME_OF[best] or WHO[h] != WHO[best]:
            other = max(other, x.shape_L[h])
    enough = n >= SAMPLES[best] if best != IN_PLACE else x.sine_hz[C] * n * EVEN_S >= 1.0
    whole = best != GONE or x.shape_left[GONE] <= 2.0 * n  # of no current there is nothing that it leaves
    return best if enough and whole and x.shape_L[best] - other > SURE else HEALTH


@kernel
def weigh(x, p, own, magnets):
    """Weigh the hypotheses over the samples since f began; name what leads. `own` and `magnets` are deviations of gain
    and magnets of a healthy drive."""
    n = min(int(x.f_age), RING)
    if n < LEAST:
        return
    first = (int(x.even_head) - n + RING) % RING
    for row in range(2):
        x.sine_hz[row] = best_sine(x.even_ring[row], first, n, LOW_HZ)
        gather(x, p, first, n, x.sine_hz[row])
        x.usual[:] = ABSENT
        x.usual[D], x.usual[W] = own, magnets
        x.usual[FELT], x.usual[READ] = FELT_LEAST + RUBS * (1.0 - x.must), FELT_LEAST + 1.0 - x.must
        for h in range(HYPOTHESES):
            if (h == IN_PLACE) == (row == C):
                ask(x, p, h)
    h = leader(x, n)
    x.drive_vote[1] = x.drive_vote[1] + 1.0 if x.drive_vote[0] == h else 1.0
    x.drive_vote[0] = h
    if h != HEALTH and x.drive_vote[1] >= VOTES:
        x.drive_name, x.drive_who, x.drive_lost = NAME_OF[h], WHO[h], LOST[h]
