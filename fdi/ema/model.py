"""Design of the flight form of the EMA's Kalman filter: six states with hinge stiffness, and the steady gain."""

import math
from typing import Any

import numpy as np

from actuators.ema import jay


def model(values: Any, dt: float, tau_load: float) -> tuple[Any, ...]:
    """Return (Phi, Phi_h, G, G_h) of the six states with the load's leak 1/tau_load [1/s].

    Phi_h = d Phi / d HM_delta at zero stiffness: over 5 ms and at -40 kN m/rad the second order is below 1e-4 of each
    row, 0.002 rad/s per tick at 4 deg. Raises ValueError for a set with a compensator, which the flying drive has not.
    """
    from scipy.linalg import expm_frechet  # a tenth of a second that a start need not wait for

    if values["a"] != values["b"]:
        raise ValueError("the flight filter has no compensator state: a = b")
    whole = jay.continuous("elevator", **values)
    A = np.zeros((8, 8))
    A[:5, :5] = whole.A[:5, :5]
    A[:5, 5] = A[:5, 7] = whole.E[:5]
    A[:5, 6] = whole.B[:5]
    A[5, 5] = -1.0 / tau_load
    stiff = np.zeros((8, 8))
    stiff[1, 0] = whole.E[1]
    e, de = expm_frechet(A * dt, stiff * dt)
    return e[:6, :6], de[:6, :6], e[:6, 6], e[:6, 7]


def gain(Phi: np.ndarray, measured: int, sigma: float, q_vel: float, q_load: float) -> tuple[Any, ...]:
    """Return (K, sqrt S): the steady gain of a sample of state `measured` with noise `sigma`, and the innovation's
    deviation; model errors per tick of rate and load."""
    from scipy.linalg import solve_discrete_are

    H = np.zeros((6, 1))
    H[measured] = 1.0
    Q = np.diag([0.0, 0.0, 0.0, q_vel * q_vel, 0.0, q_load * q_load])
    P = solve_discrete_are(Phi.T, H, Q, [[sigma * sigma]])
    S = P[measured, measured] + sigma * sigma
    return P[:, measured] / S, math.sqrt(S)


def designed(values: Any, dt: float, sigma_velocity: float, sigma_angle: float = 0.4) -> dict[str, Any]:
    """Return {K, S_root, K_angle, Phi, Phi_h, G, G_h} for ticks of `dt`; the noise densities are those of 5 ms at every
    rate.

    Per 5 ms: noise of the motor's rate `sigma_velocity` [rad/s] and of its angle `sigma_angle` [rad], model error
    1 rad/s. The load: 630 N m, 20 s.
    """
    tau_load, root = 20.0, math.sqrt(dt / jay.PERIOD)
    Phi, Phi_h, G, G_h = model(values, dt, tau_load)
    stiff, q_load = Phi - 2.0e4 * Phi_h, 630.0 * math.sqrt(-math.expm1(-2.0 * dt / tau_load))
    K, S_root = gain(stiff, 3, sigma_velocity / root, root, q_load)
    K_angle, _ = gain(stiff, 2, sigma_angle / root, root, q_load)
    return {"K": K, "S_root": S_root, "K_angle": K_angle, "Phi": Phi, "Phi_h": Phi_h, "G": G, "G_h": G_h}
