"""Robust fast adaptive fault estimator: existence conditions and LMI design on any linear model [Sun13, section II].

    plant      x' = A x + B u + E d + F f,  y = C x + D u                                                  (1), (41)
    observer   z' = N z + T B u + K y + T F f_hat,  x_hat = z + H y,  r = y - C x_hat                     (2), (11)
    fault law  f_hat' = Gamma M (r' + alpha r)                                                            (17), (28)

    n states, r inputs u, m outputs y (D u is subtracted first), q unknown inputs d, l faults f
    H, T, N, K = K1 + K2, M, P  as printed; Y = P K1; gamma of (29) is driven to zero by construction
    centre, radius  disk (30) about (-q, 0), its q > 0 and r;  decay  strip (31), its zeta;  1/s

(15), (30), (31) are linear in (P, Y); (16) has a solution M where (TF)' P null(C) = 0, which is asked for in place of
the least gamma in (29). G = g theta (TF)'P(TF), so that theta cancels in (15): it has no effect. All is solved in
balanced states and in units of the disk's centre, and scaled back so that P >= I in the caller's units.
"""

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from fdi.common import conditions, lmi
from fdi.common.conditions import DesignError
from fdi.rfafe.discrete import Discrete, discretise

G_SHARE = 0.05  # g above: gives up 2.5 % of (15)'s lower right block for a finite bound delta of (23)
BANDWIDTH = 40.0  # wb of f_hat [rad/s]: middle of the useful 27-60, where 2 Hz passes and gyro noise stays small
MARGIN = 1e-3  # of the inequalities
VIOLATED = 1e-6  # of an inequality's size: more when the solution is substituted back is no solution


@dataclass(frozen=True)
class Region:
    """Disk of `radius` about -`centre` (30), left of -`decay` (31), in 1/s: the paper's r, q > 0 and zeta."""

    centre: float
    radius: float
    decay: float

    def holds(self, eigenvalues: Any, slack: float = 1e-6) -> Any:
        """Return for each eigenvalue whether it lies inside, to `slack` of the centre."""
        s = slack * self.centre
        e = np.asarray(eigenvalues)
        return (abs(e + self.centre) < self.radius + s) & (e.real < -self.decay + s)


@dataclass(frozen=True)
class Design:
    """An estimator: the paper's matrices in the caller's units, and its discrete form."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray  # (n, q) as used, full column rank
    F: np.ndarray
    N: np.ndarray
    T: np.ndarray
    K: np.ndarray
    K1: np.ndarray
    K2: np.ndarray
    H: np.ndarray
    M: np.ndarray
    P: np.ndarray
    Y: np.ndarray
    Gamma: np.ndarray
    alpha: float
    region: Region
    discrete: Discrete

    def estimate(self, y: np.ndarray, u: np.ndarray | None = None) -> np.ndarray:
        """Run the estimator over samples y (ticks, m) and return f_hat (ticks, l), in the model's units.

        u (ticks, r) is held from each sample to the next, None: zero; y and u are deviations from the trim. It starts
        with a state that fits the first sample and no fault. The blocks `fdi.rfafe.rfafe` do the same for aircraft of
        Sun13's states, compiled, with lost samples.
        """
        d, y = self.discrete, np.asarray(y, float)
        u = np.zeros((len(y), d.Gu.shape[1])) if u is None else np.asarray(u, float)
        s, out = np.zeros(len(d.Phi)), np.zeros((len(y), len(d.S)))
        s[: len(self.A)] = (np.linalg.pinv(self.C) - self.H) @ (y[0] - self.D @ u[0])
        for k in range(1, len(y)):
            s = d.Phi @ s + d.Gu @ u[k - 1] + d.Gy0 @ y[k - 1] + d.Gy1 @ y[k]
            out[k] = d.S @ s + d.Sy @ y[k] + d.Su @ u[k - 1]
        return out

    def tracking(self, hz: float) -> complex:
        """Return f_hat/f of the first fault at `hz`, f_hat = L (f - f_hat), L = (1 + alpha/s) Gamma M C (sI-N)^-1 TF.
        (9), (28)"""
        s = 2j * math.pi * hz
        L = (1.0 + self.alpha / s) * self.Gamma @ self.M @ self.C
        L = L @ np.linalg.solve(s * np.eye(len(self.N)) - self.N, self.T @ self.F)
        return complex(np.linalg.solve(np.eye(len(L)) + L, L)[0, 0])


def design(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: Any, E: Any, F: np.ndarray, *, dt: float,
    region: Region | None = None, alpha: float | None = None, bandwidth: float = BANDWIDTH, sigma: Any = None,
    min_ratio: float = 0.5,
) -> Design:  # fmt: skip
    """Design the estimator for a linear model and return a `Design`.

    A (n, n), B (n, r), C (m, n), D (m, r) or None, E (n, q) or None, F (n, l), any units; dt in s.

    region     disk and strip of N's eigenvalues; None: centre half the bandwidth, or what suits alpha, widened to hold
               the modes that no gain moves
    alpha      [1/s]; None: centre (1 + centre / 2 wb), which makes |f_hat/f| flat when N = -centre I
    bandwidth  wb of f_hat [rad/s], from which follows the learning rate Gamma = wb ((TF)'P(TF))^-1
    sigma      standard deviation of each output's noise (m,): M then weighs the outputs by it; None: by size only
    min_ratio  least |TF|/|F|

    Raises DesignError (conditions (i)-(iv), the ratio, sizes), lmi.Infeasible, ImportError (no solver).
    """
    A, B, C, D, E, F = _checked(A, B, C, D, E, F)
    for name, value in {"dt": dt, "bandwidth": bandwidth, "alpha": 1.0 if alpha is None else alpha}.items():
        if not 0.0 < value < math.inf:
            raise DesignError(f"{name} is a positive number, not {value!r}")
    if sigma is not None and (np.shape(sigma) != (len(C),) or not np.all(np.asarray(sigma, float) > 0.0)):
        raise DesignError(f"sigma is one positive number per output ({len(C)}), not {sigma!r}")
    E = conditions.basis(E)
    H, T = conditions.decouple(C, E, F)
    TF = T @ F
    ratio = float(np.min(np.linalg.norm(TF, axis=0) / np.linalg.norm(F, axis=0)))
    if ratio < min_ratio:
        raise DesignError(
            f"|TF|/|F| is {ratio:.3f}, below {min_ratio}: E lies {conditions.angle_deg(E, F):.1f} deg from F, so "
            "decoupling it removes the fault and multiplies the noise; lower the rank of E or remove its part along F "
            "(`separate`)")
    A1 = conditions.without_rounding(T @ A, np.abs(T) @ np.abs(A))
    scale = conditions.balance(A1, C, TF, sigma)
    balanced = A1 / scale[:, None] * scale, C * scale, TF / scale[:, None]
    conditions.detectable(*balanced[:2])
    region = _region(region, bandwidth, alpha, conditions.fixed_modes(*balanced))
    if alpha is None:
        alpha = region.centre * (1.0 + region.centre / (2.0 * bandwidth))
    P, Y = _solve(*balanced, region, alpha)
    K1 = np.linalg.solve(P, Y) * scale[:, None]
    N = A1 - K1 @ C
    _substitute(P, N / scale[:, None] * scale, balanced[2], region, alpha)
    back = np.linalg.norm(np.linalg.inv(P) * np.outer(scale, scale), 2)  # homogeneous: P >= I fixes the scale
    P, Y = back * P / np.outer(scale, scale), back * Y / scale[:, None]
    M, X = TF.T @ P @ np.linalg.pinv(C), TF.T @ P @ TF
    made = {"A": A, "B": B, "C": C, "D": D, "E": E, "F": F, "N": N, "T": T, "K": K1 + N @ H, "K1": K1, "K2": N @ H,
            "H": H, "M": M, "P": P, "Y": Y, "Gamma": bandwidth * np.linalg.inv(X), "alpha": float(alpha)}  # fmt: skip
    return Design(**made, region=region, discrete=discretise(SimpleNamespace(**made), dt))


def _checked(A, B, C, D, E, F):
    """Return the matrices as finite float arrays of agreeing sizes; DesignError names the one that does not agree."""
    n, m = len(np.atleast_2d(A)), len(np.atleast_2d(C))
    out, sizes = [], {"A": (n, n), "B": (n, -1), "C": (m, n), "D": (m, -1), "E": (n, -1), "F": (n, -1)}
    for (name, (rows, columns)), X in zip(sizes.items(), (A, B, C, D, E, F), strict=True):
        X = np.zeros((rows, 0)) if X is None else np.asarray(X)
        if np.iscomplexobj(X) or not np.isfinite(X).all():
            raise DesignError(f"{name} holds a value that is complex, infinite or NaN")
        X = X[:, None] if X.ndim == 1 and columns < 0 else np.atleast_2d(X)
        if len(X) != rows or columns not in (-1, X.shape[1]):
            raise DesignError(f"{name} is {X.shape}; A has {n} rows, C {m}")
        out.append(X.astype(float))
    if not out[3].shape[1]:
        out[3] = np.zeros((m, out[1].shape[1]))
    if out[5].shape[1] == 0:
        raise DesignError("F has no column")
    return out


def _region(region, bandwidth, alpha, zeros):
    """Return the Region asked for, after checking that it can hold `zeros`; None: one that does and suits alpha."""
    if region is None:
        # the centre for which this alpha makes |f_hat/f| flat
        centre = bandwidth / 2.0 if alpha is None else bandwidth * (math.sqrt(1.0 + 2.0 * alpha / bandwidth) - 1.0)
        stable = [z for z in zeros if z.real < -1e-6 * centre]
        slow = float(min([centre / 4.0, *(-0.5 * z.real for z in stable)]))
        while not all(abs(z + centre) < centre - slow / 2.0 for z in stable):
            centre *= 1.5
        region = Region(centre, centre - slow / 2.0, slow)
    if not (region.centre > 0.0 and region.radius > 0.0 and 0.0 <= region.decay < region.centre + region.radius):
        raise DesignError(f"{region} is empty: centre > 0, radius > 0, 0 <= decay < centre + radius")
    outside = [z for z in zeros if not region.holds([z], slack=-1e-9)[0]]
    if outside:
        listed = ", ".join(f"{z:.4g}" for z in outside)
        raise DesignError(f"fixed modes {listed} 1/s (invariant zeros from fault and unknown input to the outputs) lie "
                          f"outside {region}: no gain moves them; measure more, lower the rank of E or widen it")
    return region


def _solve(A1, C, TF, region, alpha):
    """Return P, Y of (15), (16), (30), (31), time in units of 1/centre, e_f scaled by sqrt(alpha centre)."""
    from scipy.linalg import null_space, orth  # imports of SciPy cost a start a tenth of a second

    cp, n, hidden, Cr = lmi.cvxpy(), len(A1), null_space(C), orth(C.T).T
    P, Yr, t = cp.Variable((n, n), symmetric=True), cp.Variable((n, len(Cr))), cp.Variable()
    TF, PN = TF / np.linalg.norm(TF, axis=0), P @ A1 / region.centre - Yr @ Cr
    held = [lmi.negative(side, MARGIN) for side in _left_sides(cp.bmat, P, PN, TF, region, alpha)]
    held += [P >> np.eye(n), P << t * np.eye(n)]
    held += [TF.T @ P @ hidden == 0.0] if hidden.shape[1] else []  # (16)
    # well-conditioned P, and N near the disk's centre: modest gains, and an f_hat/f that alpha can make flat
    try:
        lmi.solve(cp.Problem(cp.Minimize(t + cp.norm(PN + P, "fro")), held))
    except lmi.Infeasible as error:
        raise lmi.Infeasible(f"no P, Y satisfy (15), (16), (30), (31) for alpha = {alpha:g} and {region}; try alpha of "
                             f"{region.centre / 3:.3g} and above, or a slower region [{error}]") from error  # fmt: skip
    return P.value, region.centre * Yr.value @ Cr @ np.linalg.pinv(C)


def _left_sides(block, P, PN, TF, region, alpha):
    """Return the left sides of (15), (30), (31), time in units of 1/centre, e_f scaled by sqrt(alpha centre)."""
    unit = region.centre
    cross = -math.sqrt(unit / alpha) * PN.T @ TF
    return [
        block([[PN + PN.T, cross], [cross.T, -(2.0 - G_SHARE) * TF.T @ P @ TF]]),
        block([[-(region.radius / unit) * P, P + PN.T], [P + PN, -(region.radius / unit) * P]]),
        PN + PN.T + 2.0 * region.decay / unit * P,
    ]


def _substitute(P, N, TF, region, alpha):
    """Raise lmi.Infeasible where a solution violates an inequality when it is substituted back."""
    TF = TF / np.linalg.norm(TF, axis=0)
    sides = _left_sides(np.block, P, P @ N / region.centre, TF, region, alpha)
    for name, side in zip(("15", "30", "31"), sides, strict=True):
        if (value := lmi.violation(side)) > VIOLATED:
            raise lmi.Infeasible(f"({name}) is violated by {value:.1e} of its size when the solution is substituted "
                                 "back: the model is too ill-conditioned for this region")
