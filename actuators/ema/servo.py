"""The position servo of the electromechanical actuator: reference model, state feedback, integrator against the load.

    theta = y / l,   omega = (N / l) w,   J = J_M (l / N)^2 + J_N,   e = r - theta
    J alpha = K_T (l / N) i,
    alpha_d = r'' + k_v (r' - omega) + k_p e + z,   z' = k_i e
    i_d = J alpha_d / (K_T l / N),   |i_d| <= I_max
    u   = ((K_i K_c + R) i_d + K_B w) / (K_g K_i)

The last line undoes the droop of [Jay]'s proportional current loop. The three error poles are at `pole`, placed for
the sampled rigid actuator; position and velocity are `delay` ticks old and are carried over them by the acceleration
that was commanded last. The integrator stops while the current limit is reached on its side, and inside an
error of `dead` (0.006 deg), without which it would hunt across the friction. Reading: y, w; the current sensor closes
only the current loop inside `ema`. While the position is invalid it is integrated from the velocity, while the
velocity is invalid the reference's stands for it.

INPUTS f_cmd, s_cmd: command-level faults as in `servo`. s_rate, f_rate: the position demand runs away at (1 - s_rate)
r' + f_rate [rad/s] until the stop. `pos_fb` replaces the measured position where pos_use is 1 (reconfiguration).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage, reference
from actuators.common.limits import clip
from actuators.deterministic_linalg import place, rounded
from actuators.ema import jay

PARAMS = dtype([
    *reference.PARAM_FIELDS,  # unit: rad of surface
    ("arm", "f8"),  # l [m]
    ("ratio", "f8"),  # l / N, motor over surface [1]
    ("r_lo", "f8"),  # lowest command [rad]
    ("r_hi", "f8"),  # highest command [rad]
    ("k_p", "f8"),  # position error to acceleration [1/s^2]
    ("k_v", "f8"),  # rate error to acceleration [1/s]
    ("k_i", "f8"),  # integral [1/s^3]
    ("dead", "f8"),  # error that the integrator leaves [rad]
    ("amps", "f8"),  # current per acceleration, J N / (K_T l) [A s^2/rad]
    ("v_run", "f8"),  # largest rate of a demand that runs away: the drive's limits are left to end it [rad/s]
    ("I_max", "f8"),  # current limit [A]
    ("g_i", "f8"),  # demand per current, (K_ic + R) / K_gi [unit of u/A]
    ("g_w", "f8"),  # demand per motor rate, K_B / K_gi [unit of u s/rad]
    ("delay", "f8"),  # age of the measurements [ticks]
])
INPUTS = dtype([
    ("command", "f8"),  # surface command, trailing edge down + [rad]
    ("f_cmd", "f8"),  # fault: added to the command [rad]
    ("s_cmd", "f8"),  # fault: share of the command replaced [0..1]
    ("f_rate", "f8"),  # fault: added to the rate of the position demand [rad/s]
    ("s_rate", "f8"),  # fault: share of that rate replaced [0..1]
    ("pos_meas", "f8"),  # position sensor, N x3 [m]
    ("pos_valid", "f8"),  # 1 where it is valid
    ("vel_meas", "f8"),  # motor rate [rad/s]
    ("vel_valid", "f8"),  # 1 where it is valid
    ("pos_fb", "f8"),  # position from outside [m]
    ("pos_use", "f8"),  # 1: use it instead of the sensor
])
STATE = dtype([
    ("u", "f8", "A"),  # demand to the amplifier
    ("delta_c", "f8", "rad"),  # surface command after faults and limits
    *reference.state_fields("rad"),  # surface reference and derivatives
    ("theta", "f8", "rad"),  # angle that the loop closes on
    ("omega", "f8", "rad/s"),  # rate that the loop closes on
    ("i_d", "f8", "A"),  # demanded current
    ("z", "f8", "rad/s2"),  # integrator
])
OUTPUTS = ("u", "delta_c", "r", "rd", "theta", "omega", "i_d", "z")

POLE = 20.0  # [rad/s]


def error_gains(*, pole: Any, dt: float) -> dict[str, Any]:
    """Return {k_p, k_v, k_i} placing the poles of theta'' = -k_p theta - k_v theta' - k_i int theta, held over `dt`."""
    Phi = np.array([[1, dt, 0], [0, 1, 0], [dt, 0, 1]])
    Gamma = np.array([[dt**2 / 2], [dt], [0]])
    K = rounded(place(Phi, Gamma, np.exp(-pole * dt * np.array([0.97, 1.0, 1.03]))), 10)
    return {"k_p": K[0], "k_v": K[1], "k_i": K[2]}


def params(
    *,
    dt: float = 0.005,
    pole: float = POLE,
    omega: float = 45.0,
    zeta: float = 0.8,
    delay: float = 1.0,
    travel: tuple[float, float] = linkage.TRAVEL,
    symbols: Mapping[str, Any] | None = None,
    **values: Any,
) -> np.ndarray:
    """Return PARAMS of shape (1,) for the tick `dt` and the surface's stops `travel` [rad]; `symbols` replace those of
    the elevator set, `values` fields.

    Rate is commanded up to 40 of the 45 deg/s, acceleration up to half of what the stall moment gives without load;
    commands end 0.1 deg inside the stops. Raises ValueError for unknown names and for a compensator with lead (a != b),
    which this loop does not invert.
    """
    v = jay.values("elevator", **(symbols or {}))
    if v["a"] != v["b"]:
        raise ValueError(f"the loop expects a compensator without lead (a = b), got a = {v['a']}, b = {v['b']}")
    ratio = v["arm"] / v["lead"]
    J = v["J_N"] + v["J_M"] * ratio**2
    I_max = jay.LIMITS["elevator"][0]
    amps = J / (v["K_T"] * ratio)
    fields = {
        **reference.gains(omega=omega, zeta=zeta, dt=dt),
        "v_max": math.radians(40.0),
        "v_run": math.radians(60.0),
        "a_max": 0.5 * I_max / amps,
        "j_max": 0.5 * I_max / amps * omega,  # half the stall within 1 / omega
        "arm": v["arm"],
        "ratio": ratio,
        "r_lo": travel[0] + math.radians(0.1),
        "r_hi": travel[1] - math.radians(0.1),
        **error_gains(pole=pole, dt=dt),
        "dead": 1e-4,
        "amps": amps,
        "I_max": I_max,
        "g_i": (v["K_ic"] + v["R"]) / v["K_gi"],
        "g_w": v["K_B"] / v["K_gi"],
        "delay": delay,
    }
    return record(PARAMS, **{**fields, **values})


def init_at(p: np.ndarray, position: Any = 0.0, i: Any = 0.0) -> np.ndarray:
    """Return the state at rest at screw `position` N x3 [m] with the holding current `i` [A]; both broadcast over p."""
    x = np.zeros(p.shape, STATE)
    x["r"] = position / p["arm"]
    x["theta"] = x["delta_c"] = x["r"]
    x["i_d"] = i
    x["z"] = x["i_d"] / p["amps"]
    x["u"] = p["g_i"] * x["i_d"]
    return x


@kernel
def _sense(x, u, p, dt):
    """Write angle and rate of now from measurements that are `delay` ticks old, or from what remains valid."""
    rate = u.vel_meas / p.ratio
    rate = rate if u.vel_valid > 0.5 and abs(rate) < 1e6 else x.rd
    y = u.pos_meas
    good = u.pos_valid > 0.5 and abs(y) < 1e6
    if u.pos_use > 0.5 and abs(u.pos_fb) < 1e6:
        y, good = u.pos_fb, True
    push = (x.i_d / p.amps - x.z) * dt * p.delay
    if good:
        x.theta = y / p.arm + (rate + 0.5 * push) * dt * p.delay
    else:
        x.theta += (rate + 0.5 * push) * dt
    x.omega = rate + push


@kernel
def _refer(x, u, p, dt):
    """Write the reference of this tick's start towards the command, or let it run away."""
    command = (1.0 - u.s_cmd) * u.command + u.f_cmd
    if abs(command) < 1e6:
        x.delta_c = clip(command, p.r_lo, p.r_hi)
    reference.demand(x, x.delta_c, 1.0, p)
    if u.s_rate != 0.0 or u.f_rate != 0.0:
        rate = (1.0 - u.s_rate) * x.rd + u.f_rate
        if abs(rate) < 1e6:
            x.rd = clip(rate, -p.v_run, p.v_run)
        x.rdd, x.rddd = 0.0, 0.0


@kernel
def step(x, u, p, dt):
    """Bring the reference to now and compute the demand for the tick that starts."""
    reference.advance(x, dt)
    x.r = clip(x.r, 1.2 * p.r_lo, 1.2 * p.r_hi)
    _sense(x, u, p, dt)
    _refer(x, u, p, dt)
    e = x.r - x.theta
    wanted = p.amps * (x.rdd + p.k_v * (x.rd - x.omega) + p.k_p * e + x.z)
    x.i_d = clip(wanted, -p.I_max, p.I_max)
    x.u = p.g_i * x.i_d + p.g_w * x.omega * p.ratio
    if not ((wanted > p.I_max and e > 0.0) or (wanted < -p.I_max and e < 0.0)):
        x.z += p.k_i * dt * (e - clip(e, -p.dead, p.dead))


rollout = entry(step, STATE, INPUTS, PARAMS)
