"""What a sine at a place of the actuator leaves in the innovations of the filter in its steady state, by frequency."""

from typing import Any

import numpy as np

from fdi.hydraulic.two_stage_ekf import transition
from fdi.isolation.filter import ROWS, SENSORS

PLACES = ("valve", "rod", "surface", "pressure", "load")
# position sensors that are heard: both, rod alone, surface alone; the pressure always is
HEARD = ((0, 1, 2), (0, 2), (1, 2))
SETTLED = 1000  # ticks after which the covariance has come to rest


def steady(p: Any, dt: float, heard: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (Phi (4, 4), G (4,) of a flow of 1 m/s, K (SENSORS, 4), s (SENSORS,)) of the resting filter of PARAMS
    record `p` on the sensors `heard`."""
    Phi, G = np.zeros((4, 4)), np.zeros(4)
    transition(Phi, G, np.zeros(4), 0.0, 0.0, 0.0, 0.0, True, p, dt)
    Phi[3, 3] = 1.0
    P = np.diag(p["h_P0"]).astype(float)
    K, s = np.zeros((SENSORS, 4)), np.zeros(SENSORS)
    for _ in range(SETTLED):
        for j in heard:
            row = ROWS[j]
            s[j] = P[row, row] + p["h_r"][j]
            K[j] = P[:, row] / s[j]
            A = np.eye(4)
            A[:, row] -= K[j]
            P = A @ P @ A.T + p["h_r"][j] * np.outer(K[j], K[j])
        P = Phi @ P @ Phi.T + np.diag(p["h_q"]) * dt
    return Phi, G * p["A_p"] / p["phi_n"], K, s


def responses(p: Any, dt: float, hz: np.ndarray, heard: Any = HEARD[0]) -> np.ndarray:
    """Return the complex amplitudes (place, frequency, sensor) of whitened innovations per unit of a sine: flow [m/s],
    rod [m], surface as a rod [m], pressure [1], load [1]; 0 of a sensor that is not `heard`."""
    Phi, G, K, s = steady(p, dt, heard)
    out = np.zeros((len(PLACES), len(hz), SENSORS), complex)
    for i, place in enumerate(PLACES):
        inject = np.zeros(SENSORS, complex)
        if place in ("rod", "surface", "pressure"):
            inject[("rod", "surface", "pressure").index(place)] = 1.0
        into = G if place == "valve" else (Phi[:, 3] * [1, 1, 1, 0] if place == "load" else np.zeros(4))
        M, c = np.eye(4, dtype=complex), np.zeros(4, complex)  # V after the sensors = M V + c
        for j in heard:
            row = ROWS[j]
            c = c - K[j] * (c[row] + inject[j])
            M = M - np.outer(K[j], M[row])
        for k, f in enumerate(hz):
            V = np.linalg.solve(np.exp(2j * np.pi * f * dt) * np.eye(4) - Phi @ M, Phi @ c + into)
            for j in heard:
                row = ROWS[j]
                S = V[row] + inject[j]
                out[i, k, j] = S / np.sqrt(s[j])
                V = V - K[j] * S
    return out
