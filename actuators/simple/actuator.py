"""A plain actuator: second order, limited in rate, acceleration and position; no load, no electronics.

    v = k1 (command - delta),   |v| <= v_max;      delta'' = k2 (v - delta'),   |delta''| <= a_max

held over the tick and integrated exactly. For ailerons, rudder, stabiliser, and elevators called `simple`.

A fault is an input whose zero means healthy: f_cmd, s_cmd (the command becomes (1 - s_cmd) command + f_cmd), f_rate,
s_rate (the demanded rate becomes (1 - s_rate) v + f_rate: s_rate = 1 is a runaway at f_rate to the stop), loss
(fraction of the deflection lost), jam (above 0.5 it stops where it is), free_float (above 0.5 it trails to hm0 + hmd
delta = 0).
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.common.limits import clip, flush, stopped

PARAMS = dtype([
    ("k1", "f8"),  # position error to rate [1/s]
    ("k2", "f8"),  # rate error to acceleration [1/s]
    ("v_max", "f8"),  # rate limit [rad/s]
    ("a_max", "f8"),  # acceleration limit [rad/s^2]
    ("lo", "f8"),  # stop [rad]
    ("hi", "f8"),  # stop [rad]
    ("tau_float", "f8"),  # time constant of the free surface [s]
])
INPUTS = dtype([
    ("command", "f8"),  # commanded angle [rad]
    ("hm0", "f8"),  # hinge moment at zero, used by free_float [N m]
    ("hmd", "f8"),  # its slope [N m/rad]
    ("f_cmd", "f8"),  # fault: added to the command [rad]
    ("s_cmd", "f8"),  # fault: share of the command replaced [0..1]
    ("f_rate", "f8"),  # fault: added to the demanded rate [rad/s]
    ("s_rate", "f8"),  # fault: share of the demanded rate replaced [0..1]
    ("loss", "f8"),  # fault: deflection lost [0..1]
    ("jam", "f8"),  # fault: above 0.5 stuck
    ("free_float", "f8"),  # fault: above 0.5 trailing
])
STATE = dtype([
    ("delta", "f8", "rad"),  # surface angle
    ("delta_d", "f8", "rad/s"),  # its rate
    ("delta_c", "f8", "rad"),  # command after faults and limits
    ("status", "f8", "-"),  # 0 good, 1 the command was not finite (the last good one is held)
])
OUTPUTS = ("delta", "delta_d", "delta_c", "status")


def params(
    *,
    omega: float = 30.0,
    zeta: float = 0.9,
    rate: float = linkage.RATE,
    lo: Any = linkage.TRAVEL[0],
    hi: Any = linkage.TRAVEL[1],
    **values: Any,
) -> np.ndarray:
    """Return PARAMS of shape (1,) from natural frequency [rad/s], damping, rate [rad/s], stops [rad] (elevator)."""
    fields = {
        "k1": omega / (2 * zeta),
        "k2": 2 * zeta * omega,
        "v_max": rate,
        "a_max": 2 * omega * rate,  # a full reversal of rate takes one time constant
        "lo": lo,
        "hi": hi,
        "tau_float": 0.2,  # assumed: a damped surface in a 747's airflow
    }
    return record(PARAMS, **{**fields, **values})


def init_at(p: np.ndarray, delta: Any = 0.0) -> np.ndarray:
    """Return the state at rest at `delta` [rad], which broadcasts over p."""
    x = np.zeros(p.shape, STATE)
    x["delta"] = delta
    x["delta_c"] = x["delta"]
    return x


@kernel
def move(x, a, p, dt):
    """Integrate the acceleration `a` [rad/s2], held over the tick, up to the stops."""
    x.delta += dt * (x.delta_d + 0.5 * dt * a)
    x.delta_d += dt * a
    x.delta, x.delta_d = stopped(x.delta, x.delta_d, p.lo, p.hi)


@kernel
def step(x, u, p, dt):
    """Advance the actuator by one tick."""
    x.status = 1.0
    command = (1.0 - u.loss) * ((1.0 - u.s_cmd) * u.command + u.f_cmd)
    if abs(command) < 1e6:
        x.delta_c = clip(command, p.lo, p.hi)
        x.status = 0.0
    if u.jam > 0.5:
        x.delta_d = 0.0
        return
    v = (1.0 - u.s_rate) * clip(p.k1 * (x.delta_c - x.delta), -p.v_max, p.v_max) + u.f_rate
    if u.free_float > 0.5:
        goal = -u.hm0 / u.hmd if u.hmd < 0.0 else x.delta
        v = (clip(goal, p.lo, p.hi) - x.delta) / p.tau_float
    if not abs(v) < 1e6:
        v, x.status = 0.0, 1.0
    a = clip((v - x.delta_d) * (1.0 - math.exp(-p.k2 * dt)) / dt, -p.a_max, p.a_max)
    move(x, a, p, dt)
    x.delta_d = flush(x.delta_d)


rollout = entry(step, STATE, INPUTS, PARAMS)
