"""Numbers with the same bits on every processor: what they are rounded to, and the solver without BLAS."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actuators.deterministic_linalg import rounded, solve


def test_what_kernels_differ_in_is_rounded_away():
    x = np.array([[1.0, -2.5e-9], [0.0, 3.3e12]])
    assert rounded(x * (1 + 1e-14), 9).tobytes() == rounded(x * (1 - 1e-14), 9).tobytes()
    assert rounded(np.array(123.456), 4) == 123.5


@given(st.integers(0, 10_000), st.integers(1, 6))
def test_solves_as_lapack_does(seed, n):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(n, n)) * 10.0 ** rng.integers(-3, 4, (n, 1)), rng.normal(size=n)
    x = solve(A, b)
    np.testing.assert_allclose(A @ x, b, rtol=0.0, atol=1e-9 * np.abs(A).max() * (1.0 + np.abs(x).max()))


def test_rows_are_exchanged_and_a_singular_matrix_is_refused():
    np.testing.assert_array_equal(solve(np.array([[0.0, 2.0], [4.0, 0.0]]), np.array([2.0, 8.0])), [2.0, 1.0])
    with pytest.raises(np.linalg.LinAlgError):
        solve(np.ones((2, 2)), np.ones(2))
