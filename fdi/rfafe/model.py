"""The linear models behind the estimator: aircraft with actuators, a first-order actuator fit, and E from flights."""

import math
from typing import Any

import numpy as np

from fdi.rfafe.discrete import first_order_hold


def global_model(
    Ab: Any, Bu: Any, Cb: Any, Du: Any, Aa: Any, Ba: Any, Ca: Any, Da: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C, D of the aircraft driven by its actuators, x = [x_b, x_a], y = [y_b, y_a], u = u_c.

    A = [[A_b, B_u C_a], [0, A_a]], B = [B_u D_a; B_a], C = [[C_b, D_u C_a], [0, C_a]], D = [D_u D_a; D_a].
    [Sun13] (39)
    """
    Ab, Bu, Cb, Du, Aa, Ba, Ca, Da = (np.atleast_2d(np.asarray(x, float)) for x in (Ab, Bu, Cb, Du, Aa, Ba, Ca, Da))
    nb, na = len(Ab), len(Aa)
    A = np.block([[Ab, Bu @ Ca], [np.zeros((na, nb)), Aa]])
    C = np.block([[Cb, Du @ Ca], [np.zeros((len(Ca), nb)), Ca]])
    return A, np.vstack([Bu @ Da, Ba]), C, np.vstack([Du @ Da, Da])


def first_order(a: Any, gain: Any = 1.0, sides: int = 1) -> tuple[Any, ...]:
    """Return A_a, B_a, C_a, D_a of `sides` lags gain a / (s + a); their state is the surface. [Sun13] (37)

    `a` and `gain` are numbers, or one for each side.
    """
    a, gain = np.broadcast_to(a, sides), np.broadcast_to(gain, sides)
    return -np.diag(a), np.diag(gain * a), np.eye(sides), np.zeros((sides, sides))


def fit_first_order(hz: Any, response: Any) -> tuple[float, float, float]:
    """Return (a [rad/s], gain, tau [s]) of gain a / (s + a) exp(-tau s), nearest to an actuator's complex `response` at
    `hz`.

    Least squares on the complex difference. A lag alone cannot hold both the amplitude and the phase of a higher-order
    actuator: amplitude errors scale f_hat, phase errors turn every command into a fault. tau takes the rest of the
    phase and goes to the observer's command (`u_delay`), as (ii) allows no second-order model.
    """
    from scipy.optimize import least_squares  # a quarter of a second that a flight need not wait for

    s, G, start = 2j * math.pi * np.asarray(hz), np.asarray(response), [20.0, 1.0, 0.01]

    def error(z):
        d = z[1] * z[0] / (s + z[0]) * np.exp(-s * z[2]) - G
        return np.concatenate([d.real, d.imag])

    fit = least_squares(error, start, x_scale=start, bounds=([0.1, 0.0, 0.0], [500.0, 10.0, 0.5]))
    return float(fit.x[0]), float(fit.x[1]), float(fit.x[2])


def estimate_E(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, flights: Any, *, dt: float, omega: float = 5.0, settle_s: float = 2.0
) -> np.ndarray:
    """Return E (n, flights): the direction of the unknown input of each fault-free flight, as long as its rms.
    [Sun13] (32)

    Augmented-state observer of x' = A x + B u + d1, d1' = 0 with all poles at -omega [rad/s], gains L1 = A + 2 omega I,
    L2 = omega^2 I on the state seen through C; theorem 3 asks for rank(C) = n, else ValueError. `flights` is a list of
    (y (T, m), u (T, r)) deviations from trim, y without feedthrough; the first `settle_s` of each do not count. The
    direction is the one in which d1 has the largest mean square.
    """
    A, B, C = (np.atleast_2d(np.asarray(x, float)) for x in (A, B, C))
    n = len(A)
    if np.linalg.matrix_rank(C) < n:
        raise ValueError(f"rank(C) = {np.linalg.matrix_rank(C)} < n = {n}: (32) is not observable [Sun13, theorem 3]")
    columns = []
    for y, u in flights:
        d = unknown_input(A, B, C, np.asarray(y, float), np.asarray(u, float), dt=dt, omega=omega)
        d = d[round(settle_s / dt):]
        U, s, _ = np.linalg.svd(d.T, full_matrices=False)
        columns.append(U[:, 0] * s[0] / math.sqrt(len(d)))
    return np.array(columns).T


def unknown_input(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, y: np.ndarray, u: np.ndarray, *, dt: float, omega: float
) -> np.ndarray:
    """Return the estimate of d1 (T, n) along one flight, y linear and u held between samples; as `estimate_E`."""
    n, one = len(A), np.eye(len(A))
    left = np.linalg.pinv(C)
    L1, L2 = A + 2.0 * omega * one, omega**2 * one
    Ao = np.block([[A - L1, one], [-L2, np.zeros((n, n))]])
    Phi, Gu, G0, G1 = first_order_hold(Ao, np.vstack([L1, L2]) @ left, np.vstack([B, np.zeros_like(B)]), dt)
    s = np.concatenate([left @ y[0], np.zeros(n)])
    out = np.zeros((len(y), n))
    for k in range(1, len(y)):
        s = Phi @ s + Gu @ u[k - 1] + G0 @ y[k - 1] + G1 @ y[k]
        out[k] = s[n:]
    return out


def reduce_E(E: np.ndarray, rank: int) -> np.ndarray:
    """Return E* (n, rank), the nearest matrix of that rank by its largest singular values, as orthonormal columns.

    [Sun13] (33)-(36), whose index order suggests the smallest: the largest are meant.
    """
    U, s, _ = np.linalg.svd(E, full_matrices=False)
    return U[:, : min(rank, int(np.sum(s > 1e-12 * max(s[0], 1e-300))))]
