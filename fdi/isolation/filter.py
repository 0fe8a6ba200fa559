"""The filter without a fault state of a hydraulic actuator, and what model errors leave in its innovations.

A Kalman filter of x = (q, q', z, F): rod [m, m/s], pressure over supply, load over the stall force, with the nominal
parameters of [Lu17] (4). Rod, surface and pressure are taken one after the other; the load follows the increments of
the hinge-moment model and a random walk so tight that a pressure sensor's fault and a valve's differ in the force
equation. An error theta of the model enters the innovations as e = S theta; its signature S goes through the filter:

    V <- Phi V + (what enters),    S_j = V_j (+ what enters at sensor j),    V <- V - K_j S_j        [Willsky76]

| column | enters | theta |
|---|---|---|
| AGE | position sensors, by what the rod moves in a tick | ticks by which their samples are older |
| OLDER | pressure sensor, by its change over the last tick | share of the sample before |
| YOUNGER | pressure sensor, by its change over the next tick | share of the sample after |
| MASS | force -(z + F) | share by which the moving mass is larger [1] |
| OFFSET | flow of the valve and the leak per pressure | error of the pressure sensor that the load has taken up [1] |
| SCALE | pressure sensor, by the model's pressure | share by which its reading is larger [1] |
| SOFT | flow, what compresses the oil | share by which the oil is stiffer [1] |
| SUPPLY | flow -u / (2 root) | share of the supply that is lost [1] |
| FRICTION | force -q' / (CREEP + abs q') | friction over the stall force [1] |
| LEAK | flow -z | added leakage [m/s] |
| FLOW | flow 1 | constant flow [m/s] |
| FAST | flow root u, of u above CORNER | share of the fast part, noise of the servo's sensors, that passes more [1] |
| GAIN | flow root u, of u below CORNER | share by which the valve passes more [1] |
| APART | surface sensor, by 1 | what the lever as learned does not put rod and surface apart by [m] |
| HINGE | load, by the change of the model's | share by which the hinge moment is larger than its model [1] |

The pressure follows the noise in the valve command from tick to tick: its samples of other ticks are columns of their
own. By how much the surface's samples are older than the rod's is learned with the lever (`fdi.common.decision`).
"""

import math

from actuators.block import kernel
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import opening
from fdi.common.decision import LEVER_STATE, RIGGING_SD, forget_lever, learn_lever, lever_at, usable
from fdi.common.linalg import congruence, diagonal
from fdi.hydraulic.two_stage_ekf import STEP_MOST, load_model, transition

ROD, SURFACE, PRESSURE = range(3)
SENSORS = 3
AGE, OLDER, YOUNGER, MASS, OFFSET, SCALE, SOFT, SUPPLY, FRICTION, LEAK, FLOW, FAST, GAIN, APART, HINGE = range(15)
N = 15  # columns
TIMING = 3  # of them
ROWS = (0, 0, 2)  # state that each sensor reads
CORNER_HZ, CORNER_MOST = 25.0, 0.3  # an oscillation of up to 10 Hz stays below; share of the rate
CREEP = 3e-3  # friction turns round within this velocity [m/s]
TEACHES = 0.7  # of what rod and surface may be apart: beyond it nothing is learned of the lever
MOVES = 0.02  # rod velocity from which on the lag is learned: many deviations of its estimate [m/s]
SETTLES_S = 1.0  # the filter settles [s]
FEED_TAU = 2.0  # slower than the filter forgets, so that a signature holds for the errors of some while ago, too [s]
MODEL_TAU = 0.2  # within which friction and inertia of the model's pressure are forgotten [s]
RATE_TAU = 0.1  # for so long a fast load or flow leaves the model in doubt [s]
LEANS = 0.3  # random walk of the load while a stop takes part of it [1/s]
ROOT_LEAST = 0.3  # of the valve's opening where it divides: the supply's column is linear there no more
GATE = 25.0  # of an innovation: beyond so many sigma of a healthy one a sample counts for no more
# Beyond WILD sigma the first `spikes` samples within a second are not taken: one would do for a noisy sensor. A sample
# that rises from one before it, of RISES of it, is of an oscillation or of a load
WILD, RISES = 10.0, 0.4

PARAMS = [
    ("h_q", "f8", (4,)),  # process noise densities of x [unit^2/s]
    ("h_r", "f8", (SENSORS,)),  # variances of a sample of rod [m^2], surface as a rod [m^2], pressure [1]
    ("h_P0", "f8", (4,)),  # initial variances
    ("load_share", "f8", "-"),  # of the hinge-moment model's rate, that it may err by
    ("flow_share", "f8", "-"),  # of the flow, that the valve's equation may err by beyond what the columns say
    ("share", "f8", "-"),  # of the gain's signature, that no column explains
    ("high_b", "f8", (3,)),  # numerator of the high-pass
    ("high_a", "f8", (2,)),  # denominator, the leading one left out
    ("prior_mean", "f8", (N,)),
    ("prior_sd", "f8", (N,)),
]
STATE = [
    ("h_started", "f8", "-"),  # 1 after the first usable rod sample
    ("h_hat", "f8", (4,), "m, m/s, -, -"),  # estimate at the time of the measurement
    ("h_P", "f8", (4, 4)),
    ("h_Phi", "f8", (4, 4)),  # of one prediction, about the estimate
    ("h_G", "f8", (4,)),
    ("h_W", "f8", (4, 4)),  # scratch
    ("load_last", "f8", "-"),  # load by the hinge-moment model, one tick ago
    ("load_rate2", "f8", "1/s^2"),  # its squared rate, lagged
    ("flow2", "f8", "m^2/s^2"),  # squared flow, lagged
    ("u_fast", "f8", "-"),  # valve command behind a high-pass
    ("high", "f8", (2,)),  # of the high-pass
    ("h_clock", "f8", "s"),  # since the start
    ("h_V", "f8", (4, N)),  # response of each state to each column
    ("h_S", "f8", (SENSORS, N)),  # signatures of this tick
    ("h_turn", "f8", (TIMING,), "m, -, -"),  # what a tick more or less of age makes of a reading
    ("h_aged", "f8", (SENSORS,)),  # what the learned ages make of it
    ("h_past", "f8", (3, N)),  # response of rod and pressure a tick ago
    ("h_step", "f8", "m"),  # change of the rod over the last tick
    ("h_rise", "f8", "-"),  # of the pressure
    ("h_push", "f8", "s/m"),  # change of the pressure per flow
    *LEVER_STATE,
    ("h_z", "f8", "-"),  # pressure by the model alone: what flow and force make of it, slowly drawn to the load's
    ("fed", "f8", (N,)),  # learned errors that the prediction has taken up, lagged by FEED_TAU
    ("h_e", "f8", (SENSORS,)),  # innovations, less what the learned errors explain
    ("h_s", "f8", (SENSORS,)),  # their variances; 0: no sample
    ("h_lost", "f8", (SENSORS,), "s"),  # since the last sample of each
    ("h_before", "f8", (SENSORS,), "-"),  # innovation of the last sample of each, taken or not, over its sigma
    ("h_wild", "f8", (SENSORS,)),  # samples beyond WILD, of the last second
]

NOISE = {
    "h_q": (1e-12, 2e-6, 2e-5, 6e-4),
    "h_r": (1e-8, 1.1e-8, 2.5e-5),  # 0.1 mm, 0.02 deg on 0.30 m, 0.5 % of supply: sensor set `transport`
    "h_P0": (1e-8, 1e-6, 1e-4, 1e-2),
    "load_share": 0.2,
    "flow_share": 0.006,
    "share": 0.03,
    # tolerances of 5 % of every parameter (uniform, some of them in one column); friction of 1 % of the stall force
    "prior_mean": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.05, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    # a tick of age; mass: and friction at rest, which holds as one of 10 to 20 % would while the rod hardly moves
    "prior_sd": (1.0, 1.0, 1.0, 0.1, 0.012, 0.002, 0.06, 0.035, 0.006, 0.002, 0.0003, 0.05, 0.05, 1e-6, 0.12),
}


def high_pass(dt: float) -> dict:
    """Return the PARAMS fields of the high-pass, a Butterworth filter of second order."""
    from scipy.signal import butter  # 60 MB and half a second that a page need not wait for

    b, a = butter(2, min(CORNER_HZ, CORNER_MOST / dt), "highpass", fs=1.0 / dt)
    return {"high_b": b, "high_a": a[1:]}


@kernel
def start(x, q, dp, u, p):
    """Begin at the measurement, at rest, in equilibrium with the load."""
    x.h_hat[0], x.h_hat[1], x.h_hat[2], x.h_hat[3] = q, 0.0, dp, -dp
    diagonal(x.h_P, p.h_P0)
    x.h_V[:] = 0.0
    x.load_last = load_model(x.h_hat[0], u, p)
    x.h_z = -x.load_last
    x.load_rate2 = x.flow2 = x.h_step = x.h_rise = x.h_push = 0.0
    x.h_lost[:] = x.h_before[:] = x.h_wild[:] = 0.0
    if x.lever_P[2] <= 0.0:
        forget_lever(x)
    x.h_started = 1.0


@kernel
def measure(x, j, y, mu, p):
    """Take sensor `j`; write its cleaned innovation, its variance and the signatures."""
    row = 2 if j == PRESSURE else 0
    P, V, S = x.h_P, x.h_V, x.h_S[j]
    s = P[row, row] + p.h_r[j]
    limit = GATE * math.sqrt(s)
    e = min(max(y - x.h_aged[j] - x.h_hat[row], -limit), limit)
    x.h_lost[j] = 0.0
    older = x.fed[OLDER if j == PRESSURE else AGE]
    for c in range(N):
        S[c] = V[row, c] + older * (x.h_past[row, c] - V[row, c])
    if j == PRESSURE:
        S[SCALE] += x.h_z + x.h_aged[j]  # the estimate of z has the noise of the innovations before this one
        S[OLDER] += x.h_turn[OLDER]
        S[YOUNGER] += x.h_turn[YOUNGER]
    else:
        S[AGE] += x.h_turn[AGE]
        S[APART] += 1.0 if j == SURFACE else 0.0
    explained = 0.0
    for c in range(N):
        explained += (mu[c] - x.fed[c]) * S[c]
    K = (P[0, row] / s, P[1, row] / s, P[2, row] / s, P[3, row] / s)
    for a in range(4):  # K is optimal: P - K s K'
        x.h_hat[a] += K[a] * e
        for c in range(N):
            V[a, c] -= K[a] * S[c]
        for b in range(a + 1):
            P[a, b] -= K[a] * K[b] * s
            P[b, a] = P[a, b]
    # where the command drives the innovations most the model's own error does, too
    x.h_e[j], x.h_s[j] = e - explained, s + p.share * p.share * S[GAIN] * S[GAIN]


@kernel
def wild(x, j, y, p, dt):
    """Return whether the sample `y` of sensor `j` is so far from its prediction, so suddenly, that it is not taken."""
    row = 2 if j == PRESSURE else 0
    e, before = (y - x.h_aged[j] - x.h_hat[row]) / math.sqrt(x.h_P[row, row] + p.h_r[j]), x.h_before[j]
    x.h_before[j] = e
    if math.fabs(e) <= WILD:
        x.h_wild[j] = max(x.h_wild[j] - p.spikes * dt, 0.0)  # a second without: a large oscillation has no such
        return False
    rises = before > RISES * e if e > 0.0 else before < RISES * e
    if x.h_wild[j] == 0.0 and rises:
        x.h_wild[j] = p.spikes
    x.h_wild[j] = min(x.h_wild[j] + 1.0, 2.0 * p.spikes)
    return x.h_wild[j] <= p.spikes


@kernel
def turn(x, v, p, dt):
    """Write what a tick more or less of age makes of the readings, with valve command `v` over the next one."""
    w, z, F = x.h_hat[1], x.h_hat[2], x.h_hat[3]
    net = p.phi_n / p.A_p * opening(v, z) * v - p.L * z - w
    x.h_turn[AGE], x.h_turn[OLDER] = -x.h_step, -x.h_rise
    if p.delay > 0.0:  # no sample is of the future
        x.h_turn[YOUNGER] = math.ceil(dt / STEP_MOST - 1e-6) * (x.h_Phi[2, 3] * (z + F) + x.h_push * net)
    x.h_aged[ROD] = x.h_aged[SURFACE] = x.fed[AGE] * x.h_turn[AGE]
    x.h_aged[PRESSURE] = x.fed[OLDER] * x.h_turn[OLDER] + x.fed[YOUNGER] * x.h_turn[YOUNGER]


@kernel
def measurement_update(x, u, v, mu, p, dt):
    """Take what is valid, and not wild, of rod, surface and pressure."""
    turn(x, v, p, dt)
    for j in range(SENSORS):
        x.h_s[j] = 0.0
        x.h_lost[j] += dt
    rod = usable(u.y_rod, u.y_rod_valid) > 0.5 and not wild(x, ROD, u.y_rod, p, dt)
    if rod:
        measure(x, ROD, u.y_rod, mu, p)
    surface, y = usable(u.y_surface, u.y_surface_valid) > 0.5, p.arm * u.y_surface
    if surface and x.lever_P[0] < RIGGING_SD * RIGGING_SD:
        surface = not wild(x, SURFACE, y + lever_at(x, x.h_hat[0], x.h_step), p, dt)
    if surface:
        if rod and x.sensor < 0.5 and math.fabs(x.pair_d) < TEACHES * x.pair_limit:
            moves = x.h_step if math.fabs(x.h_step) > MOVES * dt else 0.0
            learn_lever(x, u.y_rod - y, x.h_hat[0], moves, p.h_r[ROD] + p.h_r[SURFACE], dt)
        if x.lever_P[0] < RIGGING_SD * RIGGING_SD:
            measure(x, SURFACE, y + lever_at(x, x.h_hat[0], x.h_step), mu, p)
    if usable(u.y_dp, u.y_dp_valid) > 0.5 and not wild(x, PRESSURE, u.y_dp, p, dt):
        measure(x, PRESSURE, u.y_dp, mu, p)


@kernel
def enters(V, c, much, g0, g1, g2):
    """Let `much` of what moves the first three states by (g0, g1, g2) enter column `c`."""
    V[0, c] += g0 * much
    V[1, c] += g1 * much
    V[2, c] += g2 * much


@kernel
def predict(x, u, v, mu, p, dt):
    """Predict over one tick under the held valve command `v`, in steps of STEP_MOST at most."""
    fast = p.high_b[0] * v + x.high[0]
    x.high[0] = p.high_b[1] * v - p.high_a[0] * fast + x.high[1]
    x.high[1] = p.high_b[2] * v - p.high_a[1] * fast
    x.u_fast = fast
    model = load_model(x.h_hat[0], u, p)
    rate = (model - x.load_last) / dt
    x.load_rate2 += min(dt / RATE_TAU, 1.0) * (rate * rate - x.load_rate2)
    feed = min(dt / FEED_TAU, 1.0)
    for c in (AGE, OLDER, YOUNGER, SOFT, SUPPLY, FAST, GAIN, HINGE):
        x.fed[c] += feed * (mu[c] - x.fed[c])
    n = max(math.ceil(dt / STEP_MOST - 1e-6), 1)
    q, z = x.h_hat[0], x.h_hat[2]
    for c in range(N):
        x.h_past[0, c], x.h_past[2, c] = x.h_V[0, c], x.h_V[2, c]
    for _ in range(n):
        advance_state(x, v, fast, model, p, dt / n)
    x.h_step, x.h_rise = x.h_hat[0] - q, x.h_hat[2] - z
    x.h_clock += dt
    now = load_model(x.h_hat[0], u, p)
    change = now - x.load_last if math.fabs(now - x.load_last) < 1.0 else 0.0
    x.h_hat[3] += (1.0 + x.fed[HINGE]) * change
    x.h_V[3, HINGE] += change
    x.load_last = now


@kernel
def advance_state(x, v, fast, model, p, dt):
    """Predict state, covariance and columns over a step under valve command `v`, `fast` of which is above CORNER."""
    Phi, G, V, fed, hat = x.h_Phi, x.h_G, x.h_V, x.fed, x.h_hat
    flow_gain = transition(Phi, G, hat, v, v, 0.0, 0.0, True, p, dt)
    w, z, F = hat[1], hat[2], hat[3]
    root, gain, k = opening(v, z), p.phi_n / p.A_p, lu17.stiffness(hat[0], p)
    flow, fast_flow = gain * root * v, gain * root * fast
    x.flow2 += min(dt / RATE_TAU, 1.0) * (flow * flow - x.flow2)
    stiff = fed[SOFT]
    unit = (1.0 + stiff) / max(flow_gain, gain * lu17.ROOT_FLOOR)  # of G: a flow of 1 m/s for a step
    g0, g1, g2 = unit * G[0], unit * G[1], unit * G[2]
    f03, f13, f23 = Phi[0, 3], Phi[1, 3], Phi[2, 3]
    swallowed = stiff / (1.0 + stiff) * g2  # by which Phi is that of other oil
    for c in range(N):
        a0, a1, a2, a3 = V[0, c], V[1, c], V[2, c], V[3, c]
        for i in range(3):
            V[i, c] = Phi[i, 0] * a0 + Phi[i, 1] * a1 + Phi[i, 2] * a2 + Phi[i, 3] * a3
        V[2, c] -= swallowed * (a1 + p.L * a2)
    slope = 0.5 * gain * v / max(root, ROOT_LEAST)  # of the flow over the supply
    net = flow - p.L * z - w - fed[SUPPLY] * slope + fed[FAST] * fast_flow + fed[GAIN] * (flow - fast_flow)
    enters(V, LEAK, -z, g0, g1, g2)
    enters(V, SOFT, net, g0, g1, g2)
    enters(V, SUPPLY, -slope, g0, g1, g2)
    enters(V, OFFSET, p.L + math.fabs(slope), g0, g1, g2)
    enters(V, FLOW, 1.0, g0, g1, g2)
    enters(V, FAST, fast_flow, g0, g1, g2)
    enters(V, GAIN, flow - fast_flow, g0, g1, g2)
    enters(V, FRICTION, -w / (CREEP + math.fabs(w)), f03, f13, f23)
    enters(V, MASS, -(z + F), f03, f13, f23)
    # x + Psi x' with Psi of the same exponential: as exact as Phi, at a quarter of Runge-Kutta's cost
    pushed = z + F - p.B * w / (p.A_p * p.P_s)
    rise = f23 * pushed + g2 * net
    hat[0] += dt * w + f03 * pushed + g0 * net
    hat[1] += f13 * pushed + g1 * net
    hat[2] += rise
    x.h_push = g2
    x.h_z += rise - min(dt / MODEL_TAU, 1.0) * (x.h_z + model)
    congruence(x.h_P, Phi, x.h_W)
    in_doubt = k * k * p.flow_share * p.flow_share * x.flow2
    load = p.load_share * p.load_share * x.load_rate2 * RATE_TAU + LEANS * x.at_stop
    walk = (0.0, 0.0, in_doubt * RATE_TAU, load)
    for i in range(4):
        x.h_P[i, i] += (p.h_q[i] + walk[i]) * dt


@kernel
def advance(x, u, mu, p, dt):
    """Run the filter for one tick on measurements that are `delay` ticks old, under the valve commands `u_old`, newest
    first; return whether it runs."""
    if x.h_started < 0.5:
        if usable(u.y_rod, u.y_rod_valid) < 0.5:
            return False
        start(x, u.y_rod, u.y_dp if usable(u.y_dp, u.y_dp_valid) > 0.5 else 0.0, u, p)
    predict(x, u, x.u_old[int(p.delay)], mu, p, dt)
    measurement_update(x, u, x.u_old[max(int(p.delay) - 1, 0)], mu, p, dt)
    return True
