"""The observer of `fdi.lpv_smo.lpv_smo`, stage by stage, as kernels on its records. Source: [Alwi14]; symbols as
there.
"""

import math

from actuators.block import kernel
from actuators.constants import G0, M_S_PER_KT, RAD_PER_DEG
from fdi.common.decision import delayed, held, usable
from fdi.common.why import BOX_MASS, LOST_SENSOR, VALID
from fdi.kinematic.wind import ACROSS, ALONG, DEVIATIONS, GUST_S, PRIOR, WIND_WALK

N, P, M, R, T = 7, 6, 2, 4, 35  # states, outputs, inputs, scheduling parameters, terms of a cubic trim map
NB = 32  # most boxes
NOT_TAKEN_OUT = 2.0  # limits grow with what is left of a gust that is taken out; an unknown wind stays in
MARGIN = 1.4  # of half a box from its middle: beyond a fifth of its width the affine model is no longer believed
STAY = 1.25  # so far a box is kept though another one fits better
BLOWN_S = 4.0  # for which a change of the wind across that only the vane tells is remembered [s]
DELAY = 12  # of the commands: beyond 5 ms at 2 kHz [ticks]
SIGMA_Q = 0.02 * RAD_PER_DEG  # noise of q per sample, sensor set `transport` [rad/s]


@kernel
def _schedule(x, u, p, dt):
    """Advance rho, held where invalid; return VALID, or the reason why no box holds it."""
    fresh = x.age == 0.0
    b = 1.0 if fresh or p.tau_rho <= 0.0 else 1.0 - math.exp(-dt / p.tau_rho)
    for i, (value, valid) in enumerate((
        (u.mass * 1e-3, u.mass_valid), (u.cg * 100.0, u.cg_valid), (u.cas / M_S_PER_KT, u.cas_valid),
        (u.mach, u.mach_valid),
    )):  # fmt: skip
        if usable(value, valid) > 0.5:
            x.rho[i] += b * (value - x.rho[i])
        elif fresh:
            x.rho[i] = 0.5 * (p.low[0, i] + p.high[0, i])
            return LOST_SENSOR
    return _choose(x, p)


@kernel
def _distance(x, p, k):
    """Return how far rho is from the middle of box k, in halves of its width, and along which parameter."""
    worst, where = 0.0, 0
    for i in range(R):
        z = math.fabs(2.0 * (x.rho[i] - p.low[k, i]) / (p.high[k, i] - p.low[k, i]) - 1.0)
        if z > worst:
            worst, where = z, i
    return worst, where


@kernel
def _choose(x, p):
    """Choose the box that holds rho best, keep it as long as it does, clamp rho to it; return 0.0 or `BOX_...`."""
    x.box = last = min(max(int(x.box), 0), int(p.n_box) - 1)
    far, where = _distance(x, p, last)
    if far > STAY or x.age == 0.0:
        for k in range(int(p.n_box)):
            d, along = _distance(x, p, k)
            if d < far:
                far, where, x.box = d, along, k
    now = int(x.box)
    if now != last and x.age > 0.0:  # the same estimate in the other box's coordinates
        for i in range(P):
            x.w += (p.L[now, i] - p.L[last, i]) * x.s[i]
    if far <= MARGIN:
        return VALID
    for i in range(R):
        half = 0.5 * (p.high[now, i] - p.low[now, i])
        middle = p.low[now, i] + half
        x.rho[i] = min(max(x.rho[i], middle - MARGIN * half), middle + MARGIN * half)
    return BOX_MASS + where


@kernel
def inputs(x, u, p, dt):
    """Fill rho, the healthy inputs and smoothed V; return 0.0, or the reason why no box holds rho."""
    why = _schedule(x, u, p, dt)
    head, fresh, ago = int(x.head), x.age == 0.0, p.delay + 1.0  # the command held over the tick that ends now
    elevator = 0.25 * (u.de_lo + u.de_li + u.de_ri + u.de_ro)
    elevator = delayed(x.line, head, 0, elevator / RAD_PER_DEG, ago, fresh)
    x.u_s = delayed(x.line, head, 1, u.stab / RAD_PER_DEG, ago, fresh)
    x.head = (head + 1) % DELAY
    most = p.rate_a * dt if p.rate_a > 0.0 and not fresh else math.inf
    x.u_r = min(max(elevator, x.u_r - most), x.u_r + most)
    if fresh or p.omega_a <= 0.0:
        x.u_0 = x.u_e = x.u_r
    else:
        x.u_0 = x.u_e
        x.u_e += (1.0 - math.exp(-p.omega_a * dt)) * (x.u_r - x.u_e)
    c = 1.0 if fresh or p.tau_v <= 0.0 else 1.0 - math.exp(-dt / p.tau_v)
    x.v_s += c * (u.V - x.v_s)
    return why


@kernel
def outputs(x, u, p, dt):
    """Filter n_z and alpha (7), linear between samples, and leave b = old s, s = new s."""
    b = int(x.box)
    for i, (value, valid) in enumerate(((u.n_z, u.n_z_valid), (u.alpha / RAD_PER_DEG, u.alpha_valid))):
        y = held(value, valid, x.y2[i])
        if x.age == 0.0:
            x.z[i] = y
        else:
            keep, c0, c1 = held_first_order(-p.a_f[b, i], dt)
            x.z[i] = keep * x.z[i] + p.a_f[b, i] * (c0 * x.y2[i] + c1 * y)
        x.y2[i] = y
    for i in range(P):
        x.b[i] = x.s[i]
        x.s[i] = (
            p.mix[b, i, 0] * u.h + p.mix[b, i, 1] * u.theta / RAD_PER_DEG + p.mix[b, i, 2] * x.speed
            + p.mix[b, i, 3] * u.q / RAD_PER_DEG + p.mix[b, i, 4] * x.z[0] + p.mix[b, i, 5] * x.z[1]
        )  # fmt: skip


@kernel
def sideways(u):
    """Return bank angle [rad], roll rate and yaw rate [rad/s]; one that is out counts as zero."""
    return held(u.phi, u.phi_valid, 0.0), held(u.p, u.p_valid, 0.0), held(u.r, u.r_valid, 0.0)


@kernel
def drift(x, u, p, dt):
    """Advance the steady wind in the axes of the heading, x.ahead against the flight and x.across from the left [m/s],
    as `fdi.kinematic.wind` does; set x.speed and x.over, speed and angle of attack over the air that drifts with it,
    x.side, sideslip over the ground [rad], and x.doubt, what the deviation of x.across may be worth as a gust [rad].

    Airspeed less ground speed has the wind ahead, and gusts. In a bank lateral velocity over the ground lowers the
    aircraft: V slip = sin(phi) (V_air sin(beta) + cos(phi) wind). Without one it turns the path while the aircraft
    rolls: until a bank has told the wind, limits are wider there. A gust from the side is told by the vane, whose
    lateral velocity it changes where that over the ground stays: x.blown [m/s], for BLOWN_S.
    """
    air = usable(u.tas, u.tas_valid) > 0.5
    if x.age == 0.0:
        x.ahead, x.ahead_var = u.tas - x.v_s if air else 0.0, PRIOR
        x.across, x.across_var, x.lean, x.tilt, x.spin, x.blown = 0.0, PRIOR * PRIOR, 0.0, 0.0, 0.0, 0.0
    phi, roll, yaw = sideways(u)
    vane = air and usable(u.beta, u.beta_valid) > 0.5
    sp, cp, speed = math.sin(phi), math.cos(phi), max(x.v_s, 10.0)
    lateral = u.tas * math.sin(u.beta) if vane else 0.0
    turn = dt * (u.q * sp + yaw * cp) / math.cos(u.theta)
    x.ahead, x.across = x.ahead - turn * x.across, x.across + turn * x.ahead
    x.ahead_var += WIND_WALK * WIND_WALK * dt
    x.across_var += WIND_WALK * WIND_WALK * dt
    c = 1.0 - math.exp(-dt / p.tau_f)  # slip has passed that lag
    x.lean += c * (sp * lateral - x.lean)
    x.tilt += c * (sp * cp - x.tilt)
    rough, white, x.pull = speed * speed * x.gust, 2.0 * GUST_S / dt, 0.0
    if air:
        gain = x.ahead_var / (x.ahead_var + white * (ALONG * ALONG + rough))
        x.pull = gain * (u.tas - x.v_s - x.ahead) / dt
        x.ahead += x.pull * dt
        x.ahead_var -= gain * x.ahead_var
    if vane and x.age > p.t_settle:
        s = x.tilt * x.tilt * x.across_var + white * (ACROSS * ACROSS + sp * sp * rough)
        gain = x.tilt * x.across_var / s
        x.across += gain * (speed * x.slip * RAD_PER_DEG - x.lean - x.tilt * x.across)
        x.across_var -= gain * x.tilt * x.across_var
    below = x.v_s * math.sin(u.alpha_ground) + x.ahead * math.sin(u.theta)
    x.over = math.atan2(below, x.v_s * math.cos(u.alpha_ground) + x.ahead * math.cos(u.theta))
    x.speed = x.v_s + x.ahead
    # the path over the ground veers by gravity and rates alone, a vane by gusts from the side, too
    veer = G0 * sp * math.cos(u.theta) - speed * (yaw * math.cos(x.over) - roll * math.sin(x.over))
    change = lateral - x.lateral if vane and x.vane > 0.5 else veer * dt
    blown = math.exp(-dt / BLOWN_S) * (x.blown + veer * dt - change)
    x.across += blown - x.blown
    x.across_var = max(x.across_var, 0.25 * blown * blown)  # the side force is left out: half of it may be wrong
    x.blown, x.lateral, x.vane = blown, lateral, 1.0 if vane else 0.0
    x.side = math.atan((lateral + cp * x.across) / speed)
    x.spin += c * (roll * math.cos(x.over) + yaw * math.sin(x.over) - x.spin)
    angle = DEVIATIONS * math.sqrt(x.across_var) * cp / speed * math.fabs(x.spin) / max(-x.A[0, 0], 0.1)
    x.doubt = NOT_TAKEN_OUT * angle


@kernel
def lateral(x, u, p):
    """Fill x.d with what bank and lateral rates add to the wings-level equations, in canonical coordinates.

    alpha' += g/V cos(theta) cos(alpha) (cos phi - 1) - (p cos(alpha) + r sin(alpha)) tan(side)
    theta' += q (cos phi - 1) - r sin phi
    Z' += V sin(alpha) cos(theta) (1 - cos phi),  V' -= g of the same,   q' += ((Izz - Ixx) p r - Ixz (p^2 - r^2)) / Iyy

    An extension: [Alwi14] treats the longitudinal motion alone.
    """
    phi, roll, yaw = sideways(u)
    lost, alpha, speed = 1.0 - math.cos(phi), x.alpha_hat, max(x.speed, 10.0)
    tilt = math.sin(alpha) * math.cos(u.theta) * lost
    d0 = -G0 / speed * math.cos(u.theta) * math.cos(alpha) * lost / RAD_PER_DEG
    if p.gust > 0.5:
        d0 -= (roll * math.cos(x.over) + yaw * math.sin(x.over)) * math.tan(x.side) / RAD_PER_DEG
    d1 = speed * tilt
    d2 = -(u.q * lost + yaw * math.sin(phi)) / RAD_PER_DEG
    d3 = -G0 * tilt + x.pull
    b = int(x.box)
    d4 = (p.inertia[0] * roll * yaw - p.inertia[1] * (roll * roll - yaw * yaw)) / RAD_PER_DEG
    for i in range(N):
        to = p.to_x[b, i]
        x.d[i] = to[0] * d0 + to[1] * d1 + to[2] * d2 + to[3] * d3 + to[4] * d4


@kernel
def observe(x, p, dt):
    """Advance w by one tick from x.b (old s) to x.s (20), then e_y and nu."""
    b = int(x.box)
    L = p.L[b]
    affine(p.A[b], x.rho, x.A)
    affine(p.B[b], x.rho, x.B)
    trim_map(p.eq[b], p.powers, p.low[b], p.high[b], x.rho, x.power, x.eq)
    d_0, d_1, d_s = x.u_0 - x.eq[N], x.u_e - x.eq[N], x.u_s - x.eq[N + 1]
    b_e, b_s = x.B[0, 0], x.B[0, 1]
    a, w_eq = x.A[0, 0], x.eq[0]
    for i in range(P):
        a += L[i] * x.A[i + 1, 0]
        w_eq += L[i] * x.eq[i + 1]
        b_e += L[i] * x.B[i + 1, 0]
        b_s += L[i] * x.B[i + 1, 1]
    # both ends of the tick with this tick's matrices: w is L Z large, and a change of a times it is no forcing
    g_0 = g_1 = b_s * d_s - a * w_eq + x.d[0]
    for i in range(P):
        row = x.A[0, i + 1] - a * L[i]
        for j in range(P):
            row += L[j] * x.A[j + 1, i + 1]
        g_0 += row * (x.b[i] - x.eq[i + 1]) + L[i] * x.d[i + 1]
        g_1 += row * (x.s[i] - x.eq[i + 1]) + L[i] * x.d[i + 1]
    if x.age == 0.0:  # start on the measured angle of attack: the first error dies at the sliding motion's pole
        x.w = x.y2[1]
        x.alpha_hat = x.y2[1] * RAD_PER_DEG
        for i in range(P):
            x.w += L[i] * x.s[i]
            x.e[i] = 0.0
    else:
        keep, c0, c1 = held_first_order(a, dt)
        x.w = keep * x.w + c0 * (g_0 + b_e * d_0) + c1 * (g_1 + b_e * d_1)
    x_1 = x.w
    for i in range(P):
        x_1 -= L[i] * x.s[i]
    x.alpha_hat = x_1 * RAD_PER_DEG
    _inject(x, p, x_1, d_0, d_1, d_s, dt)


@kernel
def _inject(x, p, x_1, d_0, d_1, d_s, dt):
    """Advance e_y and set nu (12)-(15), of the unmeasured state x_1 and the inputs' deviations from trim."""
    a22 = p.a22[int(x.box)]
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
    unit_vector_step(x.e, x.b, a22, p.K, p.delta, dt)
    e2, m2, n2 = 0.0, 0.0, 0.0
    for i in range(P):
        v = -0.5 / a22[i] * x.e[i]
        e2 += x.e[i] * x.e[i]
        m2 += v * v
    m = math.sqrt(m2)
    for i in range(P):
        x.nu[i] = 0.5 * p.K / a22[i] * x.e[i] / (m + p.delta)
        n2 += x.nu[i] * x.nu[i]
    x.e_norm, x.nu_norm = math.sqrt(e2), math.sqrt(n2) / p.K


@kernel
def gust(x, u, p, dt):
    """Advance x.xi [deg/s], what turns the path over the ground that the model does not know of, through a lag of
    tau_f: alpha_g' = A_11 (alpha_g - alpha_eq) + ... + xi, and xi_hat = (alpha_g - alpha_g_hat) / tau_f.

    An extension, off in the paper, whose angle of attack is that over the ground too (tables 2, 3): of a gust a that
    meets the wing, xi = A_11 a, which no fault of the n_z or alpha sensor moves.
    """
    measured = x.over / RAD_PER_DEG
    rate = x.A[0, 0] * (measured - x.eq[0]) + x.B[0, 1] * (x.u_s - x.eq[N + 1]) + x.d[0]
    rate += x.B[0, 0] * (x.u_e - x.eq[N])
    for i in range(P):
        rate += x.A[0, i + 1] * (x.s[i] - x.eq[i + 1])
    if x.age == 0.0:
        x.ground, x.rate, x.xi, x.slip, x.wind = measured, rate, 0.0, 0.0, 0.0
        return
    # the air's own speed along the path, as far as it changes: forces depend on airspeed, the states on ground speed
    if usable(u.tas, u.tas_valid) > 0.5:
        x.wind += (1.0 - math.exp(-dt / p.tau_f)) * (u.tas - x.speed - x.wind)
    # what sideslip adds to Z' in a bank, the observer takes for an angle of attack
    x.slip += (1.0 - math.exp(-dt / p.tau_f)) * (x.alpha_hat / RAD_PER_DEG - measured - x.slip)
    # backward Euler: (measured - ground) / tau_f stands for xi over the tick
    x.ground = (x.ground + 0.5 * dt * (x.rate + rate) + dt / p.tau_f * measured) / (1.0 + dt / p.tau_f)
    x.rate = rate
    x.xi = (measured - x.ground) / p.tau_f


@kernel
def learn(x, p, dt, f_e, f_n, f_a):
    """Average what no gust can do [deg, g, deg] from t_settle to t_learn: moment, lift that the model has wrong.

    An extension, off in the paper: 5 % on each coefficient of the trim is worth 0.9 deg of elevator. Where nothing may
    be judged the model is wrong by something else, and nothing is learned, either: it takes that much longer.
    """
    if x.learned > 0.5 or x.age <= p.t_settle or p.t_learn <= 0.0 or x.rho[R - 1] > p.mach_max or x.calm <= 0.0:
        return
    x.n_learn += 1.0
    for i, value in enumerate((f_e, f_n, f_a)):
        x.offset[i] += (value - x.offset[i]) / x.n_learn
    x.alpha_0 += (x.path - x.alpha_0) / x.n_learn
    x.trim_0 += (x.trim - x.trim_0) / x.n_learn
    if x.age >= p.t_learn and (x.n_learn + 1.5) * dt >= p.t_learn - p.t_settle:
        x.learned = 1.0


@kernel
def reconstruct(x, u, p, dt):
    """Turn nu into fault estimates (22), (25), through the lag; a sensor that is out keeps its estimate."""
    b = int(x.box)
    E, D51 = x.B[4, 0], x.B[5, 0] / p.a_f[b, 0]
    c = 1.0 - math.exp(-dt / p.tau_f)
    good = (1.0, usable(u.n_z, u.n_z_valid), usable(u.alpha, u.alpha_valid))
    for i in range(3):
        raw = 0.0
        for j in range(P):
            raw += p.W[b, i, j] * x.nu[j]
        if good[i] > 0.5:
            x.f[i] += c * ((raw / E if i == 0 else raw) - x.f[i])
    # a gust of angle a moves alpha's vane, n_z and the pitching moment together: (a, k_n a, k_e a)
    k_e = x.A[4, 0] / E
    k = x.A[5, 0] / p.a_f[b, 0]
    k_v = x.A[5, 3] / p.a_f[b, 0]
    k_n = k - D51 * k_e
    if p.gust > 0.5:  # a known one, of which an elevator fault turns the path by B_11 f_e
        xi = x.xi - x.A[0, 3] * x.wind
        # thrust that is not trim's: what speeds the aircraft up without being drag, at the engines' arm
        x.push += c * (x.nu[2] - x.push)
        thrust = x.push - x.A[3, 0] * (xi / x.A[0, 0] - x.slip) - x.A[3, 3] * x.wind
        f_e = x.f[0] - (x.A[4, 3] * x.wind + p.thrust * thrust) / E - k_e * (xi / x.A[0, 0] - x.slip)
        f_e /= 1.0 - k_e * x.B[0, 0] / x.A[0, 0]
        a = (xi - x.B[0, 0] * f_e) / x.A[0, 0]
        # it grows along the body as it passes: a' acts as a rate of pitch of the other sign
        f_e += p.gradient * x.A[4, 4] / E * (a - x.gust_hat / RAD_PER_DEG) / p.tau_g
        d = 1.0 - math.exp(-dt / p.tau_g)
        x.free[0] += d * (f_e - x.free[0])
        x.free[1] += d * (x.f[1] - D51 * f_e - k * (a - x.slip) - k_v * x.wind - x.free[1])
        x.free[2] += d * (x.f[2] - (a - x.slip) - x.free[2])
        f_e, f_n, f_a = x.free[0], x.free[1], x.free[2]
        learn(x, p, dt, f_e, f_n, f_a)
        x.gust_hat += d * (a * RAD_PER_DEG - x.gust_hat)
    else:
        f_e, f_n, f_a = x.f[0], x.f[1] - D51 * x.f[0], x.f[2]
        learn(x, p, dt, f_e - k_e * f_a, f_n - k_n * f_a, 0.0)
        x.gust_hat = 0.0
    o_e, o_n, o_a = x.learned * x.offset[0], x.learned * x.offset[1], x.learned * x.offset[2]
    x.f_hat_elevator = (f_e - o_e) * RAD_PER_DEG
    x.f_hat_n_z_raw = x.f[1] - o_n - D51 * o_e
    x.f_hat_n_z = f_n - o_n
    x.f_hat_alpha = (f_a - o_a) * RAD_PER_DEG
    # white noise of q through a difference and the lag: variance (c / h)^2 (1 + c / (2 - c)) sigma^2
    x.f_sigma = SIGMA_Q * c / dt * math.sqrt(1.0 + c / (2.0 - c)) / math.fabs(E)


@kernel
def affine(stack, rho, out):
    """Fill `out` (rows, cols) with stack[0] + sum rho_i stack[i] [Alwi14] (27)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            value = stack[0, i, j]
            for k in range(rho.size):
                value += rho[k] * stack[k + 1, i, j]
            out[i, j] = value


@kernel
def trim_map(coefficients, exponents, low, high, rho, power, out):
    """Fill `out` with polynomials of normalised rho: out_i = sum_t coefficients[i, t] prod_k z_k^exponents[t, k].

    `power` (n_rho, 4) is scratch for the powers of z = 2 (rho - low) / (high - low) - 1.
    """
    for k in range(rho.size):
        z = 2.0 * (rho[k] - low[k]) / (high[k] - low[k]) - 1.0
        power[k, 0] = 1.0
        for j in range(1, power.shape[1]):
            power[k, j] = power[k, j - 1] * z
    out[:] = 0.0
    for t in range(coefficients.shape[1]):
        term = 1.0
        for k in range(rho.size):
            term *= power[k, int(exponents[t, k])]
        for i in range(out.size):
            out[i] += coefficients[i, t] * term


@kernel
def unit_vector_step(e, b, a22, gain, delta, dt):
    """Advance e' = A22s e - K P_o e / (|P_o e| + delta) + ... by backward Euler, in place.

    A22s = diag(a22) < 0 and P_o = -A22s^-1 / 2 [Alwi14] (16). With b = e + h (everything else) and m = |P_o e|,

        e_i = b_i / (1 - h a_i + h K P_i / (m + delta)),

    one scalar equation in m, solved by Newton from above its root, where the right side's norm is increasing and
    concave. Stops when m moves by less than 1e-12.
    """
    m = 0.0
    for i in range(e.size):
        v = -0.5 / a22[i] * b[i]
        m += v * v
    m = math.sqrt(m)
    for _ in range(60):
        total, slope = 0.0, 0.0
        for i in range(e.size):
            k = -0.5 * dt * gain / a22[i]
            full = (1.0 - dt * a22[i]) * (m + delta) + k
            v = -0.5 / a22[i] * b[i] / full
            total += v * v * (m + delta) * (m + delta)
            slope += v * v * (m + delta) * k / full
        if total == 0.0:
            m = 0.0
            break
        root = math.sqrt(total)
        move = (root - m) / (1.0 - slope / root)
        m = max(m + move, 0.0)
        if math.fabs(move) < 1e-12:
            break
    for i in range(e.size):
        e[i] = b[i] / (1.0 - dt * a22[i] - 0.5 * dt * gain / a22[i] / (m + delta))


@kernel
def held_first_order(a, dt):
    """Return (e^(a h), c0, c1): x+ = e^(a h) x + c0 g_0 + c1 g_1 is exact for x' = a x + g, g linear in time."""
    z = a * dt
    if math.fabs(z) < 1e-4:  # series: the closed form loses digits as z -> 0
        return 1.0 + z * (1.0 + 0.5 * z), dt * (0.5 + z / 3.0), dt * (0.5 + z / 6.0)
    f = math.expm1(z)
    c1 = (f - z) / (z * a)
    return 1.0 + f, f / a - c1, c1
