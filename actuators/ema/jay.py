"""The electromechanical actuator of [Jay]: continuous model, discretisation, and the matrices as printed.

The paper prints Phi and G for 5 ms; twelve continuous parameters of the printed structure give back all 37 entries
within their last digit. The printed A has the lever arm l in the wrong places; here it stands where Phi says.

| symbol | field | meaning |
|---|---|---|
| x1, x2 | | surface (nozzle) angle [rad] and rate [rad/s] |
| x3, x4 | | motor angle [rad] and rate [rad/s]; N x3 is the position that the sensor sees [m] |
| x5 | | motor current [A] |
| x6 | | state of the compensator (s + a) / (s + b) |
| u | | servo amplifier input |
| l | arm | lever arm [m] |
| N | lead | ball screw, metres per radian of motor [m/rad] |
| K_s | K_s | stiffness of mount and screw [N/m] |
| J_N, B_N | J_N, B_N | inertia [kg m^2] and damping [N m s/rad] of the surface |
| J_M, B_M | J_M, B_M | inertia [kg m^2] and damping [N m s/rad] of the motor |
| K_T, K_B | K_T, K_B | torque constant [N m/A], back electromotive force [V s/rad] |
| R, L | R, L | winding resistance [Ohm] and inductance [H] |
| K_i K_c | K_ic | gain of the current loop, volts per ampere [V/A] |
| K_g K_i | K_gi | gain of the amplifier, volts per unit of u [V] |
| a, b | a, b | zero and pole of the compensator [1/s] |
"""

from typing import Any, NamedTuple

import numpy as np

from actuators.deterministic_linalg import rounded

# [Jay] section 4, T = 5 ms, as printed
PHI = np.array([
    [0.8789, 0.00474, 0.0009691, 1.621e-6, 1.109e-7, -0.001675],
    [-46.97, 0.857, 0.3759, 0.000957, 6.709e-5, -1.285],
    [4.078, 0.006852, 0.9674, 0.004851, 0.0003481, -9.098],
    [1577, 4.046, -12.62, 0.9295, 0.06848, -3043],
    [-17.9, -0.04479, 0.1433, -0.01081, -0.0007965, -501.1],
    [0, 0, 0, 0, 0, 0.2753],
])
G = np.array([8.223e-6, 0.006389, 0.04617, 16.21, 3.437, 0.002809])
PERIOD = 0.005  # [s]
K_P, K_V = 400.0, 0.05  # sensors: LVDT [V/m], velocity [V s/rad]; [Jay] section 2


class Continuous(NamedTuple):
    """A model x' = A x + B u + E d; d: moment on the surface [N m]; `values`: the symbols."""

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    values: dict


def _nozzle():
    """Return the symbols behind the printed matrices.

    Only ratios are observable in Phi and G; arm, R's share of the current loop (they give the paper's row on 5 % of
    resistance) and L (which scales forces, not motion, with K_T = K_B in SI) are chosen.
    """
    a21, a22, a23, a41, a43, a44 = 10025.9, 4.61611, 80.2301, 339214.0, 2714.47, 0.967879
    a45, a54, loop, drive = 603.297, 95.2571, 8210.38, 72699.4
    arm, L, share = 0.125, 1.0e-3, 0.9
    # a21 a43 = a23 a41 is missed by 5e-6 in the printed digits: the mean of both ratios puts 3e-6 on a23 and on a41
    lead = arm * ((a23 / a21) * (a43 / a41)) ** 0.5
    K_T = a54 * L
    J_M = K_T / a45
    K_s = a43 * J_M / lead**2
    J_N = arm**2 * K_s / a21
    return {
        "arm": arm, "lead": lead, "K_s": K_s, "J_N": J_N, "B_N": a22 * J_N, "J_M": J_M, "B_M": a44 * J_M, "K_T": K_T,
        "K_B": K_T, "R": share * loop * L, "L": L, "K_ic": (1 - share) * loop * L, "K_gi": drive * L, "a": 45.0,
        "b": 257.987,
    }  # fmt: skip


def _elevator():
    """Return the set for one elevator segment: stall 15.75 kN m, 45 deg/s at no load.

    A set of 37.8 kN m, 105 A, 285 V (arm 0.15 m, 0.25 mm/rad, l^2 K_s 2.4 MN m/rad, J_M 0.006, K_T 0.6, R 0.10 Ohm,
    L 0.5 mH, K_i K_c 4 V/A) scaled to 1.5 times the 10.5 kN m that stall the hydraulic actuator: torque, motor inertia
    and current by the ratio, resistance and inductance by its inverse; speeds, volts, time constants and the stiffness,
    which is the structure's, unchanged. u is the demanded current [A]: K_g K_i = K_i K_c. The lead of the paper's
    torque loop is left out (a = b), the servo's velocity feedback does its work. Damping rates B/J are the nozzle's.
    """
    ratio = 15.75e3 / 37.8e3
    arm, J_N, J_M = 0.15, 50.0, 0.006 * ratio
    return {
        "arm": arm, "lead": 0.25e-3, "K_s": 2.4e6 / arm**2, "J_N": J_N, "B_N": 4.61611 * J_N, "J_M": J_M,
        "B_M": 0.967879 * J_M, "K_T": 0.6, "K_B": 0.6, "R": 0.10 / ratio, "L": 0.5e-3 / ratio, "K_ic": 4.0 / ratio,
        "K_gi": 4.0 / ratio, "a": 257.987, "b": 257.987,
    }  # fmt: skip


UNLIMITED = 1e9  # current, voltage and stops of the nozzle: the paper gives none
# current and voltage limits [A], [V]
LIMITS = {"nozzle": (UNLIMITED, UNLIMITED), "elevator": (43.75, 285.0)}


def values(kind: str = "elevator", **overrides: Any) -> dict:
    """Return the symbols of set `kind` ("nozzle" or "elevator") with `overrides`; unknown names raise ValueError."""
    sets = {"nozzle": _nozzle, "elevator": _elevator}
    if kind not in sets:
        raise ValueError(f"unknown set {kind!r}: one of {', '.join(sets)}")
    out = sets[kind]()
    if unknown := overrides.keys() - out.keys():
        raise ValueError(f"unknown symbol {sorted(unknown)}: one of {', '.join(out)}")
    return {**out, **overrides}


def continuous(set: str = "nozzle", *, hinge_stiffness: float = 0.0, **overrides: Any) -> Continuous:
    """Return the continuous model of `set` in SI, shapes (6, 6), (6,), (6,).

    `hinge_stiffness` [N m/rad] is the moment per angle of the surface, negative when it holds the surface back.
    a21 a43 = a23 a41 holds by construction: the unloaded motor turns free of the spring. [Jay] (1)
    """
    v = values(set, **overrides)
    l, N, K_s = v["arm"], v["lead"], v["K_s"]
    A = np.zeros((6, 6))
    A[0, 1] = A[2, 3] = 1.0
    A[1, :3] = [(-l * l * K_s + hinge_stiffness) / v["J_N"], -v["B_N"] / v["J_N"], l * N * K_s / v["J_N"]]
    A[3, [0, 2, 3, 4]] = [l * N * K_s / v["J_M"], -N * N * K_s / v["J_M"], -v["B_M"] / v["J_M"], v["K_T"] / v["J_M"]]
    drive = v["K_gi"] / v["L"]
    A[4, 3:] = [-v["K_B"] / v["L"], -(v["K_ic"] + v["R"]) / v["L"], -drive * (v["b"] - v["a"])]
    A[5, 5] = -v["b"]
    B = np.array([0, 0, 0, 0, drive, 1.0])
    return Continuous(A, B, np.array([0, 1.0 / v["J_N"], 0, 0, 0, 0]), v)


def discretise(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[Any, ...]:
    """Return (Phi, Gamma) of x' = A x + B u with u held over `dt`, exactly: one exponential of [[A, B], [0, 0]] dt."""
    from scipy.linalg import expm  # a tenth of a second that a start need not wait for

    n = A.shape[0]
    B = np.asarray(B).reshape(n, -1)
    both = np.zeros((n + B.shape[1],) * 2)
    both[:n, :n], both[:n, n:] = A, B
    e = rounded(expm(both * dt), 13)
    return e[:n, :n], e[:n, n:]
