"""Published linear aircraft with a lag as elevator actuator, and their exact response, for the tests of Sun13."""

import math

import numpy as np
from scipy.linalg import expm
from transport_data import DIMENSIONAL, FLIGHT_CONDITIONS

from actuators.constants import M_PER_FT, RAD_PER_DEG
from fdi import rfafe

CONDITIONS = ("3", "4", "6", "8", "9")  # of NASA CR-2144
ELEVATOR = (1.44, -17.9, -1.16)  # X, Z, M over de of condition 9, taken for all
# Navion, sea level, 176 ft/s [Nelson, Flight Stability and Automatic Control, ex. 4.3]: u, w ft/s, q rad/s, theta rad
NAVION = (np.array([[-0.045, 0.036, 0.0, -32.2], [-0.369, -2.02, 176.0, 0.0], [0.0019, -0.0396, -2.948, 0.0],
                    [0.0, 0.0, 1.0, 0.0]]),
          np.array([[0.0], [-28.15], [-11.874], [0.0]]))
# Stevens and Lewis, F-16 at 502 ft/s, CG aft: V ft/s, alpha rad, theta rad, q rad/s reordered; elevator deg
FIGHTER = (np.array([[-0.0193, 8.82, -0.575, -32.17], [-2.54e-4, -1.019, 0.905, 0.0], [2.95e-12, 0.822, -1.077, 0.0],
                     [0.0, 0.0, 1.0, 0.0]]), np.array([[0.17], [-2.15e-3], [-0.1756], [0.0]]))  # fmt: skip
E_SPEED = np.array([[1.0], [0.2], [0.1], [0.0], [0.0], [0.0]])


def heffley_jewell(name):
    """Return A, B of x = [V m/s, alpha deg, q deg/s, theta deg], u = all elevators [deg], from CR-2144's body axes.

    *derived*: level flight, W0 from the trim angle of attack; the fourth-order equations of motion in ft, s, rad.
    """
    _, _, V, _, alpha = FLIGHT_CONDITIONS[int(name)]
    Xu, Zu, Mu, Xw, Zw, Mw, Zwd, Zq, Mwd, Mq = DIMENSIONAL[int(name)]
    g, U0, W0 = 32.174, V * math.cos(alpha * RAD_PER_DEG), V * math.sin(alpha * RAD_PER_DEG)
    E = np.eye(4)
    E[1, 1], E[2, 1] = 1.0 - Zwd, -Mwd
    down, along = g * math.cos(alpha * RAD_PER_DEG), g * math.sin(alpha * RAD_PER_DEG)
    A = np.array([[Xu, Xw, -W0, -down], [Zu, Zw, U0 + Zq, -along],
                  [Mu, Mw, Mq, 0.0], [0.0, 0.0, 1.0, 0.0]])
    B = np.array([[*ELEVATOR, 0.0]]).T
    A, B = np.linalg.solve(E, A), np.linalg.solve(E, B)
    # u, w -> V, alpha
    S = np.array([[U0 / V, W0 / V, 0, 0], [-W0 / V**2, U0 / V**2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    unit = np.diag([M_PER_FT, 1 / RAD_PER_DEG, 1 / RAD_PER_DEG, 1 / RAD_PER_DEG])
    S = unit @ S
    return S @ A @ np.linalg.inv(S), S @ B * RAD_PER_DEG


def global_of(A, B, a=18.0, sides=2):
    """Return A, B, C, D of the aircraft with a lag a / (s + a) in front of each side's equal share of its elevator."""
    share = np.hstack([B / sides] * sides)
    actuator = rfafe.first_order(a, sides=sides)
    return rfafe.global_model(A, share, np.eye(4), np.zeros((4, sides)), *actuator)


def sampled(A, F, C, sine, dt, n):
    """Return y (n, m) of x' = A x + F f from rest, f a sine (peak, rad/s), exact: it is generated inside."""
    peak, w = sine
    big = np.block([[A, F * peak, np.zeros_like(F)], [np.zeros((1, len(A))), np.zeros((1, 1)), np.full((1, 1), w)],
                    [np.zeros((1, len(A))), np.full((1, 1), -w), np.zeros((1, 1))]])
    Phi, x = expm(big * dt), np.zeros(len(A) + 2)
    x[-1] = 1.0  # sin from 0, cos from 1
    y = np.zeros((n, len(C)))
    for k in range(n):
        y[k] = C @ x[: len(A)]
        x = Phi @ x
    return y


def amplitude(t, signal, w):
    """Return the amplitude of the sine of w [rad/s] in a signal, by least squares with a constant."""
    basis = np.stack([np.sin(w * t), np.cos(w * t), np.ones_like(t)], 1)
    return np.hypot(*np.linalg.lstsq(basis, signal, rcond=None)[0][:2])
