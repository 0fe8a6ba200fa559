"""Equation (4) of [Lu17], transcribed literally with the constants printed below (6): the truth of the bench.

Truth and filters share no line of code: the filters hold `actuators.hydraulic.lu17`.
"""

import math

from actuators.block import kernel

A_P = 0.0025  # piston area [m2]
B = 52.3  # damping [N s/m]
P_S = 1.4e7  # reservoir oil pressure [N/m2]
PHI_N = 0.0025  # maximum valve flow [m3/s]
V_M = 0.001973  # mean actuator chamber volume [m3]
E = 1e9  # oil bulk modulus [N/m2]
M = 2000.0  # mass of moving system [kg]
L = 0.023  # normalised leakage [m/s]


@kernel
def rate(x1, x2, x3, u, f, F_d):
    """Return (x1', x2', x3') of (4) [m/s, m/s2, 1/s]; no root of a load beyond the supply."""
    sign = 1.0 if u > 0.0 else -1.0 if u < 0.0 else 0.0
    root = math.sqrt(max(1.0 - sign * x3, 0.0))
    return (
        x2,
        (A_P * P_S * x3 - B * x2 + F_d) / M,
        2.0 * A_P * E * V_M / (P_S * (V_M**2 - A_P**2 * x1**2)) * (PHI_N / A_P * root * (u + f) - L * x3 - x2),
    )


@kernel
def advance(x1, x2, x3, u, f, F_d, h):
    """Return (x1, x2, x3) after `h` seconds of (4): one step of the classic Runge-Kutta rule."""
    a1, a2, a3 = rate(x1, x2, x3, u, f, F_d)
    b1, b2, b3 = rate(x1 + h / 2 * a1, x2 + h / 2 * a2, x3 + h / 2 * a3, u, f, F_d)
    c1, c2, c3 = rate(x1 + h / 2 * b1, x2 + h / 2 * b2, x3 + h / 2 * b3, u, f, F_d)
    d1, d2, d3 = rate(x1 + h * c1, x2 + h * c2, x3 + h * c3, u, f, F_d)
    return (
        x1 + h / 6 * (a1 + 2 * b1 + 2 * c1 + d1),
        x2 + h / 6 * (a2 + 2 * b2 + 2 * c2 + d2),
        x3 + h / 6 * (a3 + 2 * b3 + 2 * c3 + d3),
    )
