"""Linear algebra with the same bits on every processor.

BLAS picks its kernels by the processor, so that what it solves differs in the last bits from one to the next. What a
flight starts from goes through here; all else of a flight is elementwise and compiled without reordered sums.
"""

from typing import Any

import numpy as np


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """Return `values` (…) rounded to so many significant decimal digits: fewer than BLAS kernels differ in."""
    flat = [float(f"{x:.{digits - 1}e}") for x in np.ravel(values)]
    return np.array(flat).reshape(np.shape(values))


def place(A: np.ndarray, B: np.ndarray, poles: Any) -> np.ndarray:
    """Return K (n,) for which A - B K has `poles`; A (n, n), B (n, 1).

    Ackermann's formula: K = (0 ... 0 1) C^-1 phi(A) with the controllability matrix C and the wanted polynomial phi.
    `scipy.signal.place_poles` does it too, and more, but importing it takes a second of a start that should take two.
    Raises numpy.linalg.LinAlgError where (A, B) is not controllable.
    """
    n = len(A)
    columns, phi = [B[:, 0]], np.zeros((n, n))
    for _ in range(n - 1):
        columns.append(A @ columns[-1])
    for c in np.real(np.poly(poles)):
        phi = phi @ A + c * np.eye(n)
    return np.linalg.solve(np.column_stack(columns).T, np.eye(n)[-1]) @ phi


def solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return x (n,) of A x = b, A (n, n), by elimination with pivots of rows; for the few unknowns of a trim.

    Raises numpy.linalg.LinAlgError where A is singular.
    """
    n = len(b)
    both = np.column_stack([A, b]).astype(float)
    for k in range(n):
        pivot = k + int(np.argmax(np.abs(both[k:, k])))
        if not both[pivot, k]:
            raise np.linalg.LinAlgError("singular matrix")
        both[[k, pivot]] = both[[pivot, k]]
        both[k + 1 :] -= (both[k + 1 :, k] / both[k, k])[:, None] * both[k]
    x = np.zeros(n)
    for k in reversed(range(n)):
        x[k] = (both[k, n] - sum(both[k, j] * x[j] for j in range(k + 1, n))) / both[k, k]
    return x
