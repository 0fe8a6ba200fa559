"""The servo of the hydraulic actuator: reference model, nonlinear dynamic inversion of relative degree 3, observer.

The valve first appears in q''', so that ([Lu17] (13) with r = 3; with the printed r = 2 it divides by zero)

    a    = (A_p P_s x3 - B q' + F_d) / M
    nu   = r''' + k_a (r'' - a) + k_v (r' - q') + k_q (r - q)
    w    = (nu - L_f^3 h) / (stiffness(q) phi_n P_s / M),    L_f^3 h = A_p P_s / M stiffness(q) (-L x3 - q') - B / M a
    u    = w / sqrt(1 - sign(w) x3),   |u| <= u_max

The sign is that of the demanded flow w; the root is kept above ROOT_LEAST, where the actuator is near its stall. The
error poles are three at 25 rad/s, placed for the sampled actuator at q = 0 (u held over the tick). There is no
integrator: the load comes from the observer, the leakage is in the model. 1 mm of rod error asks for 0.004 of u.

Feedback. The servo's own observer runs always: state (q, q', x3, F), nonlinear prediction by (4), F a random walk
that takes up hinge load, friction, stops and sensor bias alike; steady Kalman gains for rod and differential
pressure, or for the rod alone while the pressure is invalid. Measurements are `delay` ticks old (0 or 1): the
observer corrects the past and predicts to now. An estimate from outside replaces it, quantity by quantity, where its
flag is 1 (and the number is finite); it is of this tick.

INPUTS f_cmd, s_cmd: command-level faults, delta_c = (1 - s_cmd) command + f_cmd.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage, reference
from actuators.common.limits import clip
from actuators.deterministic_linalg import place, rounded
from actuators.ema import jay
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic import lu17
from actuators.kernels import cached_array

PARAMS = dtype([
    *reference.PARAM_FIELDS,  # unit: m of rod
    *lu17.FIELDS,  # the servo's model of the actuator
    ("arm", "f8"),  # linkage arm [m]
    ("r_lo", "f8"),  # lowest rod command [m]
    ("r_hi", "f8"),  # highest rod command [m]
    ("u_max", "f8"),  # limit of the valve command [1]
    ("k_q", "f8"),  # position error to jerk [1/s^3]
    ("k_v", "f8"),  # velocity error to jerk [1/s^2]
    ("k_a", "f8"),  # acceleration error to jerk [1/s]
    ("K", "f8", (4, 2)),  # observer gain of rod [1] and pressure [m, m/s, 1, N]
    ("K_rod", "f8", (4,)),  # observer gain of the rod alone
    ("F_max", "f8"),  # limit of the load estimate [N]
    ("delay", "f8"),  # age of the measurements [ticks], 0 or 1
])
INPUTS = dtype([
    ("command", "f8"),  # surface command, trailing edge down + [rad]
    ("f_cmd", "f8"),  # fault: added to the command [rad]
    ("s_cmd", "f8"),  # fault: share of the command replaced [0..1]
    ("q_meas", "f8"),  # measured rod position [m]
    ("q_valid", "f8"),  # 1 where it is valid
    ("x3_meas", "f8"),  # measured pressure difference over supply [1]
    ("x3_valid", "f8"),  # 1 where it is valid
    ("q_fb", "f8"),  # rod position from outside [m]
    ("q_use", "f8"),  # 1: use it
    ("qd_fb", "f8"),  # rod velocity from outside [m/s]
    ("qd_use", "f8"),  # 1: use it
    ("x3_fb", "f8"),  # pressure difference from outside [1]
    ("x3_use", "f8"),  # 1: use it
    ("load_fb", "f8"),  # load on the rod from outside, + extends [N]
    ("load_use", "f8"),  # 1: use it
])
STATE = dtype([
    ("u", "f8", "-"),  # valve command
    ("delta_c", "f8", "rad"),  # surface command after faults and limits
    *reference.state_fields("m"),  # rod reference and derivatives
    ("q", "f8", "m"),  # rod position that the loop closes on
    ("qd", "f8", "m/s"),  # rod velocity that it closes on
    ("x3", "f8", "-"),  # pressure difference that it closes on
    ("load", "f8", "N"),  # load that it closes on
    ("q_hat", "f8", "m"),  # observer: rod position
    ("qd_hat", "f8", "m/s"),  # observer: rod velocity
    ("x3_hat", "f8", "-"),  # observer: pressure difference
    ("load_hat", "f8", "N"),  # observer: load
])
OUTPUTS = ("u", "delta_c", "r", "rd", "rdd", "q", "qd", "x3", "load")

ROOT_LEAST = 0.2
POLE = 25.0  # [rad/s]
# sensor set `transport` (1 sigma per sample), and how fast the unknown may move
SIGMA_ROD, SIGMA_PRESSURE = 1e-4, 0.005  # [m], [1]
WALK_LOAD, WALK_PRESSURE, WALK_VELOCITY = 5e3, 0.1, 0.01  # per root second [N], [1], [m/s]


def params(
    *,
    dt: float = 0.005,
    pole: float = POLE,
    omega: float = 45.0,
    zeta: float = 0.8,
    delay: float = 1.0,
    arm: float = linkage.ARM,
    travel: tuple[float, float] = linkage.TRAVEL,
    **values: Any,
) -> np.ndarray:
    """Return PARAMS of shape (1,) for the tick `dt`, linkage `arm` [m] and the surface's stops `travel` [rad]; `values`
    replace fields, unknown names raise ValueError.

    Rod velocity is commanded up to 40 of the 45 deg/s, acceleration to a third of the stall force on M, jerk to what
    0.1 of u gives at rest; commands end 0.1 deg inside the stops.
    """
    model = hydraulic.params(**{k: v for k, v in values.items() if k in lu17.NOMINAL})[0]
    force = model.A_p * model.P_s
    fields = {
        **{name: model[name] for name in lu17.NOMINAL},
        **reference.gains(omega=omega, zeta=zeta, dt=dt),
        "v_max": linkage.rod(math.radians(40.0), arm),
        "a_max": force / model.M / 3,
        "j_max": 0.1 * 2 * model.E * model.A_p * model.phi_n / (model.V_m * model.M),
        "arm": arm,
        "r_lo": linkage.rod(travel[0] + math.radians(0.1), arm),
        "r_hi": linkage.rod(travel[1] - math.radians(0.1), arm),
        "u_max": hydraulic.NOMINAL["u_max"],
        **gains(model, pole=pole, dt=dt),
        "F_max": 3 * force,
        "delay": delay,
    }
    return record(PARAMS, **{**fields, **values})


def init_at(p: np.ndarray, delta: Any = 0.0, load: Any = 0.0) -> np.ndarray:
    """Return the state at rest at surface angle `delta` [rad] against a rod `load` [N]; both broadcast over p."""
    x = np.zeros(p.shape, STATE)
    x["delta_c"] = delta
    x["r"] = x["q"] = x["q_hat"] = linkage.rod(x["delta_c"], p["arm"])
    x["load"] = x["load_hat"] = load
    x["x3"] = x["x3_hat"] = -x["load"] / (p["A_p"] * p["P_s"])
    x["u"] = hydraulic.holding(p, x["x3"])
    return x


@kernel
def _good(v, flag):
    """Return whether a flagged number can be used: its flag is up and it is finite and of sane size."""
    return flag > 0.5 and abs(v) < 1e9


@kernel
def _either(v, flag, other):
    """Return v where it can be used, else `other`."""
    return v if _good(v, flag) else other


@kernel
def _correct(x, u, p):
    """Correct the observer by the measurements that are valid; without a rod position there is no correction."""
    e_q = u.q_meas - x.q_hat
    e_3 = _either(u.x3_meas, u.x3_valid, x.x3_hat) - x.x3_hat
    both = _good(u.x3_meas, u.x3_valid)
    if _good(u.q_meas, u.q_valid):
        x.q_hat += (p.K[0, 0] if both else p.K_rod[0]) * e_q + p.K[0, 1] * e_3
        x.qd_hat += (p.K[1, 0] if both else p.K_rod[1]) * e_q + p.K[1, 1] * e_3
        x.x3_hat += (p.K[2, 0] if both else p.K_rod[2]) * e_q + p.K[2, 1] * e_3
        x.load_hat += (p.K[3, 0] if both else p.K_rod[3]) * e_q + p.K[3, 1] * e_3
    x.q_hat = clip(x.q_hat, 2.0 * p.r_lo, 2.0 * p.r_hi)
    x.qd_hat = clip(x.qd_hat, -1.0, 1.0)  # the speed of the unloaded rod at u = 1
    x.x3_hat = clip(x.x3_hat, -3.0, 3.0)
    x.load_hat = clip(x.load_hat, -p.F_max, p.F_max)


@kernel
def _predict(x, p, dt):
    """Carry the observer over one tick with the last valve command."""
    x.q_hat, x.qd_hat, x.x3_hat = lu17.rk4(x.q_hat, x.qd_hat, x.x3_hat, x.u, x.u, 0.0, x.load_hat, p, dt)


@kernel
def _feedback(x, u, p, dt):
    """Choose what the loop closes on: the observer, or what is given from outside."""
    x.q = _either(u.q_fb, u.q_use, x.q_hat)
    x.qd = _either(u.qd_fb, u.qd_use, x.qd_hat)
    x.x3 = _either(u.x3_fb, u.x3_use, x.x3_hat)
    x.load = _either(u.load_fb, u.load_use, x.load_hat)


@kernel
def _invert(x, p, dt):
    """Return the valve command that gives the demanded q'''. [Lu17] (13), r = 3

    u is held over the tick: L_f^3 h is taken where the reference will have carried velocity and pressure at its middle.
    """
    a = (p.A_p * p.P_s * x.x3 - p.B * x.qd + x.load) / p.M
    nu = x.rddd + p.k_a * (x.rdd - a) + p.k_v * (x.rd - x.qd) + p.k_q * (x.r - x.q)
    drive = p.A_p * p.P_s / p.M * lu17.stiffness(x.q, p)
    qd = x.qd + 0.5 * dt * x.rdd
    x3 = x.x3 + 0.5 * dt * x.rddd * p.M / (p.A_p * p.P_s)
    lie = drive * (-p.L * x3 - qd) - p.B / p.M * a
    w = (nu - lie) / (drive * p.phi_n / p.A_p)
    return clip(w / max(lu17.opening(w, x.x3), ROOT_LEAST), -p.u_max, p.u_max)


@kernel
def step(x, u, p, dt):
    """Bring reference and observer to now and compute the valve command for the tick that starts."""
    reference.advance(x, dt)
    command = (1.0 - u.s_cmd) * u.command + u.f_cmd
    if abs(command) < 1e9:
        x.delta_c = clip(command, p.r_lo / p.arm, p.r_hi / p.arm)
    if p.delay > 0.5:
        _correct(x, u, p)
        _predict(x, p, dt)
    else:
        _predict(x, p, dt)
        _correct(x, u, p)
    _feedback(x, u, p, dt)
    target = p.arm * x.delta_c
    reference.demand(x, target, max(lu17.opening(target - x.r, x.x3), ROOT_LEAST), p)
    x.u = _invert(x, p, dt)


rollout = entry(step, STATE, INPUTS, PARAMS)


def gains(model: Any, *, pole: Any, dt: float) -> dict[str, Any]:
    """Return {k_q, k_v, k_a} for which the sampled linear loop has its poles at -pole, 0.97 pole and 1.03 pole, and
    {K (4, 2), K_rod (4,)}, steady Kalman gains of (q, q', x3, F), linear at rest and centre."""
    given = model.dtype.descr, model.tolist(), pole, dt
    every = cached_array(
        given, float, lambda: np.concatenate([_error_gains(model, pole, dt), *_observer_gains(model, dt)]), __file__
    )
    return {"k_q": every[0], "k_v": every[1], "k_a": every[2], "K": every[3:11].reshape(4, 2), "K_rod": every[11:]}


def _error_gains(model, pole, dt):
    """Return (k_q, k_v, k_a): (13) in linear form is u = -K (q, q', x3), K follows from pole placement, the gains from
    comparing coefficients."""
    A, B = lu17.linear(model)
    Phi, Gamma = jay.discretise(A, B, dt)
    K = rounded(place(Phi, Gamma, np.exp(-pole * dt * np.array([0.97, 1.0, 1.03]))), 10)
    a23, beta, k = A[1, 2], model.B / model.M, -A[2, 1]
    D = a23 * k * model.phi_n / model.A_p  # u to the jerk of the rod [m/s^3]
    k_a = beta + (K[2] * D / (a23 * k) + model.L) * k
    return D * K[0], D * K[1] + a23 * k + (k_a - beta) * beta, k_a


def _observer_gains(model, dt):
    from scipy.linalg import expm, solve_discrete_are  # a tenth of a second that a start need not wait for

    A, out = np.zeros((4, 4)), []
    A[:3, :3] = lu17.linear(model)[0]
    A[1, 3] = 1.0 / model.M
    scale = np.diag([1e-3, 1e-2, 1e-1, 1e3])  # the Riccati solver wants entries of one size
    inverse = np.linalg.inv(scale)
    Phi = inverse @ expm(A * dt) @ scale
    Q = np.diag(np.array([1e-6, WALK_VELOCITY, WALK_PRESSURE, WALK_LOAD]) ** 2 * dt)
    for rows in ([0, 2], [0]):
        H, R = scale[rows], np.diag(np.array([SIGMA_ROD, 1.0, SIGMA_PRESSURE])[rows] ** 2)
        P = solve_discrete_are(Phi.T, H.T, inverse @ Q @ inverse, R)
        out.append(scale @ P @ H.T @ np.linalg.inv(H @ P @ H.T + R))
    return rounded(out[0].ravel(), 9), rounded(out[1][:, 0], 9)
