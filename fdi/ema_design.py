"""Design of the flight form of the EMA's Kalman filter: six states with hinge stiffness, and the steady gain."""

import math

import numpy as np
from scipy.linalg import expm_frechet, solve_discrete_are

from actuators import jay


def model(values, dt, tau_load):
    """Return (Phi, Phi_h, G, G_h) of the six states with the load's leak 1/tau_load [1/s].

    Phi_h = d Phi / d HM_delta at zero stiffness: over 5 ms and at -40 kN m/rad the second order is below 1e-4 of each
    row, 0.002 rad/s per tick at 4 deg. Raises ValueError for a set with a compensator, which the flying drive has not.
    """
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


def gain(Phi, sigma_load, tau_load, q_vel, sigma_vel, dt):
    """Return (K, sqrt S): the steady gain of the velocity sample y = x4 + v, and the innovation's deviation."""
    H = np.zeros((1, 6))
    H[0, 3] = 1.0
    Q = np.zeros((6, 6))
    Q[3, 3] = q_vel * q_vel
    Q[5, 5] = sigma_load * sigma_load * -math.expm1(-2.0 * dt / tau_load)
    P = solve_discrete_are(Phi.T, H.T, Q, [[sigma_vel * sigma_vel]])
    S = P[3, 3] + sigma_vel * sigma_vel
    return P[:, 3] / S, math.sqrt(S)
