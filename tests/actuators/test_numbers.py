"""Numbers that everything here rests on: factors between units, linear algebra with the same bits on every processor,
pole placement.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import place_poles

from actuators import constants as c
from actuators.deterministic_linalg import place, rounded, solve


def test_a_factor_times_its_reverse_is_one():
    names = {n for n in vars(c) if "_PER_" in n and isinstance(getattr(c, n), float)}
    pairs = [(n, "_PER_".join(reversed(n.split("_PER_")))) for n in sorted(names)]
    both = [(a, b) for a, b in pairs if b in names]
    assert len(both) == 6
    for a, b in both:
        assert getattr(c, a) * getattr(c, b) == pytest.approx(1.0, rel=1e-15), (a, b)


def test_factors_are_those_of_the_definitions():
    assert math.degrees(1.0) == c.DEG_PER_RAD and pytest.approx(12.0 * c.M_PER_IN) == c.M_PER_FT
    assert 3600.0 * c.M_S_PER_KT == pytest.approx(1852.0)  # a nautical mile
    assert c.N_PER_LBF == pytest.approx(0.45359237 * c.G0)  # a pound
    assert c.KG_PER_SLUG * c.M_PER_FT == pytest.approx(c.N_PER_LBF)  # a slug: what a pound-force moves by 1 ft/s2
    assert c.PA_PER_PSF * c.M_PER_FT**3 == pytest.approx(c.N_M_PER_LBF_FT)


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
