"""Pole placement for one input by Ackermann's formula.

`scipy.signal.place_poles` does it too, and more, but importing it takes a second of a start that should take two.
"""

from typing import Any

import numpy as np


def place(A: np.ndarray, B: np.ndarray, poles: Any) -> np.ndarray:
    """Return K (n,) for which A - B K has `poles`.

    K = (0 ... 0 1) C^-1 phi(A) with the controllability matrix C and the wanted polynomial phi; A (n, n), B (n, 1).
    Raises numpy.linalg.LinAlgError where (A, B) is not controllable.
    """
    n = len(A)
    columns, phi = [B[:, 0]], np.zeros((n, n))
    for _ in range(n - 1):
        columns.append(A @ columns[-1])
    for c in np.real(np.poly(poles)):
        phi = phi @ A + c * np.eye(n)
    return np.linalg.solve(np.column_stack(columns).T, np.eye(n)[-1]) @ phi
