"""Multiple models of soft oil and of joined chambers: four Kalman filters that start with an alarm.

The signatures of `filter` are linear in the size of a fault. An actuator whose oil has lost most of its stiffness, or
that floats freely, is another system, and has a Kalman filter of its own here: of x = (q, q', z, F, theta), the first
four as in `filter`, with the errors that the flight has taught, and theta unknown when the alarm begins:

    z' = k (g root(z) u + w - l z - q')

| filter | in the model | theta |
|---|---|---|
| SOFT | k e^theta | ln of the share of the oil's stiffness that is left |
| JOINED | g = 0, l of the bypass, w = l theta | offset of the pressure sensor, which a load no longer hides [1] |
| ADDED | w = theta | flow that is added, a random walk [m/s] |
| IN_PLACE | g = 0, w = theta | flow in place of the valve's, a random walk [m/s] |

The last two follow any valve, whatever it does. A filter whose model holds foresees each sample of rod and pressure
more sharply than they do, who know less: it leads in the logarithm of the likelihood of the last seconds' innovations
[Basseville93].
"""

import math

from actuators.block import kernel
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import opening
from fdi.common.linalg import integral
from fdi.isolation import filter
from fdi.isolation.evidence import BYPASS
from fdi.isolation.filter import FAST, FLOW, FRICTION, GAIN, LEAK, MASS, PRESSURE, ROD, ROWS, SUPPLY

SOFT, JOINED, ADDED, IN_PLACE = range(4)
RIVALS = 4
N = 5
MEMORY = 2.0  # of the likelihoods [s]
SETTLES = 0.1  # after the start [s]
GATHERED_S = 0.2  # for which likelihoods are gathered before they say anything [s]
P0 = (1e-7, 1e-2, 1e-2, 1e-1)  # variances of (q, q', z, F) at the start
THETA, THETA_SD = (-1.6, 0.0, 0.0, 0.0), (0.9, 0.006, 0.03, 0.03)  # theta at the start
WALK = (0.1, 0.0, 0.03, 0.03)  # of theta: a fault that grows, a valve that moves [1/sqrt s, -, m/s/sqrt s]
SOFT_MOST = -0.4  # two thirds of the stiffness are left: more may be tolerances and the hinge
SOFT_LEAST = -3.0  # 5 % of the stiffness are left: softer, and the oil follows any valve, too
RUBS = 3e-4  # what friction, of which joined chambers show more, may do to the rod [m^2/s^3]
HOLDS = 1.25  # times noise that a model leaves if it holds
BESIDE = 1.11  # ... and times what IN_PLACE leaves, which follows part of the noise
NAMED = 30.0  # lead of a name
LOST_S = 0.2  # without a sensor for longer nothing is asked [s]

STATE = [
    ("rival_s", "f8", "s"),  # time for which they have run, below 0: not
    ("rival_hat", "f8", (RIVALS, N)),  # m, m/s, 1, 1, theta
    ("rival_P", "f8", (RIVALS, N, N)),
    ("rival_Phi", "f8", (3, N)),  # of one prediction
    ("rival_W", "f8", (3, N)),  # scratch
    ("rival_K", "f8", (N,)),  # scratch: gain of one sensor
    ("rival_load", "f8", (RIVALS,)),  # by the hinge-moment model, one tick ago
    ("rival_n", "f8"),  # samples, forgotten over MEMORY
    ("rival_Q", "f8", (RIVALS,)),  # squared innovations over their variances
    ("rival_ln", "f8", (RIVALS,)),  # logarithms of the variances
    ("rival_lead", "f8", (2,)),  # lead of SOFT and of JOINED over all others, where they fit
    ("rival_poor", "f8", (2,), "s"),  # for which SOFT and JOINED have not led
    ("shown", "f8", (2,)),  # 1 where the alarm has shown that the oil is soft, that the chambers are joined
]


@kernel
def start(x, u):
    """Begin at the measurements, with no more known than that."""
    for h in range(RIVALS):
        hat, P = x.rival_hat[h], x.rival_P[h]
        P[:] = 0.0
        for i in range(4):
            P[i, i] = P0[i]
        P[4, 4] = THETA_SD[h] * THETA_SD[h]
        hat[0], hat[1], hat[2], hat[3], hat[4] = u.y_rod, 0.0, u.y_dp, -u.y_dp, THETA[h]
    x.rival_s = 0.0


@kernel
def take(x, h, row, y, r, scale):
    """Let filter `h` take the sample `y` of its state `row`, of variance `r` and noise `scale`; add what it leaves."""
    hat, P, K = x.rival_hat[h], x.rival_P[h], x.rival_K
    s, e = P[row, row] + r, y - hat[row]
    for i in range(N):
        K[i] = P[i, row] / s
    for i in range(N):
        hat[i] += K[i] * e
        for k in range(i + 1):
            P[i, k] -= K[i] * K[k] * s
            P[k, i] = P[i, k]
    x.rival_Q[h] += e * e / (s * scale)
    x.rival_ln[h] += math.log(s * scale)


@kernel
def measure(x, u, p, dt):
    """Take what the filter without a fault has taken of rod and pressure at this tick."""
    keep = 1.0 - dt / MEMORY if x.rival_s > SETTLES else 0.0
    x.rival_n *= keep
    for h in range(RIVALS):
        x.rival_Q[h] *= keep
        x.rival_ln[h] *= keep
    for j in (ROD, PRESSURE):
        if x.h_s[j] > 0.0:
            y = (u.y_rod if j == ROD else u.y_dp) - x.h_aged[j]
            x.rival_n += 1.0
            for h in range(RIVALS):
                take(x, h, ROWS[j], y, p.h_r[j], x.noise[j])


@kernel
def valve_flow(x, v, z, p):
    """Return the flow of a sound valve under command `v` at pressure `z`, and its slope over the pressure."""
    mu, gain, root = x.mu, p.phi_n / p.A_p, opening(v, z)
    held = max(root, filter.ROOT_LEAST)
    passes = v + mu[FAST] * x.u_fast + mu[GAIN] * (v - x.u_fast)
    return gain * (root * passes - 0.5 * mu[SUPPLY] * v / held), -0.5 * gain * math.fabs(v) / held


@kernel
def oil(x, h, v, p):
    """Return of the model of filter `h`: flow without the leak, its slope over the pressure, leakage, stiffness, and
    what theta adds to the rate of the pressure."""
    q, w, z, theta = x.rival_hat[h, 0], x.rival_hat[h, 1], x.rival_hat[h, 2], x.rival_hat[h, 4]
    k, leak, flow = lu17.stiffness(q, p) * (1.0 + x.mu[filter.SOFT]), p.L + x.mu[LEAK], x.mu[FLOW]
    if h == JOINED:
        return flow + BYPASS * theta, 0.0, BYPASS, k, k * BYPASS
    if h == IN_PLACE:
        return flow + theta, 0.0, leak, k, k
    passes, slope = valve_flow(x, v, z, p)
    flow += passes
    if h == ADDED:
        return flow + theta, slope, leak, k, k
    k *= math.exp(theta)
    return flow, slope, leak, k, k * (flow - leak * z - w)


@kernel
def predict(x, h, u, v, p, dt):
    """Predict filter `h` over one tick under valve command `v`, by the exponential of its model about the estimate."""
    hat, Phi, mu, force = x.rival_hat[h], x.rival_Phi, x.mu, p.A_p * p.P_s
    if h == SOFT:
        hat[4] = min(max(hat[4], SOFT_LEAST), 0.0)
    w, z = hat[1], hat[2]
    flow, slope, leak, k, by = oil(x, h, v, p)
    net = flow - leak * z - w
    push, damp, back = force / p.M, -p.B / p.M, k * (slope - leak)
    k1, k2, k3, l1, l2, l3, m1, m2, m3 = integral(0.0, damp, push, 0.0, -k, back, dt)
    pushed = (z + hat[3]) * (1.0 - mu[MASS]) - p.B * w / force - mu[FRICTION] * w / (filter.CREEP + math.fabs(w))
    hat[0] += dt * w
    K, L, M = (k1, k2, k3), (l1, l2, l3), (m1, m2, m3)
    for i in range(3):  # I + Psi A
        Phi[i, 0] = 1.0 if i == 0 else 0.0
        Phi[i, 1] = K[i] + damp * L[i] - k * M[i] + (1.0 if i == 1 else 0.0)
        Phi[i, 2] = push * L[i] + back * M[i] + (1.0 if i == 2 else 0.0)
        Phi[i, 3], Phi[i, 4] = push * L[i], by * M[i]
        hat[i] += push * L[i] * pushed + k * M[i] * net
    load = (u.hm0_model + u.hmd_model * hat[0] / p.arm) / (p.arm * force)
    hat[3] += load - x.rival_load[h] if x.rival_s > 0.0 else 0.0
    x.rival_load[h] = load
    spread(x.rival_P[h], Phi, x.rival_W)
    rate = k * p.flow_share * flow
    walk = (0.0, RUBS if h == JOINED else 0.0, rate * rate * filter.RATE_TAU,
            p.load_share * p.load_share * x.load_rate2 * filter.RATE_TAU)  # fmt: skip
    for i in range(4):
        x.rival_P[h, i, i] += (p.h_q[i] + walk[i]) * dt
    x.rival_P[h, 4, 4] += WALK[h] * WALK[h] * dt


@kernel
def spread(P, Phi, W):
    """Replace P by Phi P Phi^T, where the last two rows of Phi, left out of it, are those of random walks."""
    for i in range(3):
        for j in range(N):
            W[i, j] = 0.0
            for a in range(N):
                W[i, j] += Phi[i, a] * P[a, j]
    for i in range(3):
        for j in range(N):
            s = W[i, j]
            if j < 3:
                s = 0.0
                for a in range(N):
                    s += W[i, a] * Phi[j, a]
            P[i, j] = P[j, i] = s


@kernel
def lead(x, h):
    """Return by how much the logarithm of the likelihood of filter `h` leads all others, 0 where its model is poor."""
    poor = x.rival_Q[h] > min(HOLDS * x.rival_n, BESIDE * x.rival_Q[IN_PLACE])
    if poor or x.rival_s < GATHERED_S or (h == SOFT and x.rival_hat[SOFT, 4] > SOFT_MOST):
        return 0.0
    least = 1e300
    for i in range(RIVALS):
        if i != h:
            least = min(least, x.rival_Q[i] + x.rival_ln[i])
    return 0.5 * (least - x.rival_Q[h] - x.rival_ln[h])


@kernel
def update(x, u, p, dt):
    """Run the filters for one tick, after `filter.advance`, while an alarm stands and what that hears; keep what they
    have shown."""
    x.rival_lead[SOFT] = x.rival_lead[JOINED] = 0.0
    if x.alarm < 0.5:
        x.shown[SOFT] = x.shown[JOINED] = 0.0
    lost = max(x.h_lost[ROD], x.h_lost[PRESSURE])
    if x.alarm < 0.5 or x.h_clock == 0.0 or lost > LOST_S or x.at_stop > 0.5:
        x.rival_s = -1.0
        return
    if x.rival_s < 0.0:
        if lost == 0.0:
            start(x, u)
        return
    for h in range(RIVALS):
        predict(x, h, u, x.u_old[int(p.delay)], p, dt)
    measure(x, u, p, dt)
    x.rival_s += dt
    for h in range(RIVALS):
        if not math.fabs(x.rival_hat[h, 0]) + math.fabs(x.rival_hat[h, 1]) + math.fabs(x.rival_hat[h, 2]) < 5.0:
            start(x, u)
    for h in range(2):
        x.rival_lead[h] = lead(x, h)
        x.rival_poor[h] = x.rival_poor[h] + dt if x.rival_lead[h] <= 0.0 else 0.0
        if x.rival_poor[h] > MEMORY:  # it does not hold: a small oscillation in place fits at first
            x.shown[h] = 0.0
        if x.rival_lead[h] > NAMED:
            x.shown[h], x.shown[1 - h] = 1.0, 0.0
