"""[Lu17] equation (4): the figures that follow from its parameters, and how it is integrated."""

import numpy as np
import pytest

from actuators.hydraulic import actuator, lu17

P = actuator.params()[0]


def test_poles_of_the_linearised_actuator():
    a22, a23, a31, a32, a33, _, _ = lu17.jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, P)
    poles = np.sort_complex(np.linalg.eigvals([[0, 1, 0], [0, a22, a23], [a31, a32, a33]]))
    assert poles[-1] == 0
    assert poles[1].real == pytest.approx(-2.09, abs=0.005)
    assert abs(poles[1].imag) == pytest.approx(56.2, abs=0.05)


def test_stall_force():
    assert P.A_p * P.P_s == pytest.approx(35e3, rel=1e-12)
    assert lu17.rhs(0.0, 0.0, 1.0, 1.0, 1.0, 0.0, -35e3, P)[1] == pytest.approx(0.0, abs=1e-12)
    assert lu17.opening(1.0, 1.2) == 0.0


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
