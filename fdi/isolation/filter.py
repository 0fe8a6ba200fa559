"""The filter without a fault state of a hydraulic actuator, and what model errors leave in its innovations.

A Kalman filter of x = (q, q', z, F): rod [m, m/s], pressure over supply, load over the stall force, with the nominal
parameters of [Lu17] (4). Rod, surface and pressure are taken one after the other; the load follows the increments of
the hinge-moment model and a random walk so tight that a pressure sensor's fault and a valve's differ in the force
equation. An error theta of the model enters the innovations as e = S theta; its signature S goes through the filter:

    V <- Phi V + (what enters),    S_j = V_j (+ what enters at sensor j),    V <- V - K_j S_j        [Willsky76]

| column | enters | theta |
|---|---|---|
| LEAK | flow -z | added leakage [m/s] |
| SOFT | flow, what compresses the oil | share by which the oil is stiffer [1] |
| SUPPLY | flow -u / (2 root) | share of the supply that is lost [1] |
| FRICTION | force -tanh(q' / CREEP) | friction over the stall force [1] |
| MASS | force -(z + F) | share by which the moving mass is larger [1] |
| OFFSET | flow of the valve and the leak per pressure | error of the pressure sensor that the load has taken up [1] |
| FLOW | flow 1 | constant flow [m/s] |
| SLOPE | flow t | flow that grows [m/s^2] |
| FAST | flow root u, of u above CORNER | share of the fast part, noise of the servo's sensors, that passes more [1] |
| GAIN | flow root u, of u below CORNER | share by which the valve passes more [1] |
"""

import math

from actuators.block import kernel
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import opening, rk4
from fdi.common.linalg import congruence
from fdi.hydraulic.separate_bias import HISTORY, transition

ROD, SURFACE, PRESSURE = range(3)
SENSORS = 3
LEAK, SOFT, SUPPLY, FRICTION, MASS, OFFSET, FLOW, SLOPE, FAST, GAIN = range(10)
N = 10  # columns; the gain is the last: its prior changes most often, and a Cholesky factor then in its last row only
ROWS = (0, 0, 2)  # state that each sensor reads
CORNER_HZ, CORNER_MOST = 25.0, 0.3  # an oscillation of up to 10 Hz stays below; share of the rate
CREEP = 3e-3  # friction turns round within this velocity [m/s]
STEP_MOST = 0.01  # of a prediction [s], as in fdi/hydraulic/separate_bias.py
RIGGING_TAU = 20.0  # lag of the rigging [s]
RATE_TAU = 0.1  # for so long a fast load or flow leaves the model in doubt [s]
GATE = 25.0  # of an innovation: beyond so many sigma of a healthy one a sample counts for no more

PARAMS = [
    ("arm", "f8", "m"),  # rod arm
    *lu17.FIELDS,
    ("delay", "f8", "-"),  # age of the measurements [ticks]
    ("q", "f8", (4,)),  # process noise densities of x [unit^2/s]
    ("r", "f8", (SENSORS,)),  # variances of a sample of rod [m^2], surface as a rod [m^2], pressure [1]
    ("P0", "f8", (4,)),  # initial variances
    ("load_share", "f8", "-"),  # of the hinge-moment model's rate, that it may err by
    ("flow_share", "f8", "-"),  # of the flow, that the valve's equation may err by beyond what the columns say
    ("share", "f8", "-"),  # of the gain's signature, that no column explains
    ("high_b", "f8", (3,)),  # numerator of the high-pass
    ("high_a", "f8", (2,)),  # denominator, the leading one left out
    ("prior_mean", "f8", (N,)),
    ("prior_sd", "f8", (N,)),
]
STATE = [
    ("started", "f8", "-"),  # 1 after the first usable rod sample
    ("x_hat", "f8", (4,), "m, m/s, -, -"),  # estimate at the time of the measurement
    ("P", "f8", (4, 4)),
    ("Phi", "f8", (4, 4)),
    ("W", "f8", (4, 4)),  # scratch
    ("G", "f8", (4,)),
    ("K", "f8", (4,)),
    ("u_old", "f8", (HISTORY + 1,), "-"),  # valve commands, newest first
    ("load_last", "f8", "-"),  # load by the hinge-moment model, one tick ago
    ("load_rate2", "f8", "1/s^2"),  # its squared rate, lagged
    ("flow2", "f8", "m^2/s^2"),  # squared flow, lagged
    ("offset", "f8", "m"),  # learned rod - arm surface
    ("offset_time", "f8", "s"),  # so far learned on
    ("u_fast", "f8", "-"),  # valve command behind a high-pass
    ("high", "f8", (2,)),  # of the high-pass
    ("clock", "f8", "s"),  # since the start
    ("V", "f8", (N, 4)),
    ("enter", "f8", (N,)),  # flows that enter at this tick, 0 for what enters as a force
    ("S", "f8", (SENSORS, N)),  # signatures of this tick
    ("e", "f8", (SENSORS,)),  # innovations, less what the learned errors explain
    ("s", "f8", (SENSORS,)),  # their variances; 0: no sample
    ("lost", "f8", "s"),  # since the last position sample
    ("lost_pressure", "f8", "s"),
]

NOISE = {
    "q": (1e-12, 2e-6, 2e-5, 6e-4),
    "r": (1e-8, 1.1e-8, 2.5e-5),  # 0.1 mm, 0.02 deg on 0.30 m, 0.5 % of supply: sensor set `transport`
    "P0": (1e-8, 1e-6, 1e-4, 1e-2),
    "load_share": 0.2,
    "flow_share": 0.006,
    "share": 0.03,
    # tolerances of 5 % of every parameter (uniform, some of them in one column); friction of 1 % of the stall force
    "prior_mean": (0.0, -0.05, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "prior_sd": (0.002, 0.06, 0.035, 0.006, 0.05, 0.012, 0.0003, 1e-12, 0.05, 0.05),
}


def high_pass(dt: float) -> dict:
    """Return the PARAMS fields of the high-pass, a Butterworth filter of second order."""
    k = math.tan(math.pi * min(CORNER_HZ * dt, CORNER_MOST))
    norm = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    return {"high_b": (norm, -2.0 * norm, norm),
            "high_a": (2.0 * (k * k - 1.0) * norm, (1.0 - math.sqrt(2.0) * k + k * k) * norm)}  # fmt: skip


@kernel
def load_model(x, u, p):
    """Return the load that the hinge-moment model foresees at the estimated position, over the stall force [1]."""
    return (u.hm0_model + u.hmd_model * x.x_hat[0] / p.arm) / (p.arm * p.A_p * p.P_s)


@kernel
def start(x, q, dp, u, p):
    """Begin at the measurement, at rest, in equilibrium with the load."""
    x.x_hat[0], x.x_hat[1], x.x_hat[2], x.x_hat[3] = q, 0.0, dp, -dp
    for i in range(4):
        for j in range(4):
            x.P[i, j] = 0.0
        x.P[i, i] = p.P0[i]
    for i in range(N):
        for j in range(4):
            x.V[i, j] = 0.0
    x.load_last = load_model(x, u, p)
    x.load_rate2 = x.flow2 = 0.0
    x.lost = x.lost_pressure = 0.0
    x.started = 1.0


@kernel
def measure(x, j, y, mu, p):
    """Take sensor `j`; write its cleaned innovation, its variance and the signatures."""
    row = 2 if j == 2 else 0
    P = x.P
    s = P[row, row] + p.r[j]
    e = y - x.x_hat[row]
    limit = GATE * math.sqrt(s)
    e = min(max(e, -limit), limit)
    for i in range(4):
        x.K[i] = P[i, row] / s
    for i in range(4):
        x.x_hat[i] += x.K[i] * e
    clean = e
    for c in range(N):
        S = x.V[c, row]
        x.S[j, c] = S
        clean -= mu[c] * S
        for i in range(4):
            x.V[c, i] -= x.K[i] * S
    for a in range(4):  # K is optimal: P - K s K'
        for b in range(a + 1):
            P[a, b] -= x.K[a] * x.K[b] * s
            P[b, a] = P[a, b]
    # where the command drives the innovations most the model's own error does, too
    x.e[j], x.s[j] = clean, s + p.share * p.share * x.S[j, GAIN] * x.S[j, GAIN]


@kernel
def measurement_update(x, u, mu, learn, p, dt):
    """Take what is valid of rod, surface and pressure."""
    for j in range(SENSORS):
        x.s[j] = 0.0
    x.lost += dt
    x.lost_pressure += dt
    rod = u.y_rod_valid > 0.5 and math.isfinite(u.y_rod)
    surface = u.y_surface_valid > 0.5 and math.isfinite(u.y_surface)
    if rod:
        measure(x, ROD, u.y_rod, mu, p)
        x.lost = 0.0
    if surface:
        y = p.arm * u.y_surface
        if rod and x.offset_time < 1.0:
            x.offset_time += dt
            x.offset += (u.y_rod - y - x.offset) * dt / x.offset_time
        elif rod and learn:
            x.offset += (u.y_rod - y - x.offset) * dt / RIGGING_TAU
        if x.offset_time > 0.0:
            measure(x, SURFACE, y + x.offset, mu, p)
            x.lost = 0.0
    if u.y_dp_valid > 0.5 and math.isfinite(u.y_dp):
        measure(x, PRESSURE, u.y_dp, mu, p)
        x.lost_pressure = 0.0


@kernel
def predict(x, u, v, p, dt):
    """Predict over one tick under the held valve command `v`, and what the columns add meanwhile."""
    n = max(math.ceil(dt / STEP_MOST - 1e-6), 1)
    h = dt / n
    fast = p.high_b[0] * v + x.high[0]
    x.high[0] = p.high_b[1] * v - p.high_a[0] * fast + x.high[1]
    x.high[1] = p.high_b[2] * v - p.high_a[1] * fast
    x.u_fast = fast
    model = load_model(x, u, p)
    rate = (model - x.load_last) / dt
    a = 1.0 - math.exp(-dt / RATE_TAU)
    x.load_rate2 += a * (rate * rate - x.load_rate2)
    for _ in range(n):
        q, w, z = x.x_hat[0], x.x_hat[1], x.x_hat[2]
        root = opening(v, z)
        gain = p.phi_n / p.A_p
        flow = gain * root * v
        k = lu17.stiffness(q, p)
        x.flow2 += a / n * (flow * flow - x.flow2)
        transition(x.Phi, x.G, x.x_hat, v, v, 0.0, 0.0, True, p, h)
        Phi, G, V = x.Phi, x.G, x.V
        unit = 1.0 / (gain * max(root, lu17.ROOT_FLOOR))  # of G: a flow of 1 m/s for a tick
        F = p.A_p * p.P_s * x.x_hat[3]
        fast_flow, most = gain * root * fast, max(root, 0.3)
        enter = x.enter
        enter[LEAK] = -z
        enter[SOFT] = flow - p.L * z - w
        enter[SUPPLY] = -0.5 * gain * v / most
        enter[OFFSET] = p.L + 0.5 * gain * math.fabs(v) / most
        enter[FLOW] = 1.0
        enter[SLOPE] = x.clock
        enter[FAST] = fast_flow
        enter[GAIN] = flow - fast_flow
        for c in range(N):
            a0, a1, a2, a3 = V[c, 0], V[c, 1], V[c, 2], V[c, 3]
            s = unit * enter[c]
            V[c, 0] = Phi[0, 0] * a0 + Phi[0, 1] * a1 + Phi[0, 2] * a2 + Phi[0, 3] * a3 + G[0] * s
            V[c, 1] = Phi[1, 0] * a0 + Phi[1, 1] * a1 + Phi[1, 2] * a2 + Phi[1, 3] * a3 + G[1] * s
            V[c, 2] = Phi[2, 0] * a0 + Phi[2, 1] * a1 + Phi[2, 2] * a2 + Phi[2, 3] * a3 + G[2] * s
        rub, inertia = -math.tanh(w / CREEP), -(z + x.x_hat[3])
        for i in range(3):
            V[FRICTION, i] += Phi[i, 3] * rub
            V[MASS, i] += Phi[i, 3] * inertia
        x.x_hat[0], x.x_hat[1], x.x_hat[2] = rk4(q, w, z, v, v, 0.0, F, p, h)
        congruence(x.P, Phi, x.W)
        x.P[0, 0] += p.q[0] * h
        x.P[1, 1] += p.q[1] * h
        x.P[2, 2] += (p.q[2] + k * k * p.flow_share * p.flow_share * x.flow2 * RATE_TAU) * h
        x.P[3, 3] += (p.q[3] + p.load_share * p.load_share * x.load_rate2 * RATE_TAU) * h
    x.clock += dt
    now = load_model(x, u, p)
    x.x_hat[3] += now - x.load_last if math.fabs(now - x.load_last) < 1.0 else 0.0
    x.load_last = now


@kernel
def advance(x, u, mu, learn, p, dt):
    """Run the filter for one tick on measurements that are `delay` ticks old; return whether it runs."""
    for i in range(HISTORY, 0, -1):
        x.u_old[i] = x.u_old[i - 1]
    if math.isfinite(u.u):
        x.u_old[0] = min(max(u.u, -1.0), 1.0)
    if x.started < 0.5:
        if u.y_rod_valid > 0.5 and math.isfinite(u.y_rod):
            start(x, u.y_rod, u.y_dp if u.y_dp_valid > 0.5 and math.isfinite(u.y_dp) else 0.0, u, p)
        else:
            return False
    d = int(p.delay)
    if d == 0:
        predict(x, u, x.u_old[0], p, dt)
        measurement_update(x, u, mu, learn, p, dt)
    else:
        measurement_update(x, u, mu, learn, p, dt)
        predict(x, u, x.u_old[d - 1], p, dt)
    return True
