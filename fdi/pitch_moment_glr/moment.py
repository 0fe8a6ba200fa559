"""The pitch-moment equation: the plant's nonlinear moment and what may be wrong with it, as kernels on the records of
`fdi.pitch_moment_glr.pitch_moment_glr`.

    q' = (q_bar S / I_yy) sum_k C_k(alpha, Mach, q_bar) x_k c_k + ((I_zz - I_xx) p r - I_xz (p^2 - r^2)) / I_yy + M_T

M_T, of thrust, by the force along the body: m (g n_x) less the air's, at the engines' arm.
c_k is the chord c, of lift and drag the arm (x_cg - x_ref) c about the centre of gravity.
"""

import math

from actuators.block import kernel
from actuators.constants import G0
from fdi.common.decision import clipped
from fdi.control_redundancy.force_model import air_data, contributions

NX = 10  # terms of the regression, `TERMS`
NV = 12  # signals that are averaged between two samples
LINE = 100  # of the gust on its way to the tail, every FINE seconds: down to 65 m/s
FINE = 0.005  # what a gust changes by in a sample of the regression is no small part of its moment [s]
TAU_FUSE = 0.2  # noise of the gyro over that of the accelerometer of pitch: the gyro tells more below 1 / TAU_FUSE [s]
TAPS = 9  # samples of the filter that fuses them
LATE = TAPS // 2 + 1  # samples that it comes late, and with it all terms
TAU_THRUST = 0.2  # of thrust as the accelerometer has it: engines are slower, its noise is not [s]
TAU_LAG = 0.12  # of elevator and friction: a servo takes up what makes it late [s]
SLIP = 0.5e-3  # of a rod, after which friction has turned [m]
PITCH, LIFT, DRAG = 4, 0, 1  # axes of the force model


@kernel
def follow(x, p, i, command, dt):
    """Advance the servo model `i` with the limits of `actuators.common.reference`; return the surface of `late` ago.

    Friction of the hydraulic one, -1 to 1 of that of sliding, has turned after SLIP of its rod [Dahl76].
    """
    now = x.m[i] - p.late * x.md[i]
    away = min(max(command, p.limit_low), p.limit_high) - x.m[i]
    v = clipped(p.k1[i] * away, min(p.v_max[i], math.sqrt(0.8 * p.a_max[i] * math.fabs(away))))
    a = clipped(p.k2[i] * (v - x.md[i]), p.a_max[i])
    j = clipped(p.k3[i] * (a - x.mdd[i]), p.j_max[i])
    if i == 0:
        way = x.md[0] * dt * p.arm / SLIP
        x.stick += clipped(way - math.fabs(way) * x.stick, 1.0)
    x.m[i] += dt * (x.md[i] + dt * (x.mdd[i] / 2.0 + dt * j / 6.0))
    x.md[i] += dt * (x.mdd[i] + dt * j / 2.0)
    x.mdd[i] += dt * j
    return now


@kernel
def fuse(x, p, rate, acceleration, ts):
    """Return the pitch acceleration of LATE samples ago from means of pitch rate and acceleration of a sample each.

    y = a + sum h_j (q' - a)_j passes the signal as it is, whatever h; q' has (w TAU_FUSE)^2 times the noise of a, so
    that the mean of both weighted by their variances has h near 1 / (1 + (w TAU_FUSE)^2).
    """
    if x.filled < 0.5:
        x.q_1 = x.q_2 = rate
        x.a_1 = acceleration
        for i in range(TAPS):
            x.apart[i], x.plain[i] = 0.0, acceleration
    head = int(x.fused)
    x.apart[head] = (rate - x.q_2) / (2.0 * ts) - x.a_1
    x.plain[head] = x.a_1
    x.q_2, x.q_1, x.a_1 = x.q_1, rate, acceleration
    y = x.plain[(head + TAPS - TAPS // 2) % TAPS]
    for i in range(TAPS):
        y += p.blend[i] * x.apart[(head + TAPS - i) % TAPS]
    x.fused = (head + 1) % TAPS
    return y


@kernel
def upward(alpha, ground, tas, v_ground):
    """Return the vertical gust as an angle [rad]: without what the vane has of a gust along the way."""
    return math.sin(alpha) - v_ground / max(tas, 10.0) * math.sin(ground)


@kernel
def late_gust(x, p, gust, tas, dt):
    """Take the `gust` that the wing meets into the line; return the one that has reached the tail."""
    x.since_line += 1.0
    if x.since_line >= p.fine or x.started < 0.5:
        x.since_line = 0.0
        x.head = (x.head + 1.0) % LINE
        x.line[int(x.head)] = gust
    head = int(x.head)
    late = min(max((p.tail_arm / max(tas, 10.0) / dt - x.since_line) / p.fine, 0.0), LINE - 2.0)
    k = int(late)
    f = late - k
    return (1.0 - f) * x.line[(head + LINE - k) % LINE] + f * x.line[(head + LINE - k - 1) % LINE]


@kernel
def _sort(x, p, ca, sa, dx, q, de):
    """Sum x.part, coefficient times variable, into x.group by what it goes with [m]; return lift less drag along the
    body, as a coefficient, with pitch rate and elevator as given."""
    along = 0.0
    for g in range(5):
        x.group[g] = 0.0
    for k in range(int(p.n_k)):
        axis = int(p.axis[k])
        arm = p.chord if axis == PITCH else (dx * ca if axis == LIFT else dx * sa)
        variable = int(p.variable[k])
        g = 0
        if variable == 1:
            g = 1
        elif variable == 3:
            g = 2
        elif 7 <= variable <= 10:
            g = 3
        elif variable == 14:
            g = 4
        x.group[g] += arm * x.part[k]
        if axis != PITCH:
            along += x.part[k] * (sa if axis == LIFT else -ca) * (q if g == 2 else de if g == 3 else 1.0)
    return along


@kernel
def terms(x, p, ts):
    """Fill x.term (NX,) [rad/s2] from the means x.mean_ of the last samples; return the moment as computed."""
    v = x.mean_
    alpha, ground, q, fast, slow_r = v[0], v[1], v[2], v[4], v[5]
    n_x, n_z, level = v[6], v[7], v[8]
    tas, v_ground = max(v[9], 10.0), v[10]
    de, rate = v[11], x.rate
    _, qbar = air_data(x.cas, x.mach)
    gain = qbar * p.area / p.gyration2[1] / x.mass
    dx = (x.cg - p.cg_ref) * p.chord
    half = 0.5 * p.chord / tas
    for i in range(15):
        x.variable[i] = 0.0
    x.variable[0] = 1.0
    ca, sa = math.cos(alpha), math.sin(alpha)
    x.variable[1] = half * (q + G0 * (level - n_z * ca + n_x * sa) / tas)
    x.variable[3] = half
    for i in range(7, 11):
        x.variable[i] = 1.0
    x.variable[14] = x.stab
    contributions(p, alpha, x.mach, qbar, x.variable, x.part, x.slope)
    along = _sort(x, p, ca, sa, dx, q, de)
    x.effect = gain * x.group[3]
    t = x.term
    t[0] = gain * x.group[0]
    t[1] = gain * x.group[2] * q
    t[2] = x.effect * de
    t[3] = gain * x.group[1]
    t[4] = gain * x.group[2] * (x.tail - upward(alpha, ground, tas, v_ground)) * tas / p.tail_arm
    spin = (p.gyration2[2] - p.gyration2[0]) / p.gyration2[1] * fast * slow_r - p.gyration2[3] / p.gyration2[1] * (
        fast * fast - slow_r * slow_r
    )
    c = 1.0 - math.exp(-ts / TAU_LAG)
    if x.filled < 0.5:
        x.slow[0], x.slow[1] = t[2], x.effect * x.rub
    x.slow[0] += c * (t[2] - x.slow[0])
    x.slow[1] += c * (x.effect * x.rub - x.slow[1])
    t[5] = t[2] - x.slow[0]
    t[6] = x.effect * rate
    # engines below the centre of gravity: what the accelerometer has and the air does not make is thrust
    push = p.thrust_arm * (G0 * n_x - qbar * p.area / x.mass * along)
    if x.filled < 0.5:
        x.push = push
    x.push += (1.0 - math.exp(-ts / TAU_THRUST)) * (push - x.push)
    t[7] = x.push
    t[8] = x.effect * x.rub - x.slow[1]
    t[9] = 1.0
    return t[0] + t[1] + t[2] + t[3] + t[7] + gain * x.group[4] + spin
