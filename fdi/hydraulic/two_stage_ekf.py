"""The two-stage filter of `iotsekf`: [Lu17] (14)-(36), the iterated optimal two-stage extended Kalman filter.

A filter that ignores the fault (x_bar) and a filter of the fault (f) run side by side; together they are the Kalman
filter of the state augmented by f:

    x_hat = x_bar + V f,   P = P_bar + V P_f V^T          [Lu17] (15)-(16)

| symbol | field | meaning |
|---|---|---|
| x = (q, q', dP/P_s, F) | x_hat | rod [m], [m/s], [1], external force over the stall force A_p P_s [1] |
| f^i | f_hat | input fault, in the unit of the valve command [1] |
| x-bar, P^x-bar | x_bar, P_bar | bias-free filter |
| U, V, S = H U | U, V | blending matrices |
| Phi, Gamma | Phi, G | of one matrix exponential: (20) read literally is wrong |

Load forms (PARAMS.load): 0 ignored, as published; 1 a hinge-moment model; 2 the differential pressure is measured and
F is a random walk. Measurements are scalars taken one after the other, which is exact for uncorrelated noise and lets
an invalid one drop out. The measurements are `delay` ticks old: the filter runs that far behind and predicts the
present (`q_now`, `v_now`, `x3_now`). The published iteration (21)-(24) converges at its first pass, because h is
linear; it is kept, bounded, as published.
"""

import math

from actuators.block import kernel
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import jacobian, rk4
from fdi.common.decision import shift, usable
from fdi.common.linalg import congruence, diagonal, integral, joseph

ITERATIONS = 4  # bound of (21)-(24)
GATE_NONE = 1e9
P_MOST, P_MOST_DP = 1e-4, 0.1  # what a refused sample adds to the variance of rod [m^2] and pressure [1] at most
# Without the pressure: F is known to 5 % of the stall force or 20 % of itself, about 0.06, for about a second, which is
# 200 samples: as white noise its variance is 200 * 0.06^2
R_MODEL = 0.7
# Beyond these the filter has run away: pressures and forces over the stall force, valve command; V; covariances.
# Healthy ones stay below 0.4, 8 and 0.02
X_SANE, V_SANE, P_SANE = 5.0, 1e3, 10.0
HISTORY = 10  # ticks of valve command kept for the delay: 5 ms at 2 kHz
# Longest step of a prediction: the oil mode, 56 rad/s, turns by 0.56 rad in it, which one Runge-Kutta step follows to
# 0.05 %; in 20 ms it is 1.1 rad and 1.5 %, and the root of (4) is no longer that of the beginning [s]
STEP_MOST = 0.01

PARAMS = [
    ("arm", "f8", "m"),  # rod arm
    *lu17.FIELDS,
    ("load", "f8"),  # load form 0, 1, 2
    ("centre", "f8"),  # 0: (17) integrates at x_bar, as published; 1: at x_hat with f, then removes U f
    ("total_sign", "f8"),  # 0: sign(u) chooses the supplied chamber, as published; 1: sign(u + f)
    ("delay", "f8", "-"),  # age of the measurements, 0 to HISTORY
    ("epsilon", "f8"),  # end of the iteration, epsilon_0
    ("q", "f8", (4,)),  # process noise densities of x [unit^2/s]
    ("q_f", "f8", "1/s"),  # of the fault
    ("q_xf", "f8", (4,)),  # correlation of both
    ("r_rod", "f8", "m2"),  # variance of a rod sample
    ("r_dp", "f8", "-"),  # of a pressure sample
    ("P0", "f8", (4,)),  # initial variances
    ("P0_f", "f8"),
    ("gate_rod", "f8"),  # an innovation of rod or pressure beyond so many sigma is a spike
    ("spikes", "f8", "-"),  # ... unless so many samples in a row agree that it is not
    ("t_invalid", "f8", "s"),  # without rod for longer the estimate is not valid
    ("r_spare", "f8", "m2"),  # variance of the surface sensor in place of the rod, rigging included
]
STATE = [
    ("started", "f8", "-"),  # 1 after the first usable rod sample
    ("x_bar", "f8", (4,), "m, m/s, -, -"),
    ("P_bar", "f8", (4, 4)),
    ("Phi", "f8", (4, 4)),
    ("W", "f8", (4, 4)),  # scratch
    ("G", "f8", (4,)),
    ("flow_gain", "f8", "m/s"),  # flow of the valve per unit of its command
    ("U", "f8", (4,)),
    ("V", "f8", (4,)),
    ("K", "f8", (4,)),  # bias-free gain of the last measurement
    ("eta", "f8", (4,)),
    ("P_f", "f8", "-"),  # variance of f
    ("u_old", "f8", (HISTORY + 1,), "-"),  # valve commands, newest first
    ("x_hat", "f8", (4,), "m, m/s, -, -"),  # estimate at the time of the measurement
    ("f_hat", "f8", "-"),  # input fault
    ("f_sigma", "f8", "-"),  # its standard deviation
    ("q_now", "f8", "m"),  # predicted rod position
    ("v_now", "f8", "m/s"),  # rod velocity
    ("x3_now", "f8", "-"),  # pressure difference
    ("gamma_rod", "f8", "m"),  # innovation of the rod
    ("gamma_dp", "f8", "-"),  # of the pressure
    ("nis_rod", "f8", "-"),  # squared, over its variance
    ("nis_dp", "f8", "-"),
    ("skip_rod", "f8", "-"),  # samples refused in a row
    ("skip_dp", "f8", "-"),
    ("dp_out", "f8", "-"),  # 1 while the pressure sensor is left out
    ("age", "f8", "s"),  # since the last rod sample used
    ("age_dp", "f8", "s"),  # since the last pressure sample used
    ("age_rod", "f8", "s"),  # since the last sample of the rod's own sensor
]


@kernel
def load_model(q, u, p):
    """Return the load that the hinge-moment model foresees at position `q` [m], over the stall force [1]."""
    return (u.hm0_model + u.hmd_model * q / p.arm) / (p.arm * p.A_p * p.P_s)


@kernel
def force(x, u, p):
    """Return the external force on the rod of the chosen load form [N]."""
    if p.load == 2.0:
        return p.A_p * p.P_s * x.x_hat[3]
    if p.load == 1.0:
        return (u.hm0_model + u.hmd_model * x.x_hat[0] / p.arm) / p.arm
    return 0.0


@kernel
def start(x, q, dp, u, p):
    """Begin at the measurement, at rest, in equilibrium with the load."""
    diagonal(x.P_bar, p.P0)
    x.x_bar[:] = x.U[:] = x.V[:] = 0.0
    x.x_bar[0] = x.x_hat[0] = q
    if p.load == 2.0:
        x.x_bar[2], x.x_bar[3] = dp, -dp
    else:
        x.P_bar[3, 3] = 0.0
        x.x_bar[2] = -force(x, u, p) / (p.A_p * p.P_s)
    x.P_f = p.P0_f
    x.f_hat = x.age = x.skip_rod = x.skip_dp = 0.0
    combine(x)
    x.started = 1.0


@kernel
def combine(x):
    """Blend both filters. [Lu17] (15)"""
    for i in range(4):
        x.x_hat[i] = x.x_bar[i] + x.V[i] * x.f_hat


@kernel
def transition(Phi, G, a, side, v, f, stiffness, load_state, p, dt):
    """Write Phi (4, 4) and Gamma (4,) of (q, q', x3, F) over one tick about `a`; return the valve's flow per unit
    of its command [m/s]. [Lu17] (19)-(20)

    Both from one exponential. `stiffness` is the load's own slope [N m/rad]; `load_state`: F acts on the rod.
    Columns of Psi = int exp(A s) ds give Phi = I + Psi A and Gamma = Psi G.
    """
    a22, a23, a31, a32, a33, b3, e2 = jacobian(a[0], a[1], a[2], side, v, f, p)
    a21 = e2 * stiffness / (p.arm * p.arm)
    k1, k2, k3, l1, l2, l3, m1, m2, m3 = integral(a21, a22, a23, a31, a32, a33, dt)
    Phi[0, 0], Phi[1, 0], Phi[2, 0] = 1.0 + a21 * l1 + a31 * m1, a21 * l2 + a31 * m2, a21 * l3 + a31 * m3
    Phi[0, 1], Phi[1, 1] = k1 + a22 * l1 + a32 * m1, 1.0 + k2 + a22 * l2 + a32 * m2
    Phi[2, 1] = k3 + a22 * l3 + a32 * m3
    Phi[0, 2], Phi[1, 2], Phi[2, 2] = a23 * l1 + a33 * m1, a23 * l2 + a33 * m2, 1.0 + a23 * l3 + a33 * m3
    e4 = e2 * p.A_p * p.P_s if load_state else 0.0
    Phi[0, 3], Phi[1, 3], Phi[2, 3], Phi[3, 3] = e4 * l1, e4 * l2, e4 * l3, 1.0
    G[0], G[1], G[2] = b3 * m1, b3 * m2, b3 * m3
    return -b3 / a32


@kernel
def time_update(x, u, v, p, dt):
    """Predict over one tick under valve command `v`. [Lu17] (14), (17)-(20), (26), (28), (31)-(33), (35)"""
    f = x.f_hat
    a = x.x_hat
    side = v + f if p.total_sign > 0.5 else v
    F = force(x, u, p)
    Phi = x.Phi
    x.flow_gain = transition(Phi, x.G, a, side, v, f, u.hmd_model if p.load == 1.0 else 0.0, p.load == 2.0, p, dt)
    P_f = x.P_f + p.q_f * dt  # (28)
    for i in range(4):
        s = x.G[i]
        for j in range(4):
            s += Phi[i, j] * x.V[j]
        x.eta[i] = s  # U_bar (33)
        x.U[i] = s + (p.q_xf[i] * dt - s * p.q_f * dt) / P_f  # (35)
    # state
    if p.centre > 0.5:
        x1, x2, x3 = rk4(a[0], a[1], a[2], side, v, f, F, p, dt)
        x.x_bar[0], x.x_bar[1] = x1 - x.U[0] * f, x2 - x.U[1] * f
        x.x_bar[2], x.x_bar[3] = x3 - x.U[2] * f, a[3] - x.U[3] * f
    else:
        b = x.x_bar
        if p.load == 2.0:
            F = p.A_p * p.P_s * b[3]
        x1, x2, x3 = rk4(b[0], b[1], b[2], v, v, 0.0, F, p, dt)
        b[0], b[1], b[2] = x1, x2, x3
        for i in range(4):
            b[i] += (x.eta[i] - x.U[i]) * f  # (31)
    # blending, covariance (18), (32)
    congruence(x.P_bar, Phi, x.W)
    for i in range(4):
        x.V[i] = x.U[i]  # until a measurement blends further
        x.P_bar[i, i] += p.q[i] * dt
        for j in range(4):
            c = p.q_xf[j] * dt
            x.P_bar[i, j] += -p.q_xf[i] * dt * x.eta[j] - x.U[i] * (c - x.eta[j] * p.q_f * dt)
    x.P_f = P_f
    combine(x)


@kernel
def predict(x, u, v, p, dt):
    """Predict over one tick under the held valve command `v`, in steps of STEP_MOST at most; x.G is then the tick's."""
    n = max(math.ceil(dt / STEP_MOST - 1e-6), 1)
    for _ in range(n):
        time_update(x, u, v, p, dt / n)
    Phi, G = x.Phi, x.G
    b1, b2, b3 = G[0], G[1], G[2]
    for _ in range(n - 1):  # G of the whole tick
        g1, g2, g3 = G[0], G[1], G[2]
        for i in range(3):
            G[i] = Phi[i, 0] * g1 + Phi[i, 1] * g2 + Phi[i, 2] * g3 + (b1 if i == 0 else (b2 if i == 1 else b3))


@kernel
def measure(x, j, y, r, gate, p):
    """Update with the scalar `y`, a measurement of x[j] of variance `r`; return (innovation, its variance, used)."""
    P = x.P_bar
    S = x.V[j]  # (34)
    f = x.f_hat
    s_bar = P[j, j] + r
    s = s_bar + S * x.P_f * S
    gamma = y - x.x_bar[j] - S * f
    if gamma * gamma > gate * gate * s:
        return gamma, s, 0.0
    K = x.K
    for i in range(4):
        K[i] = P[i, j] / s_bar  # (22)
        x.eta[i] = x.x_bar[i]
    for _ in range(ITERATIONS):
        change, norm = 0.0, 0.0
        e = y - x.eta[j] - (x.x_bar[j] - x.eta[j])
        for i in range(4):
            new = x.x_bar[i] + K[i] * e  # (23)
            change += (new - x.eta[i]) * (new - x.eta[i])
            norm += new * new
            x.eta[i] = new
        if change <= p.epsilon * p.epsilon * norm:
            break
    K_f = x.P_f * S / s  # (29)
    x.f_hat = f + K_f * gamma  # (27)
    x.P_f = (1.0 - K_f * S) * x.P_f  # (30)
    for i in range(4):
        x.x_bar[i] = x.eta[i]  # (24)
        x.V[i] -= K[i] * S  # (36)
    joseph(P, K, j, r)  # (25)
    return gamma, s, 1.0


@kernel
def measurement_update(x, u, p, dt):
    """Take the rod (or, without it, the surface) and the pressure; refuse spikes, but not for long."""
    rod = usable(u.y_rod, u.y_rod_valid) > 0.5 and x.blame != 1.0
    surface = usable(u.y_surface, u.y_surface_valid) > 0.5 and x.blame != 2.0
    spare = surface and not rod and x.pair_time > 0.0
    x.age = 0.0 if rod or spare else x.age + dt
    x.age_rod = 0.0 if rod else x.age_rod + dt
    if rod or spare:
        y = u.y_rod if rod else p.arm * u.y_surface + x.rigging
        step = x.h_step + dt * (x.x_hat[1] - x.h_hat[1])  # of the last tick, with the fault known
        y += x.fed[0] * step  # AGE of `fdi.isolation.filter`
        gamma, s, used = measure(x, 0, y, p.r_rod if rod else p.r_spare, p.gate_rod, p)
        x.gamma_rod, x.nis_rod = gamma, gamma * gamma / s
        x.skip_rod = 0.0 if used > 0.5 else x.skip_rod + 1.0
        if x.skip_rod > p.spikes:  # several agree: it is the estimate that is wrong, in position before anything else
            x.P_bar[0, 0] += min(gamma * gamma, P_MOST)
            x.skip_rod = 0.0
    if p.load == 2.0:
        x.age_dp += dt
        if usable(u.y_dp, u.y_dp_valid) > 0.5 and x.dp_out < 0.5:
            gamma, s, used = measure(x, 2, u.y_dp - x.h_aged[2], p.r_dp, p.gate_rod, p)
            x.gamma_dp, x.nis_dp = gamma, gamma * gamma / s
            x.age_dp *= 1.0 - used
            x.skip_dp = 0.0 if used > 0.5 else x.skip_dp + 1.0
            if x.skip_dp > p.spikes:
                x.P_bar[2, 2] += min(gamma * gamma, P_MOST_DP)
                x.skip_dp = 0.0
        if x.age_dp > p.t_invalid:
            measure(x, 3, load_model(x.x_hat[0], u, p), R_MODEL, GATE_NONE, p)
    combine(x)


@kernel
def sane(x):
    """Return whether estimate and covariance are finite and within what an actuator can be."""
    total = 0.0
    for i in range(4):
        total += math.fabs(x.V[i]) / V_SANE
        for j in range(4):
            total += math.fabs(x.P_bar[i, j]) / P_SANE
    worst = max(max(math.fabs(x.x3_now), math.fabs(x.x_hat[3])), math.fabs(x.f_hat)) / X_SANE
    # a comparison with what is not a number is false
    finite = math.isfinite(x.q_now + x.v_now + x.x3_now + x.f_hat + x.P_f + total)
    return max(total, worst) < 1.0 and x.P_f < P_SANE and finite


@kernel
def clear(x):
    """Forget estimate and covariance: the filter begins again at the next usable rod sample."""
    for v in (x.x_bar, x.x_hat, x.G, x.U, x.V, x.K, x.eta):
        v[:] = 0.0
    for A in (x.P_bar, x.Phi, x.W):
        A[:] = 0.0
    x.started = x.f_hat = x.f_sigma = x.P_f = x.q_now = x.v_now = x.x3_now = 0.0
    x.gamma_rod = x.gamma_dp = x.nis_rod = x.nis_dp = 0.0


@kernel
def remember(x, u):
    """Keep the valve command, newest first; the last one stands where it is not a number."""
    shift(x.u_old, min(max(u.u, -1.0), 1.0) if math.isfinite(u.u) else x.u_old[0])


@kernel
def predict_now(x, f, F, p, dt):
    """Write the state at present from that of the last prediction, under input fault `f` and force `F` [N]."""
    q, v, x3 = x.x_hat[0], x.x_hat[1], x.x_hat[2]
    for i in range(int(p.delay) - 2, -1, -1):
        q, v, x3 = rk4(q, v, x3, x.u_old[i], x.u_old[i], f, F, p, dt)
    x.q_now, x.v_now, x.x3_now = q, v, x3


@kernel
def estimate(x, u, p, dt):
    """Run the filter for one tick, after `remember`: [Lu17] (14)-(36) on measurements that are `delay` ticks old, less
    what learned ages (`fdi.isolation`) make of them."""
    if x.started < 0.5:
        if usable(u.y_rod, u.y_rod_valid) < 0.5:
            x.age += dt
            return
        start(x, u.y_rod, u.y_dp if usable(u.y_dp, u.y_dp_valid) > 0.5 else 0.0, u, p)
    d = int(p.delay)
    if d == 0:
        predict(x, u, x.u_old[0], p, dt)
    measurement_update(x, u, p, dt)
    if d > 0:
        predict(x, u, x.u_old[d - 1], p, dt)
    predict_now(x, x.f_hat, force(x, u, p), p, dt)
    x.f_sigma = math.sqrt(max(x.P_f, 0.0))
    if not sane(x):
        clear(x)
