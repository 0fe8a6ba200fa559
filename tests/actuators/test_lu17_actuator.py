"""[Lu17] equation (4): the figures that follow from its parameters, and its derivatives."""

import numpy as np
import pytest

from actuators.hydraulic import lu17

P = lu17.params()[0]


def test_poles_of_the_linearised_actuator():
    a22, a23, a31, a32, a33, _, _ = lu17.jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, P)
    poles = np.sort_complex(np.linalg.eigvals([[0, 1, 0], [0, a22, a23], [a31, a32, a33]]))
    assert poles[-1] == 0
    assert poles[1].real == pytest.approx(-2.09, abs=0.005)
    assert abs(poles[1].imag) == pytest.approx(56.2, abs=0.05)


def test_full_valve_drives_an_unloaded_rod_at_one_metre_per_second():
    """Steady state of (4) but for damping and leakage (B x2 is 0.15 % of the stall force); cross-checked by hand."""
    assert lu17.rhs(0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, P)[2] == pytest.approx(0.0, abs=1e-12)


def test_stall_force():
    assert P.A_p * P.P_s == pytest.approx(35e3, rel=1e-12)
    assert lu17.rhs(0.0, 0.0, 1.0, 1.0, 1.0, 0.0, -35e3, P)[1] == pytest.approx(0.0, abs=1e-12)
    assert lu17.opening(1.0, 1.2) == 0.0


@pytest.mark.parametrize(
    "x", [(0.05, 0.2, 0.3, 0.1, 0.02), (-0.1, -0.1, -0.6, -0.2, 0.0), (0.02, 0.1, 0.5, -0.1, 0.05)]
)
def test_jacobian_is_the_derivative(x):
    def f(z):
        return np.array(lu17.rhs(z[0], z[1], z[2], x[3], z[3], z[4], z[5], P))

    z0 = np.array([*x, 1e3])
    steps = np.array([1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1.0])
    numeric = np.array([(f(z0 + d) - f(z0 - d)) / (2 * d.sum()) for d in np.diag(steps)]).T
    a22, a23, a31, a32, a33, b3, e2 = lu17.jacobian(*x[:3], x[3], x[3], x[4], P)
    expected = [[0, 1, 0, 0, 0, 0], [0, a22, a23, 0, 0, e2], [a31, a32, a33, b3, b3, 0]]
    np.testing.assert_allclose(numeric, expected, rtol=1e-6, atol=1e-6)


def test_runge_kutta_converges_with_fourth_order():
    def fly(h, n):
        x = (0.01, 0.0, 0.0)
        for _ in range(n):
            x = lu17.rk4(*x, 0.1, 0.1, 0.0, -5e3, P, h)
        return np.array(x)

    exact = fly(0.005 / 64, 1280)
    errors = [np.abs(fly(0.005 / m, 20 * m) - exact).max() for m in (1, 2, 4)]
    assert 3.5 < np.log2(errors[0] / errors[1]) < 4.5
    assert 3.5 < np.log2(errors[1] / errors[2]) < 4.5
