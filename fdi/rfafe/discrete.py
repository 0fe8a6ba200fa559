"""Discretise observer and fault law together: u held, y linear between samples, one matrix exponential.

With y~ = y - D u, g = Gamma M and r = (I - CH) y~ - C z, the law f_hat' = g (r' + alpha r) is integrated by hand, so
that nothing is differentiated:

    f_hat = g r + alpha v,  v' = g r                                                        [Sun13] (28)
    z' = N z + T B u + K y~ + T F f_hat                                                     [Sun13] (2)

Holding y over the sample instead would add wb Ts/2 to the amplitude of f_hat.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Discrete:
    """s = [z, v]:  s+ = Phi s + Gu u + Gy0 y + Gy1 y+,  f_hat = S s + Sy y + Su u.

    y+ is the new sample, y the one before, u what was held in between (also in f_hat, through D).
    """

    dt: float
    Phi: np.ndarray  # (n + l, n + l)
    Gu: np.ndarray  # (n + l, r)
    Gy0: np.ndarray  # (n + l, m), the sample before
    Gy1: np.ndarray  # (n + l, m), the new sample
    S: np.ndarray  # (l, n + l)
    Sy: np.ndarray  # (l, m)
    Su: np.ndarray  # (l, r)


def first_order_hold(A: np.ndarray, By: Any, Bu: Any, dt: float) -> tuple[Any, ...]:
    """Return Phi, Gu, Gy0, Gy1 of s' = A s + By y + Bu u with y linear and u constant between samples."""
    from scipy.linalg import expm  # a tenth of a second that a start need not wait for

    n, m, r = A.shape[0], By.shape[1], Bu.shape[1]
    big = np.zeros((n + 2 * m + r, n + 2 * m + r))
    big[:n, :n], big[:n, n : n + m], big[:n, n + 2 * m :] = A * dt, By * dt, Bu * dt
    big[n : n + m, n + m : n + 2 * m] = np.eye(m)
    big = expm(big)
    held, ramp = big[:n, n : n + m], big[:n, n + m : n + 2 * m]
    return big[:n, :n], big[:n, n + 2 * m :], held - ramp, ramp


def discretise(d: Any, dt: float) -> Discrete:
    """Return the Discrete estimator of a `fdi.rfafe.synthesis.Design` for ticks of `dt` [s]."""
    TF, gain, l = d.T @ d.F, d.Gamma @ d.M, d.F.shape[1]
    through = gain @ (np.eye(len(d.C)) - d.C @ d.H)
    A = np.block([[d.N - TF @ gain @ d.C, d.alpha * TF], [-gain @ d.C, np.zeros((l, l))]])
    By = np.vstack([d.K + TF @ through, through])
    Bu = np.vstack([d.T @ d.B, np.zeros((l, d.B.shape[1]))]) - By @ d.D
    Phi, Gu, Gy0, Gy1 = first_order_hold(A, By, Bu, dt)
    S = np.hstack([-gain @ d.C, d.alpha * np.eye(l)])
    return Discrete(dt=float(dt), Phi=Phi, Gu=Gu, Gy0=Gy0, Gy1=Gy1, S=S, Sy=through, Su=-through @ d.D)


def noise(discrete: Any, sigma: float | np.ndarray) -> np.ndarray:
    """Return the standard deviation (l,) of f_hat from white noise `sigma` (m,) on the samples of y, after settling."""
    from scipy.linalg import solve_discrete_lyapunov

    d, R = discrete, np.diag(np.asarray(sigma, float) ** 2)
    # w = s - Gy1 y is independent of the sample y:  w+ = Phi w + (Phi Gy1 + Gy0) y
    G = d.Phi @ d.Gy1 + d.Gy0
    W = solve_discrete_lyapunov(d.Phi, G @ R @ G.T)
    through = d.S @ d.Gy1 + d.Sy
    return np.sqrt(np.diag(d.S @ W @ d.S.T + through @ R @ through.T))
