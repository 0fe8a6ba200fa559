"""Pole placement agrees with SciPy's, which is too slow to import at every start."""

import numpy as np
import pytest
from scipy.signal import place_poles

from actuators.common.ackermann import place


@pytest.mark.parametrize("n", [2, 3, 4])
def test_agrees_with_scipy(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        A, B = rng.standard_normal((n, n)), rng.standard_normal((n, 1))
        poles = rng.uniform(0.2, 0.9, n)
        K = place(A, B, poles)
        np.testing.assert_allclose(K, place_poles(A, B, poles).gain_matrix[0], rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(np.sort(np.linalg.eigvals(A - B @ K[None]).real), np.sort(poles), atol=1e-6)


def test_an_uncontrollable_pair_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        place(np.eye(2), np.array([[1.0], [0.0]]), [0.1, 0.2])
