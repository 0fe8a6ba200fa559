"""Physics bound: exact transfer functions and the least-squares sine as oracles."""

import math

import numpy as np
import pytest

from fdi.common.physics_bound import detectable_amplitude, motion_per_degree


def test_motion_of_an_integrator_with_feedthrough():
    """q' = 2 u, y = (q, 3 u): |q/u| = 2/w, |y2/u| = 3."""
    got = motion_per_degree([[0.0]], [[2.0]], [[1.0], [0.0]], [[0.0], [3.0]], [0.5, 2.0])
    w = 2 * math.pi * np.array([0.5, 2.0])
    assert got[:, 0, 0] == pytest.approx(2.0 / w)
    assert got[:, 1, 0] == pytest.approx([3.0, 3.0])


def test_columns_are_inputs_and_frequencies_are_positive():
    got = motion_per_degree(-np.eye(2), np.diag([1.0, 2.0]), np.eye(2), np.zeros((2, 2)), 1.0)
    assert got.shape == (1, 2, 2)
    assert got[0, 1, 1] == pytest.approx(2.0 / math.hypot(1.0, 2 * math.pi))
    with pytest.raises(ValueError, match="positive"):
        motion_per_degree(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), [0.0, 1.0])


def test_detectable_amplitude_is_three_sigma_of_the_least_squares_sine():
    rng, hz, dt, sigma = np.random.default_rng(1), 1.0, 0.005, 0.02
    n = round(3 / hz / dt)
    t = np.arange(n) * dt
    basis = np.stack([np.cos(2 * np.pi * hz * t), np.sin(2 * np.pi * hz * t)], 1)
    fits = np.linalg.lstsq(basis, rng.normal(size=(n, 2000)) * sigma, rcond=None)[0]
    least = detectable_amplitude(np.array([0.25]), sigma, frequencies_hz=[hz])
    assert least[0] * 0.25 == pytest.approx(3.0 * fits.std(), rel=0.03)
