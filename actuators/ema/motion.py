"""The motion of the electromechanical actuator over one sub-step.

Symbols as in `jay`. F is the spring force, K_s times the twist N x3 - l x1 less the backlash:

    x2' = (l F - B_N x2 + hm0 + hmd x1 - T_jam) / J_N
    x4' = (-N F - B_M x4 + K_T x5 - T_f) / J_M
    x5' = (g - x5) / tau,      g = (V - K_B x4) / R_g,   tau = L / R_g
    x6' = -b x6 + u

The electrical pole is at 8200 rad/s. With r the fast eigenvalue of (x4, x5), r^2 - r / tau + K_T K_B / (J_M L) = 0, and
kappa = K_T / (J_M r), the variables

    y = x4 + kappa x5,    y' = (-N F - B_M x4 + K_T g_r - T_f) / J_M
    s = x3 - kappa / r x5,    s' = y - kappa g_r
    x5' = -r (x5 - g_r),    g_r = (V - K_B y) / (R_g tau r)

no longer carry the fast current: y and s go by the classical fourth-order step, x5 by the exponential one (Cox and
Matthews, J. Comput. Phys. 176, 2002), x6 exactly for the held u. Parameters may change at every tick; against the
matrix exponential the unlimited model is right to the figures in its test. (Where r is not real, in voltage limit, the
current is slow: r = 1 / tau, and x4 stands for y in g_r.)
"""

import math

from actuators.block import kernel
from actuators.common.limits import within


@kernel
def fast(m3, x, p):
    """Return (r, R, slow): fast rate of the current, resistance R_g tau r of its steady value, 1 where r is real."""
    a = x.R_g / p.L
    disc = 0.25 * a * a - m3 * x.b_g * x.K_now * x.K_now * p.K_T * p.K_B / (p.J_M * p.L)
    if disc <= 0.0:
        return a, x.R_g, 0.0
    r = 0.5 * a + math.sqrt(disc)
    return r, r * p.L, 1.0


@kernel
def steady(w, x6, R, x, p):
    """Return the current to which x5 tends at motor rate (or y) `w` [A]; in the current loop x6 moves meanwhile."""
    V = x.g
    if x.mode == 0.0:
        V -= p.K_gi * (p.b - p.a) * (x6 - x.comp)
    return (V - x.b_g * x.K_now * p.K_B * w) / R


@kernel
def spring(x1, x3, x, p):
    """Return the force of the screw on the surface [N], none inside the backlash."""
    s = p.lead * x3 - p.arm * x1
    return p.K_s * (s - within(s, x.gap))


@kernel
def rates(x1, x2, x3, x4, g, d1, d3, hm0, hmd, x, p):
    """Return (x2', y'), y = x4 + K_T tau / J_M x5: accelerations of surface and motor, sliding in directions d1, d3."""
    F = spring(x1, x3, x, p)
    dx2 = (p.arm * F - p.B_N * x2 + hm0 + hmd * x1 - d1 * x.M_add) / p.J_N
    return dx2, (-p.lead * F - p.B_M * x4 + x.K_now * p.K_T * g - d3 * (p.T_c + x.T_add)) / p.J_M


@kernel
def move(x1, x2, x3, x4, i, m1, m3, d1, d3, hm0, hmd, h, x, p):
    """Return (x1, x2, x3, x4, i, x6) after `h`; m1, m3 are 0 where surface or motor is held."""
    r, R, slow = fast(m3, x, p)
    kappa = x.K_now * p.K_T / (p.J_M * r)
    k3 = m3 * kappa / r
    w, E2 = 0.5 * h, math.exp(-0.5 * h * r)
    e6 = math.exp(-p.b * w)
    x6h = e6 * x.comp + (1.0 - e6) * x.u_eff / p.b
    x6e = e6 * x6h + (1.0 - e6) * x.u_eff / p.b
    n = m3 * slow  # of y in the steady current, the rest is x4
    y, s = x4 + kappa * i, x3 - k3 * i

    ga = steady(x4 + n * kappa * i, x.comp, R, x, p)
    a2, ay = rates(x1, x2, x3, x4, ga, d1, d3, hm0, hmd, x, p)
    as_ = m3 * (y - kappa * ga)
    ia = E2 * i + (1.0 - E2) * ga
    v2, yv = x2 + w * m1 * a2, y + w * ay
    v4 = m3 * (yv - kappa * ia)
    gb = steady(v4 + n * kappa * ia, x6h, R, x, p)
    b2, by = rates(x1 + w * x2, v2, s + w * as_ + k3 * ia, v4, gb, d1, d3, hm0, hmd, x, p)
    bs = m3 * (yv - kappa * gb)
    ib = E2 * i + (1.0 - E2) * gb
    w2, yw = x2 + w * m1 * b2, y + w * by
    w4 = m3 * (yw - kappa * ib)
    gc = steady(w4 + n * kappa * ib, x6h, R, x, p)
    c2, cy = rates(x1 + w * v2, w2, s + w * bs + k3 * ib, w4, gc, d1, d3, hm0, hmd, x, p)
    cs = m3 * (yw - kappa * gc)
    ic = E2 * ia + (1.0 - E2) * (2.0 * gc - ga)
    z2, yz = x2 + h * m1 * c2, y + h * cy
    z4 = m3 * (yz - kappa * ic)
    gd = steady(z4 + n * kappa * ic, x6e, R, x, p)
    e2, ey = rates(x1 + h * w2, z2, s + h * cs + k3 * ic, z4, gd, d1, d3, hm0, hmd, x, p)
    es = m3 * (yz - kappa * gd)

    z = -h * r
    f1 = (E2 * E2 - 1.0) / z
    f2 = (f1 - 1.0) / z
    f3 = (f2 - 0.5) / z
    mean = (f1 - 3.0 * f2 + 4.0 * f3) * ga + (f2 - 2.0 * f3) * 2.0 * (gb + gc) + (4.0 * f3 - f2) * gd
    i_end = E2 * E2 * i - z * mean
    q = h / 6.0
    y_end = y + q * (ay + 2.0 * (by + cy) + ey)
    return (
        x1 + q * m1 * (x2 + 2.0 * (v2 + w2) + z2),
        m1 * (x2 + q * (a2 + 2.0 * (b2 + c2) + e2)),
        s + q * (as_ + 2.0 * (bs + cs) + es) + k3 * i_end,
        m3 * (y_end - kappa * i_end),
        i_end,
        x6e,
    )
