"""What a sine at a place of the actuator leaves in the innovations of the filter in its steady state, by frequency."""

from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from actuators.hydraulic.lu17 import stiffness
from fdi.hydraulic.two_stage_ekf import transition
from fdi.isolation.filter import RATE_TAU, ROWS, SENSORS

PLACES = ("valve", "rod", "surface", "pressure", "load")
# position sensors that are heard: both, rod alone, surface alone; the pressure always is
HEARD = ((0, 1, 2), (0, 2), (1, 2))
# mean squared flows: the larger, the more the filter is in doubt of its prediction and hears its sensors [m^2/s^2]
FLOWS2 = (0.0, 4e-4, 1.6e-3, 6.4e-3, 2.56e-2)


def responses(
    p: Any, dt: float, hz: np.ndarray, heard: tuple[int, ...] = HEARD[0], flow2: float = 0.0
) -> np.ndarray:
    """Return the complex amplitudes (place, frequency, sensor) of whitened innovations per unit of a sine: flow [m/s],
    rod [m], surface as a rod [m], pressure [1], load [1]; 0 of a sensor that is not `heard`.

    `p` is a PARAMS record, `flow2` the mean squared flow of the time before [m^2/s^2]. The sensors are taken one after
    the other: their innovations are those of all at once through the inverse of the Cholesky factor of these.
    """
    Phi, G, H = np.zeros((4, 4)), np.zeros(4), np.eye(4)[[ROWS[j] for j in heard]]
    transition(Phi, G, np.zeros(4), 0.0, 0.0, 0.0, 0.0, True, p, dt)
    R = np.diag(p["h_r"][list(heard)])
    # pressure and load are in doubt alike: the hinge moment of an oscillation changes with its flow
    walk = (stiffness(0.0, p) * p["flow_share"]) ** 2 * flow2 * RATE_TAU * np.array((0.0, 0.0, 1.0, 3.0))
    P = solve_discrete_are(Phi.T, H.T, np.diag(p["h_q"] + walk) * dt, R)
    S = H @ P @ H.T + R
    K, root = P @ H.T @ np.linalg.inv(S), np.linalg.cholesky(S)
    into, inject = np.zeros((4, len(PLACES))), np.zeros((SENSORS, len(PLACES)))
    into[:, 0], into[:3, 4] = G * p["A_p"] / p["phi_n"], Phi[:3, 3]
    inject[:, 1:4] = np.eye(SENSORS)
    inject = inject[list(heard)]
    turned = np.exp(2j * np.pi * hz * dt)[:, None, None] * np.eye(4)
    V = np.linalg.solve(turned - Phi @ (np.eye(4) - K @ H), (into - Phi @ K @ inject)[None])
    out = np.zeros((len(PLACES), len(hz), SENSORS), complex)
    out[:, :, list(heard)] = np.linalg.solve(root, H @ V + inject).transpose(2, 0, 1)
    return out
