"""The observer of `fdi.lpv_smo.lpv_smo`, stage by stage, as kernels on its records. Source: [Alwi14]; symbols as
there.
"""

import math

from actuators.block import kernel
from fdi.common.decision import usable
from fdi.lpv_smo.kernels import affine, affine_scalar, held_first_order, trim_map, unit_vector_step

N, P, M, R, T = 7, 6, 2, 4, 35  # states, outputs, inputs, scheduling parameters, terms of a cubic trim map
DELAY = 12  # of the commands: beyond 5 ms at 2 kHz [ticks]
DEG = math.pi / 180
KT = 1852 / 3600  # [m/s]
G0 = 9.80665  # [m/s2]


@kernel
def _schedule(x, u, p, dt):
    """Advance rho, held where invalid, clamped to the box; return 1.0 when it lies inside."""
    fresh = x.age == 0.0
    b = 1.0 if fresh or p.tau_rho <= 0.0 else 1.0 - math.exp(-dt / p.tau_rho)
    inside = 1.0
    for i in range(R):
        if i == 0:
            value, good = u.mass * 1e-3, u.mass_valid
        elif i == 1:
            value, good = u.cg * 100.0, u.cg_valid
        elif i == 2:
            value, good = u.cas / KT, u.cas_valid
        else:
            value, good = u.mach, u.mach_valid
        if usable(value, good) > 0.5:
            x.rho[i] += b * (value - x.rho[i])
        elif fresh:
            x.rho[i] = 0.5 * (p.low[i] + p.high[i])
            inside = 0.0
        margin = 0.2 * (p.high[i] - p.low[i])  # beyond a fifth of the box the affine model is no longer believed
        if x.rho[i] < p.low[i] - margin or x.rho[i] > p.high[i] + margin:
            inside = 0.0
            x.rho[i] = min(max(x.rho[i], p.low[i] - margin), p.high[i] + margin)
    return inside


@kernel
def inputs(x, u, p, dt):
    """Fill rho, the healthy inputs and smoothed V; return 1.0 when rho lies inside the box."""
    inside = _schedule(x, u, p, dt)
    head = int(x.head)
    before = (head + 2 * DELAY - 1 - int(p.delay)) % DELAY  # the command held over the tick that ends now
    for j in range(M):
        value = 0.25 * (u.de_lo + u.de_li + u.de_ri + u.de_ro) if j == 0 else u.stab
        if math.isfinite(value):
            value /= DEG
        else:
            value = x.line[(head + DELAY - 1) % DELAY, j]
        if x.age == 0.0:
            for i in range(DELAY):
                x.line[i, j] = value
        x.line[head, j] = value
    x.head = (head + 1) % DELAY
    x.u_s = x.line[before, 1]
    if x.age == 0.0 or p.omega_a <= 0.0:
        x.u_0 = x.u_e = x.line[before, 0]
    else:
        x.u_0 = x.u_e
        x.u_e += (1.0 - math.exp(-p.omega_a * dt)) * (x.line[before, 0] - x.u_e)
    c = 1.0 if x.age == 0.0 or p.tau_v <= 0.0 else 1.0 - math.exp(-dt / p.tau_v)
    x.v_s += c * (u.V - x.v_s)
    return inside


@kernel
def outputs(x, u, p, dt):
    """Filter n_z and alpha (7), linear between samples, and leave b = old s, s = new s."""
    for i in range(2):
        y = x.y2[i]
        if i == 0 and usable(u.n_z, u.n_z_valid) > 0.5:
            y = u.n_z
        elif i == 1 and usable(u.alpha, u.alpha_valid) > 0.5:
            y = u.alpha / DEG
        if x.age == 0.0:
            x.z[i] = y
        else:
            keep, c0, c1 = held_first_order(-p.a_f[i], dt)
            x.z[i] = keep * x.z[i] + p.a_f[i] * (c0 * x.y2[i] + c1 * y)
        x.y2[i] = y
    for i in range(P):
        x.b[i] = x.s[i]
        x.s[i] = (
            p.mix[i, 0] * u.h + p.mix[i, 1] * u.theta / DEG + p.mix[i, 2] * x.v_s + p.mix[i, 3] * u.q / DEG
            + p.mix[i, 4] * x.z[0] + p.mix[i, 5] * x.z[1]
        )  # fmt: skip


@kernel
def bank(x, u, p):
    """Fill x.d with what bank and lateral rates add to the wings-level equations, in canonical coordinates.

    alpha' += g/V cos(theta) cos(alpha) (cos phi - 1),   theta' += q (cos phi - 1) - r sin phi
    Z' += V sin(alpha) cos(theta) (1 - cos phi),  V' -= g of the same,   q' += ((Izz - Ixx) p r - Ixz (p^2 - r^2)) / Iyy

    An extension: [Alwi14] treats the longitudinal motion alone. Signals that are out count as zero.
    """
    for i in range(N):
        x.d[i] = 0.0
    if p.bank < 0.5:
        return
    phi = u.phi if usable(u.phi, u.phi_valid) > 0.5 else 0.0
    roll = u.p if usable(u.p, u.p_valid) > 0.5 else 0.0
    yaw = u.r if usable(u.r, u.r_valid) > 0.5 else 0.0
    lost, alpha, speed = 1.0 - math.cos(phi), x.alpha_hat, max(x.v_s, 10.0)
    tilt = math.sin(alpha) * math.cos(u.theta) * lost
    d0 = -G0 / speed * math.cos(u.theta) * math.cos(alpha) * lost / DEG
    d1 = speed * tilt
    d2 = -(u.q * lost + yaw * math.sin(phi)) / DEG
    d3 = -G0 * tilt
    d4 = (p.inertia[0] * roll * yaw - p.inertia[1] * (roll * roll - yaw * yaw)) / DEG
    for i in range(N):
        x.d[i] = p.to_x[i, 0] * d0 + p.to_x[i, 1] * d1 + p.to_x[i, 2] * d2 + p.to_x[i, 3] * d3 + p.to_x[i, 4] * d4


@kernel
def observe(x, p, dt):
    """Advance w and e_y by one tick from x.b (old s) to x.s, and set nu (12)-(15), (20)."""
    affine(p.A, x.rho, x.A)
    affine(p.B, x.rho, x.B)
    trim_map(p.eq, p.powers, p.low, p.high, x.rho, x.power, x.eq)
    d_0, d_1, d_s = x.u_0 - x.eq[N], x.u_e - x.eq[N], x.u_s - x.eq[N + 1]
    b_e, b_s = x.B[0, 0], x.B[0, 1]
    a, w_eq = x.A[0, 0], x.eq[0]
    for i in range(P):
        a += p.L[i] * x.A[i + 1, 0]
        w_eq += p.L[i] * x.eq[i + 1]
        b_e += p.L[i] * x.B[i + 1, 0]
        b_s += p.L[i] * x.B[i + 1, 1]
    # both ends of the tick with this tick's matrices: w is L Z large, and a change of a times it is no forcing
    g_0 = g_1 = b_s * d_s - a * w_eq + x.d[0]
    for i in range(P):
        row = x.A[0, i + 1] - a * p.L[i]
        for j in range(P):
            row += p.L[j] * x.A[j + 1, i + 1]
        g_0 += row * (x.b[i] - x.eq[i + 1]) + p.L[i] * x.d[i + 1]
        g_1 += row * (x.s[i] - x.eq[i + 1]) + p.L[i] * x.d[i + 1]
    if x.age == 0.0:  # start on the measured angle of attack: the first error dies at the sliding motion's pole
        x.w = x.y2[1]
        x.alpha_hat = x.y2[1] * DEG
        for i in range(P):
            x.w += p.L[i] * x.s[i]
            x.e[i] = 0.0
    else:
        keep, c0, c1 = held_first_order(a, dt)
        x.w = keep * x.w + c0 * (g_0 + b_e * d_0) + c1 * (g_1 + b_e * d_1)
    x_1 = x.w
    for i in range(P):
        x_1 -= p.L[i] * x.s[i]
    x.alpha_hat = x_1 * DEG
    for i in range(P):
        phi = x.A[i + 1, 0] * (x_1 - x.eq[0]) + x.B[i + 1, 1] * d_s + x.d[i + 1]
        for j in range(P):
            phi += x.A[i + 1, j + 1] * (x.s[j] - x.eq[j + 1])
        if x.age == 0.0:
            x.b[i] = 0.0
        else:
            forced = 0.5 * (x.phi[i] + phi + x.B[i + 1, 0] * (d_0 + d_1))
            x.b[i] = x.e[i] + dt * forced - (x.s[i] - x.b[i])
        x.phi[i] = phi
    unit_vector_step(x.e, x.b, p.a22, p.K, p.delta, dt)
    e2, m2, n2 = 0.0, 0.0, 0.0
    for i in range(P):
        v = -0.5 / p.a22[i] * x.e[i]
        e2 += x.e[i] * x.e[i]
        m2 += v * v
    m = math.sqrt(m2)
    for i in range(P):
        x.nu[i] = 0.5 * p.K / p.a22[i] * x.e[i] / (m + p.delta)
        n2 += x.nu[i] * x.nu[i]
    x.e_norm, x.nu_norm = math.sqrt(e2), math.sqrt(n2) / p.K


@kernel
def learn(x, p, elevator, n_z):
    """Average what no gust can do [deg, g] from t_settle to t_learn: the moment and lift that the model has wrong.

    An extension, off in the paper: 5 % on each coefficient of the trim is worth 0.9 deg of elevator. alpha needs none.
    """
    if x.learned > 0.5 or p.t_learn <= 0.0 or x.age <= p.t_settle:
        return
    x.n_learn += 1.0
    x.sums[0] += (elevator - x.sums[0]) / x.n_learn
    x.sums[1] += (n_z - x.sums[1]) / x.n_learn
    if x.age >= p.t_learn:
        x.learned = 1.0
        x.offset[0], x.offset[1] = x.sums[0], x.sums[1]


@kernel
def reconstruct(x, u, p, dt):
    """Turn nu into fault estimates (22), (25), through the lag; a sensor that is out keeps its estimate."""
    E = affine_scalar(p.E, x.rho)
    D51 = affine_scalar(p.D51, x.rho)
    c = 1.0 - math.exp(-dt / p.tau_f)
    for i in range(3):
        raw = 0.0
        for j in range(P):
            raw += p.W[i, j] * x.nu[j]
        if i == 0:
            raw /= E
        out = (i == 1 and usable(u.n_z, u.n_z_valid) < 0.5) or (i == 2 and usable(u.alpha, u.alpha_valid) < 0.5)
        if not out:
            x.f[i] += c * (raw - x.f[i])
    # a gust of angle a moves alpha's vane, n_z and the pitching moment together: (a, k_n a, k_e a)
    x.k_e = x.A[4, 0] / E
    k_n = x.A[5, 0] / p.a_f[0] - D51 * x.k_e
    x.k_n = k_n / DEG
    learn(x, p, x.f[0] - x.k_e * x.f[2], x.f[1] - D51 * x.f[0] - k_n * x.f[2])
    f_e = x.f[0] - x.offset[0]
    x.f_hat_elevator = f_e * DEG
    x.f_hat_n_z_raw = x.f[1] - x.offset[1] - D51 * x.offset[0]
    x.f_hat_n_z = x.f[1] - D51 * x.f[0] - x.offset[1]
    x.f_hat_alpha = x.f[2] * DEG
    x.free_elevator = (f_e - x.k_e * x.f[2]) * DEG
    x.free_n_z = x.f_hat_n_z - k_n * x.f[2]
    # white noise of q through a difference and the lag: variance (c / h)^2 (1 + c / (2 - c)) sigma^2
    x.f_sigma = p.sigma_q * c / dt * math.sqrt(1.0 + c / (2.0 - c)) / math.fabs(E)
