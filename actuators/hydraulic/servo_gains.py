"""Gains of the hydraulic servo: error poles of the sampled actuator, steady Kalman gains of its observer."""

import functools
from typing import Any

import numpy as np

from actuators.block import briefly
from actuators.common.ackermann import place
from actuators.deterministic_linalg import rounded
from actuators.disk_cache import kept
from actuators.ema import jay
from actuators.hydraulic import lu17

# sensor set `transport` (1 sigma per sample), and how fast the unknown may move
SIGMA_ROD, SIGMA_PRESSURE = 1e-4, 0.005  # [m], [1]
WALK_LOAD, WALK_PRESSURE, WALK_VELOCITY = 5e3, 0.1, 0.01  # per root second [N], [1], [m/s]


def _linear(model):
    """Return (A, B) of q, q', x3 at rest and centre, shapes (3, 3), (3, 1)."""
    a22, a23, a31, a32, a33, b3, _ = briefly(lu17.jacobian, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, model)
    return np.array([[0, 1, 0], [0, a22, a23], [a31, a32, a33]]), np.array([[0.0], [0.0], [b3]])


def error_gains(model: Any, *, pole: Any, dt: float) -> dict[str, Any]:
    """Return {k_q, k_v, k_a} for which the sampled linear loop has its poles at -pole, 0.97 pole and 1.03 pole.

    (13) in linear form is u = -K (q, q', x3): K follows from pole placement, the gains from comparing coefficients.
    """
    A, B = _linear(model)
    Phi, Gamma = jay.discretise(A, B, dt)
    K = rounded(place(Phi, Gamma, np.exp(-pole * dt * np.array([0.97, 1.0, 1.03]))), 10)
    a23, beta, k = A[1, 2], model.B / model.M, -A[2, 1]
    D = a23 * k * model.phi_n / model.A_p  # u to q''' [m/s^3]
    k_a = beta + (K[2] * D / (a23 * k) + model.L) * k
    return {"k_q": D * K[0], "k_v": D * K[1] + a23 * k + (k_a - beta) * beta, "k_a": k_a}


def observer_gains(model: Any, *, dt: float) -> list[Any]:
    """Return (K, K_rod), shapes (4, 2), (4,): steady Kalman gains of (q, q', x3, F), linear at rest and centre."""
    both = _gains(model.dtype, model.tobytes(), dt)
    return [both[:8].reshape(4, 2).copy(), both[8:].copy()]


@functools.lru_cache(maxsize=64)
def _gains(kind, numbers, dt):
    """Return both of `observer_gains`, one behind the other."""
    model = np.frombuffer(numbers, kind)[0]
    given = kind.descr, model.tolist(), dt
    return kept(given, float, lambda: np.concatenate(_observer_gains(model, dt)), __file__)


def _observer_gains(model, dt):
    from scipy.linalg import expm, solve_discrete_are  # a tenth of a second that a start need not wait for

    A3, _ = _linear(model)
    A = np.zeros((4, 4))
    A[:3, :3] = A3
    A[1, 3] = 1.0 / model.M
    Phi = expm(A * dt)
    Q = np.diag(np.array([1e-6, WALK_VELOCITY, WALK_PRESSURE, WALK_LOAD]) ** 2 * dt)
    out = []
    scale = np.diag([1e-3, 1e-2, 1e-1, 1e3])  # the Riccati solver wants entries of one size
    inverse = np.linalg.inv(scale)
    for rows in ((0, 2), (0,)):
        H = np.eye(4)[list(rows)]
        R = np.diag(np.array([SIGMA_ROD, 1.0, SIGMA_PRESSURE])[list(rows)] ** 2)
        P = solve_discrete_are((inverse @ Phi @ scale).T, (H @ scale).T, inverse @ Q @ inverse, R)
        P = scale @ P @ scale
        out.append(P @ H.T @ np.linalg.inv(H @ P @ H.T + R))
    return rounded(out[0].ravel(), 9), rounded(out[1][:, 0], 9)
