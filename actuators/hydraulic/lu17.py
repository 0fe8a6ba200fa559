"""Equation (4) of [Lu17], written once: the hydraulic servo-actuator without friction, stops or relief valve.

The flying truth (`hydraulic`) adds what the filters do not know; filters use this module as it stands.

| symbol | field | meaning | nominal |
|---|---|---|---|
| q, x1 | | rod position, + extends = trailing edge down [m] | |
| q', x2 | | rod velocity [m/s] | |
| dP/P_s, x3 | | pressure difference over supply, + pushes the rod out [1] | |
| u | | valve command [1]; 1 is the full flow phi_n, 1 m/s of unloaded rod | |
| f^i | f | input fault, in the unit of u [1] | |
| F_d | | external force on the rod, + pushes it out [N] | |
| A_p | A_p | piston area [m^2] | 0.0025 |
| B | B | viscous damping [N s/m] | 52.3 |
| M | M | mass of the moving system [kg] | 2000 |
| P_s | P_s | supply pressure [N/m^2] | 1.4e7 |
| phi_n | phi_n | maximum valve flow [m^3/s] | 0.0025 |
| V_m | V_m | mean chamber volume [m^3] | 0.001973 |
| E | E | bulk modulus of the oil [N/m^2] | 1e9 |
| L | L | normalised leakage [m/s] | 0.023 |

`p` in every kernel is any record that has the fields of `FIELDS`: a filter appends them to its own PARAMS (not first:
Numba warns of a record that begins like another one).
"""

import math
from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.common.limits import sign

FIELDS = [
    ("A_p", "f8"),  # piston area [m^2]
    ("B", "f8"),  # viscous damping [N s/m]
    ("M", "f8"),  # mass of the moving system [kg]
    ("P_s", "f8"),  # supply pressure [N/m^2]
    ("phi_n", "f8"),  # maximum valve flow [m^3/s]
    ("V_m", "f8"),  # mean chamber volume [m^3]
    ("E", "f8"),  # bulk modulus of the oil [N/m^2]
    ("L", "f8"),  # normalised leakage [m/s]
]
NOMINAL = {
    "A_p": 0.0025, "B": 52.3, "M": 2000.0, "P_s": 1.4e7, "phi_n": 0.0025, "V_m": 0.001973, "E": 1e9, "L": 0.023,
}  # [Lu17] below (6)

# The square root of (4) has an infinite slope where the load takes the whole supply; its derivatives stop growing here.
ROOT_FLOOR = 0.05
# (4) is singular at |q| = V_m / A_p = 0.789 m, far outside every stroke; a diverging estimate meets this floor instead.
VOLUME_FLOOR = 0.1


@kernel
def opening(v, x3):
    """Return sqrt(1 - sign(v) x3), zero where the load exceeds the supply (the check valve lets no oil back) [1]."""
    return math.sqrt(max(1.0 - sign(v) * x3, 0.0))


@kernel
def stiffness(x1, p):
    """Return 2 A_p E V_m / (P_s (V_m^2 - A_p^2 x1^2)), the gain from net rod speed to x3' [1/m]."""
    V2 = p.V_m * p.V_m
    volume2 = max(V2 - p.A_p * p.A_p * x1 * x1, VOLUME_FLOOR * V2)
    return 2.0 * p.A_p * p.E * p.V_m / (p.P_s * volume2)


@kernel
def rhs(x1, x2, x3, v, u, f, F_d, p):
    """Return (x1', x2', x3') of (4).

    x1' = x2
    x2' = (A_p P_s x3 - B x2 + F_d) / M
    x3' = stiffness(x1) (phi_n / A_p opening(v, x3) (u + f) - L x3 - x2)

    `v` is the signal whose sign chooses the supplied chamber: u for the paper's filters, u + f for the truth. They
    differ under a solid OFC. [Lu17] (4)
    """
    dx2 = (p.A_p * p.P_s * x3 - p.B * x2 + F_d) / p.M
    flow = p.phi_n / p.A_p * opening(v, x3) * (u + f)
    return x2, dx2, stiffness(x1, p) * (flow - p.L * x3 - x2)  # [Lu17] (4)


@kernel
def jacobian(x1, x2, x3, v, u, f, p):
    """Return the entries (a22, a23, a31, a32, a33, b3, e2) of the derivatives of (4) that are not constant.

    A = [[0, 1, 0], [0, a22, a23], [a31, a32, a33]], d(x')/du = d(x')/df = [0, 0, b3], d(x')/dF_d = [0, e2, 0].
    Exact, but for the root in a33 kept above ROOT_FLOOR and zero slope where the root is clamped. [Lu17] (19)
    """
    s = sign(v)
    k = stiffness(x1, p)
    root = opening(v, x3)
    gain = p.phi_n / p.A_p
    net = gain * root * (u + f) - p.L * x3 - x2
    volume2 = max(p.V_m * p.V_m - p.A_p * p.A_p * x1 * x1, VOLUME_FLOOR * p.V_m * p.V_m)
    a31 = k * 2.0 * p.A_p * p.A_p * x1 / volume2 * net
    slope = -0.5 * s / max(root, ROOT_FLOOR) if root > 0.0 else 0.0
    a33 = k * (gain * slope * (u + f) - p.L)
    return -p.B / p.M, p.A_p * p.P_s / p.M, a31, -k, a33, k * gain * root, 1.0 / p.M


def linear(p: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return (A, B) of (q, q', x3) over u by (4) at rest and centre, without a load, shapes (3, 3), (3, 1)."""
    a22, a23, a31, a32, a33, b3, _ = jacobian(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, p)
    return np.array([[0, 1, 0], [0, a22, a23], [a31, a32, a33]]), np.array([[0.0], [0.0], [b3]])


@kernel
def rk4(x1, x2, x3, v, u, f, F_d, p, h):
    """Return (x1, x2, x3) after one Runge-Kutta step of `h` seconds with all inputs held."""
    a1, a2, a3 = rhs(x1, x2, x3, v, u, f, F_d, p)
    b1, b2, b3 = rhs(x1 + 0.5 * h * a1, x2 + 0.5 * h * a2, x3 + 0.5 * h * a3, v, u, f, F_d, p)
    c1, c2, c3 = rhs(x1 + 0.5 * h * b1, x2 + 0.5 * h * b2, x3 + 0.5 * h * b3, v, u, f, F_d, p)
    d1, d2, d3 = rhs(x1 + h * c1, x2 + h * c2, x3 + h * c3, v, u, f, F_d, p)
    w = h / 6.0
    return (
        x1 + w * (a1 + 2.0 * (b1 + c1) + d1),
        x2 + w * (a2 + 2.0 * (b2 + c2) + d2),
        x3 + w * (a3 + 2.0 * (b3 + c3) + d3),
    )
