"""The LPV plant of [Alwi14] section 6 flown by itself: the model that the observer knows, with faults of known size."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.linalg import expm

from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from fdi.lpv_smo import model as lpv_model

DOUBLET = ((2, 4, -1.0), (4, 6, 1.0), (14, 16, -1.0), (16, 18, 1.0))  # (from s, to s, deg of elevator)


def fly(
    made: Any,
    rho: Any,
    block: Any,
    *,
    h: float = 0.005,
    seconds: float = 25.0,
    faults: Sequence[Any] = (3.0, 0.5, 5.0),
    at: float = 10.0,
    noise: float = 0.0,
    seed: int = 1,
) -> Any:
    """Fly the LPV plant of `made` (an LpvModel) at constant `rho` and return the block's INPUTS, (1, ticks).

    The elevator follows a doublet and damps pitch; from `at` on it is off by faults[0] deg, n_z by faults[1] g, alpha
    by faults[2] deg. The plant is advanced exactly, its input held over each tick. `noise` scales sensor set transport.
    """
    _, u_eq, y_eq = lpv_model.trim_at(made, rho)
    A, B, C, D = (lpv_model.at(S, rho) for S in (made.A, made.B, made.C, made.D))
    n = round(seconds / h)
    step = expm(np.block([[A, B], [np.zeros((2, 7))]]) * h)[:5]
    x, y, command = np.zeros(5), np.zeros((n, 6)), np.zeros(n)
    for k in range(n):
        t = k * h
        broken = t >= at - 1e-9
        command[k] = sum(v for a, b, v in DOUBLET if a <= t + 1e-9 < b) + 0.8 * x[4] + 0.3 * x[2]
        surface = np.array([command[k] + faults[0] * broken, 0.0])
        y[k] = C @ x + D @ surface + y_eq
        y[k, 4:] += np.array(faults[1:]) * broken
        x = step @ np.r_[x, surface]
    y += noise * np.array([0.02, 0.02, 0.05, 0.02, 0.007, 0.03]) * np.random.default_rng(seed).standard_normal(y.shape)
    u = np.zeros((1, n), block.INPUTS)
    for name in u.dtype.names:
        if name.endswith("_valid"):
            u[name] = 1.0
    si = np.array([1, RAD_PER_DEG, 1, RAD_PER_DEG, 1, RAD_PER_DEG])
    for name, column in zip(("h", "theta", "V", "q", "n_z", "alpha"), (y * si).T, strict=True):
        u[name][0] = column
    for name in ("de_lo", "de_li", "de_ri", "de_ro"):
        u[name][0] = (command + u_eq[0]) * RAD_PER_DEG
    u["stab"][0] = u_eq[1] * RAD_PER_DEG
    u["mass"], u["cg"], u["cas"], u["mach"] = rho[0] * 1e3, rho[1] / 100, rho[2] * M_S_PER_KT, rho[3]
    return u
