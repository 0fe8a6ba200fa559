"""Affine linear-parameter-varying models on a grid of flight points, from arrays only. Source: [Alwi14] section 4.3.

| symbol | here |
|---|---|
| S(rho) = S_0 + rho_1 S_1 + ... + rho_nr S_nr, (27) | a stack of shape (1 + nr, rows, cols), `at(stack, rho)` |
| X of (29), columns [1 rho_1 .. rho_nr] | X of `fit`, in normalised rho for conditioning |
| min ||S - A X||_2, (31) | `fit`, insignificant and invariant entries fixed at their mean in S_0 |
| trim maps x, u, y over rho | `fit_trim`, polynomials; an LPV observer works on deviations from them |

The printed (29) has the first parameter's row missing (its rows run from rho_2); the sum in (27) needs all of them.
"""

import dataclasses
import itertools

import numpy as np

TRIM_DEGREE = 3  # cubic: an affine Z(Vc, M) misses the standard atmosphere by hundreds of metres inside the box


@dataclasses.dataclass(frozen=True)
class LpvModel:
    """Hold an affine LPV model in deviations from its trim maps: x' = A(rho) (x - x_eq(rho)) + B(rho) (u - u_eq(rho)).

    A (1+nr, n, n), B (1+nr, n, m), C (1+nr, p, n), D (1+nr, p, m); box (nr, 2) lowest and highest rho;
    trim (n + m + p, n_terms): polynomial coefficients of [x_eq; u_eq; y_eq] in the monomials of `powers(nr)` of
    z = 2 (rho - low) / (high - low) - 1. Source: [Alwi14] (26)-(28).
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    box: np.ndarray
    trim: np.ndarray


def at(stack: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Evaluate S(rho) = S_0 + sum rho_i S_i [Alwi14] (27); `rho` (nr,), result (rows, cols)."""
    return stack[0] + np.tensordot(np.asarray(rho, float), stack[1:], axes=1)


def vertices(box: np.ndarray) -> np.ndarray:
    """Return the 2^nr corners of `box` (nr, 2) as (2^nr, nr)."""
    return np.array(list(itertools.product(*np.asarray(box, float))))


def powers(nr: int, degree: int = TRIM_DEGREE) -> np.ndarray:
    """Return the exponents (n_terms, nr) of all monomials up to total `degree`, the constant first."""
    return np.array([e for e in itertools.product(range(degree + 1), repeat=nr) if sum(e) <= degree])


def normalise(rho: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Map rho (..., nr) into [-1, 1] over `box`."""
    low, high = np.asarray(box, float).T
    return 2 * (np.asarray(rho, float) - low) / (high - low) - 1


def fit(
    rho: np.ndarray, S: np.ndarray, *, box: np.ndarray, tolerance: float = 0.02, scale: np.ndarray | None = None,
    weight: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Fit S(rho) = S_0 + sum rho_i S_i to samples by least squares, insignificant entries fixed [Alwi14] (29)-(32).

    rho (k, nr), S (k, rows, cols); returns (stack (1+nr, rows, cols), fixed (rows, cols) of bool). An entry is
    *invariant* when its range over the grid is at most `tolerance` of its largest value, and *insignificant* when
    its largest value times its column's `scale` is at most `tolerance` of the largest such product in its row;
    `scale` (cols,) says how large that column's signal gets (default: 1 each). Those keep their mean in S_0.
    `weight` (k,): how much each sample's squared error counts (default: 1 each). Raises ValueError when the grid cannot
    determine nr + 1 coefficients.
    """
    rho, S = np.asarray(rho, float), np.asarray(S, float)
    X = np.column_stack([np.ones(len(rho)), normalise(rho, box)])
    if np.linalg.matrix_rank(X) < X.shape[1]:
        raise ValueError(f"{len(rho)} grid points leave the {X.shape[1]} coefficients of an affine model undetermined")
    k, rows, cols = S.shape
    weight = np.ones(k) if weight is None else np.asarray(weight, float)
    root = np.sqrt(weight)[:, None]
    theta = np.linalg.lstsq(root * X, root * S.reshape(k, -1), rcond=None)[0].reshape(-1, rows, cols)
    size = np.abs(S).max(0)
    reach = size * (np.ones(cols) if scale is None else np.asarray(scale, float))
    fixed = (np.ptp(S, axis=0) <= tolerance * size) | (reach <= tolerance * reach.max(1, keepdims=True))
    theta[:, fixed] = 0
    theta[0, fixed] = np.average(S, axis=0, weights=weight)[fixed]
    return _raw(theta, box), fixed


def fit_trim(rho: np.ndarray, values: np.ndarray, *, box: np.ndarray, degree: int = TRIM_DEGREE) -> np.ndarray:
    """Fit the trim maps: least-squares polynomials of `values` (k, n_values) over `rho` (k, nr); (n_values, n_terms).

    Terms that the grid does not determine come out with least norm. A direction in which the grid does not vary at
    all stays constant.
    """
    z = normalise(rho, box)
    basis = np.prod(z[:, None, :] ** powers(z.shape[1], degree), axis=2)
    return np.linalg.lstsq(basis, np.asarray(values, float), rcond=1e-9)[0].T


def _raw(theta, box):
    """Turn coefficients in normalised rho into coefficients in rho itself."""
    low, high = np.asarray(box, float).T
    slope = 2 / (high - low)
    mean = theta[0] - np.tensordot(low * slope + 1, theta[1:], axes=1)
    return np.concatenate([mean[None], slope[:, None, None] * theta[1:]])
