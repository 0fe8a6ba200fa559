"""Model of the servos between the elevator's command and the surfaces, with every limit of theirs.

    chain    r''' = k3 (a - r''),  a = k2 (v - r'),  v = k1 (u - r), each clipped       actuators/common/reference.py
    friction d' = (lag tanh(r' / v_lag) - d) / t_lag,  m = r - d

A servo tracks its reference r closely, but for what friction holds back while its observer or integrator has yet to
take it up: a time constant lag / v_lag longer for slow motion, a constant `lag` behind fast motion. A side's m is the
mean of its two segments. Condition (ii) of [Sun13] lets the design have no more than a first order per side, m' = a
(gain u - m): it is driven by the u that makes its m that of the servos,

    u = (m + m' / a) / gain,

the command as far as the servos follow it. The model begins at rest at its first command, which the law's noise may put
half a degree from where the servos are: no trim is learned until it has forgotten that. A second-order servo is a chain
whose jerk has no limit and takes one tick.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.common import reference
from fdi.common.reference import chase
from fdi.rfafe import core as rfafe_core

K1, K2, K3, V_MAX, A_MAX, J_MAX, LAG, V_LAG, T_LAG = range(9)  # of a segment's row in `servo`
R, RD, _, D = range(4)  # of its row in `ref`

PARAMS = [
    ("servo", "f8", (4, 9)),      # 1/s, deg/s, deg/s2, deg/s3, deg, deg/s, s; k1 = 0: a lag with a rate limit instead
    ("gain", "f8", (2,), "-"),    # of each side's first order
    ("n_forget", "f8", "-"),      # samples until the model has forgotten where it began
]
STATE = [
    ("ref", "f8", (4, 4), "deg"),  # r, r', r'' and d of each segment [deg, deg/s, deg/s2, deg]
]


def row(model: Mapping[str, Any], dt: float) -> Sequence[float]:
    """Return a segment's row of `servo` at tick `dt` [s] from its stored model (cosim/training/rfafe.py)."""
    omega, zeta = model["omega_rad_s"], model["zeta"]
    k = {"k1": omega / (2.0 * zeta), "k2": -math.expm1(-2.0 * zeta * omega * dt) / dt, "k3": 1.0 / dt}
    if "j_max_deg_s3" in model:
        k = reference.gains(omega=omega, zeta=zeta, dt=dt)
    limits = (model["v_max_deg_s"], model["a_max_deg_s2"], model.get("j_max_deg_s3", np.inf))
    return [*k.values(), *limits, model["lag_deg"], model["v_lag_deg_s"], model["t_lag_s"]]


@kernel
def move(r, c, u, dt):
    """Advance a segment's row `r` of `ref` by one tick under the command `u` [deg]; `c` is its row of `servo`."""
    away = u - r[R]
    most = min(c[V_MAX], math.sqrt(0.8 * c[A_MAX] * math.fabs(away)))
    chase(r, away, most, c[K1], c[K2], c[K3], c[A_MAX], c[J_MAX], dt)
    r[D] += (1.0 - math.exp(-dt / c[T_LAG])) * (c[LAG] * math.tanh(r[RD] / c[V_LAG]) - r[D])


@kernel
def run(u, c, m, dt):
    """Fill m (ticks,) with the surface of a servo under commands u (ticks,) [deg], at rest at the first."""
    r = np.zeros(4)
    r[R] = u[0]
    for k in range(u.size):
        m[k] = r[R] - r[D]
        move(r, c, u[k], dt)


@kernel
def follow(x, p, dt):
    """Advance the servos by one tick under x.u_in; set u, u_late and rest."""
    if x.fresh == 0.0:
        x.seen = -p.n_forget
    for j in range(2):
        was, now = 0.0, 0.0
        for i in range(2 * j, 2 * j + 2):
            r, c = x.ref[i], p.servo[i]
            if x.fresh == 0.0:
                r[R] = x.u_in[j]
            was += 0.5 * (r[R] - r[D])
            move(r, c, x.u_in[j], dt)
            now += 0.5 * (r[R] - r[D])
        if x.fresh == 0.0:
            x.act[j] = was
        share = 1.0 - math.exp(-p.act_a[j] * dt)
        u = (was + (now - was) / share) / p.gain[j]
        late = rfafe_core.sent(x, p, u, j)
        x.act[j] += share * (p.gain[j] * late - x.act[j])
        x.rest[j] = x.act[j] / p.gain[j]
        x.u[j], x.u_late[j] = u - x.u0[j], late - x.u0[j]
    rfafe_core.turn(x)
