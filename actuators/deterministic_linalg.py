"""Linear algebra with the same bits on every processor.

BLAS picks its kernels by the processor, so that what it solves differs in the last bits from one to the next. What a
flight starts from goes through here; all else of a flight is elementwise and compiled without reordered sums.
"""

import numpy as np


def rounded(values: np.ndarray, digits: int) -> np.ndarray:
    """Return `values` (…) rounded to so many significant decimal digits: fewer than BLAS kernels differ in."""
    flat = [float(f"{x:.{digits - 1}e}") for x in np.ravel(values)]
    return np.array(flat).reshape(np.shape(values))


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
