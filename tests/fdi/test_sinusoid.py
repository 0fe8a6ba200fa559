"""Sums over a ring: of two signals with a sine, and of what the sine leaves of them."""

import numpy as np
import pytest

from fdi.common import sinusoid

N, RING, FIRST, ANGLE = 17, 24, 15, 0.7  # the samples run over the end of the ring


@pytest.fixture
def rings():
    """Two rings, and the samples of them that count, oldest first."""
    F, D = np.random.default_rng(5).standard_normal((2, RING)) + np.array([[3.0], [-1.0]])
    at = (FIRST + np.arange(N)) % RING
    return F, D, F[at], D[at]


def test_products_are_the_sums_of_the_newest_samples_less_the_mean_of_the_first(rings):
    F, D, f, d = rings
    f = f - 0.8
    turn = ANGLE * (np.arange(N) - 0.5 * (N - 1))
    c, s = np.cos(turn), np.sin(turn)
    pairs = [(f, f), (f, d), (d, d), (f, c), (f, s), (d, c), (d, s), (c, c), (c, s), (s, s)]
    expected = [f.sum(), d.sum(), *(a @ b for a, b in pairs)]
    assert sinusoid.products(F, D, FIRST, N, ANGLE, 0.8) == pytest.approx(expected, abs=1e-12)


def test_what_is_beside_a_sine_is_the_rest_of_least_squares(rings):
    F, D, f, d = rings
    turn = ANGLE * np.arange(N)
    X = np.stack([np.cos(turn), np.sin(turn)], 1)
    f, d = (y - X @ np.linalg.lstsq(X, y)[0] for y in (f, d))
    assert sinusoid.beside(F, D, FIRST, N, ANGLE) == pytest.approx((f @ f, f @ d, d @ d), abs=1e-9)
