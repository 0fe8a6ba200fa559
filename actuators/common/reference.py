"""The third-order reference model: a command becomes a position with its first three derivatives, all limited.

A chain of three loops around a triple integrator, each clipped where the actuator has its limit:

    v = k1 (target - r),    |v| <= v_max and |v| <= sqrt(2 0.4 a_max |target - r|), from which a_max can stop
    a = k2 (v - r'),        |a| <= a_max
    j = k3 (a - r''),       |j| <= j_max,    r''' = j held over the tick

Inside the limits it is a third-order low-pass filter ([Lu17] III.B.1) with a real pole at `omega` and a pair at
`omega`, damping `zeta`, placed exactly in discrete time: the low-frequency delay is (1 + 2 zeta) / omega.
"""

import math
from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.common.limits import flush, within
from actuators.deterministic_linalg import place, rounded

PARAM_FIELDS = [
    ("k1", "f8"),  # position to velocity [1/s]
    ("k2", "f8"),  # velocity to acceleration [1/s]
    ("k3", "f8"),  # acceleration to jerk [1/s]
    ("v_max", "f8"),  # velocity limit [unit/s]
    ("a_max", "f8"),  # acceleration limit [unit/s^2]
    ("j_max", "f8"),  # jerk limit [unit/s^3]
]


def state_fields(unit: str) -> list[Any]:
    """Return the STATE fields of a reference in `unit`: position and derivatives, the jerk over this tick last."""
    return [("r", "f8", unit), ("rd", "f8", f"{unit}/s"), ("rdd", "f8", f"{unit}/s2"), ("rddd", "f8", f"{unit}/s3")]


def gains(*, omega: float, zeta: float, dt: float) -> dict[str, Any]:
    """Return {k1, k2, k3} that place the sampled poles at exp(p dt), p = -omega and omega at damping zeta < 1."""
    Phi = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    Gamma = np.array([[dt**3 / 6], [dt**2 / 2], [dt]])
    pair = omega * complex(-zeta, np.sqrt(1 - zeta**2))
    K = rounded(place(Phi, Gamma, np.exp(np.array([-omega, pair, np.conj(pair)]) * dt)), 10)
    return {"k1": K[0] / K[1], "k2": K[1] / K[2], "k3": K[2]}


@kernel
def demand(x, target, speed, p):
    """Write r''' for this tick towards `target`; `speed` in 0..1 scales v_max. Reads r, r', r'' at the tick's start."""
    e = target - x.r
    v = within(p.k1 * e, min(p.v_max * speed, math.sqrt(0.8 * p.a_max * abs(e))))
    a = within(p.k2 * (v - x.rd), p.a_max)
    x.rddd = within(p.k3 * (a - x.rdd), p.j_max)


@kernel
def advance(x, dt):
    """Integrate r, r', r'' over the tick, exactly for the held r'''."""
    x.r += dt * (x.rd + dt * (x.rdd / 2.0 + dt * x.rddd / 6.0))
    x.rd = flush(x.rd + dt * (x.rdd + dt * x.rddd / 2.0))
    x.rdd = flush(x.rdd + dt * x.rddd)
