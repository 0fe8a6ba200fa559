"""The pitch-moment equation: the plant's nonlinear moment and what may be wrong with it, as kernels on the records of
`fdi.pitch_moment_glr.pitch_moment_glr`.

    q' = (q_bar S / I_yy) sum_k C_k(alpha, Mach, q_bar) x_k c_k + ((I_zz - I_xx) p r - I_xz (p^2 - r^2)) / I_yy

c_k is the chord c, of lift and drag the arm (x_cg - x_ref) c about the centre of gravity.
"""

import math

from actuators.block import kernel
from actuators.constants import G0
from fdi.common.decision import clipped
from fdi.control_redundancy.force_model import air_data, contributions

NX = 13  # terms of the regression, `TERMS`
NV = 12  # signals that are averaged between two samples
LINE = 40  # samples of the gust on its way to the tail
ARM = 3.6  # of tail behind the wing, in mean chords
TAU_FUSE = 0.2  # the gyro below 1 / TAU_FUSE, the accelerometer of pitch above it [s]
TAU_VANE = 0.1  # of the lagged gust [s]
TAU_LAG = 0.12  # of elevator and static moment: friction makes a servo late, circulation the air [s]
PITCH, LIFT, DRAG = 4, 0, 1  # axes of the force model


@kernel
def follow(x, p, i, command, dt):
    """Advance the servo model `i` with the limits of `actuators.common.reference`; return the surface of `late` ago."""
    now = x.m[i] - p.late * x.md[i]
    away = min(max(command, p.limit_low), p.limit_high) - x.m[i]
    v = clipped(p.k1[i] * away, min(p.v_max[i], math.sqrt(0.8 * p.a_max[i] * math.fabs(away))))
    a = clipped(p.k2[i] * (v - x.md[i]), p.a_max[i])
    j = clipped(p.k3[i] * (a - x.mdd[i]), p.j_max[i])
    x.m[i] += dt * (x.md[i] + dt * (x.mdd[i] / 2.0 + dt * j / 6.0))
    x.md[i] += dt * (x.mdd[i] + dt * j / 2.0)
    x.mdd[i] += dt * j
    return now


@kernel
def _sort(x, p, ca, sa, dx):
    """Sum x.part, coefficient times variable, into x.group by what it goes with [m]."""
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


@kernel
def terms(x, p, ts):
    """Fill x.term (NX,) [rad/s2] from the means x.mean_ of the last samples; return the moment as computed."""
    v = x.mean_
    alpha, ground, q, fast, slow_r = v[0], v[1], v[2], v[4], v[5]
    n_x, n_z, level = v[6], v[7], v[8]
    tas, gust_u = max(v[9], 10.0), v[10]
    de, rate = v[11], x.rate
    _, qbar = air_data(x.cas, x.mach)
    gain = qbar * p.area / p.gyration2[1] / x.mass
    dx = (x.cg - p.cg_ref) * p.chord
    half = 0.5 * p.chord / tas
    gust = alpha - ground
    for i in range(15):
        x.variable[i] = 0.0
    x.variable[0] = 1.0
    contributions(p, ground, x.mach, qbar, x.variable, x.part, x.slope)
    _sort(x, p, math.cos(ground), math.sin(ground), dx)
    calm = gain * x.group[0]
    ca, sa = math.cos(alpha), math.sin(alpha)
    x.variable[1] = half * (q + G0 * (level - n_z * ca + n_x * sa) / tas)
    x.variable[3] = half
    for i in range(7, 11):
        x.variable[i] = 1.0
    x.variable[14] = x.stab
    contributions(p, alpha, x.mach, qbar, x.variable, x.part, x.slope)
    _sort(x, p, ca, sa, dx)
    # the tail meets the gust later
    head = int(x.head)
    x.line[head, 0], x.line[head, 1] = gust, gust_u
    arm = ARM * p.chord
    late = min(max(arm / tas / ts, 0.0), LINE - 2.0)
    whole = int(late)
    f = late - whole
    a, b = (head + LINE - whole) % LINE, (head + LINE - whole - 1) % LINE
    gust_tail = (1.0 - f) * x.line[a, 0] + f * x.line[b, 0]
    u_tail = (1.0 - f) * x.line[a, 1] + f * x.line[b, 1]
    x.head = (head + 1) % LINE
    x.lagged += (1.0 - math.exp(-ts / TAU_VANE)) * (gust - x.lagged)
    slope = 0.0
    if math.fabs(gust) > 1e-6:
        slope = (gain * x.group[0] - calm) / gust
    x.slope_a += (1.0 - math.exp(-ts / 5.0)) * (slope - x.slope_a)
    x.effect = gain * x.group[3]
    t = x.term
    t[0] = gain * x.group[0]
    t[1] = gain * x.group[0] - calm
    t[2] = gain * x.group[2] * q
    t[3] = x.effect * de
    t[4] = gain * x.group[1]
    t[5] = gain * x.group[2] * (gust_tail - gust) * tas / arm
    spin = (p.gyration2[2] - p.gyration2[0]) / p.gyration2[1] * fast * slow_r - p.gyration2[3] / p.gyration2[1] * (
        fast * fast - slow_r * slow_r
    )
    c = 1.0 - math.exp(-ts / TAU_LAG)
    if x.filled < 0.5:
        x.slow[0], x.slow[1] = t[3], t[0]
    x.slow[0] += c * (t[3] - x.slow[0])
    x.slow[1] += c * (t[0] - x.slow[1])
    t[6] = t[3] - x.slow[0]
    t[7] = t[0] - x.slow[1]
    t[8] = x.effect * rate
    t[9] = t[3] * gust_u / tas
    t[10] = t[3] * (u_tail - gust_u) / tas
    t[11] = x.slope_a * (x.lagged - gust)
    t[12] = 1.0
    return t[0] + t[2] + t[3] + t[4] + gain * x.group[4] + spin
