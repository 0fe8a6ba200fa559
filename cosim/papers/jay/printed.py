"""[Jay] as it is printed: Phi, G, H, P_0, R and (5) to (9), and the plant behind them; nothing of ours is used for it.

The printed matrices are for 5 ms and rounded; PLANT are the continuous numbers of the printed structure that give back
all 37 entries. a21 a43 = a23 a41 holds by the one ratio N / l: the motor turns free of the spring. The lever arm and
R's share of the current loop are not printed (`bench`).
"""

import numpy as np
from scipy.linalg import expm
from scipy.signal import cont2discrete

PERIOD = 0.005  # [s]
PHI = """
    0.8789   0.00474   0.0009691  1.621E-6   1.109E-7    -0.001675
    -46.97   0.857     0.3759     0.000957   6.709E-5    -1.285
    4.078    0.006852  0.9674     0.004851   0.0003481   -9.098
    1577     4.046     -12.62     0.9295     0.06848     -3043
    -17.9    -0.04479  0.1433     -0.01081   -0.0007965  -501.1
    0        0         0          0          0           0.2753
"""
G = "8.223E-6  0.006389  0.04617  16.21  3.437  0.002809"
H = "0  0  0  0.05  0  0"
P_0 = (0.0003, 0.0003, 0.0003, 0.0003, 0.01, 0.01)
R = 0.0025
PLANT = {  # [1/s2], [1/s], ...: a_ij of the printed A, the loop's rate, its drive, pole and zero of the compensator
    "a21": 10025.9, "a22": 4.61611, "a23": 80.2301, "a41": 339214.0, "a43": 2714.47, "a44": 0.967879, "a45": 603.297,
    "a54": 95.2571, "loop": 8210.38, "drive": 72699.4, "a": 45.0, "b": 257.987,
}  # fmt: skip
ARM, SHARE = 0.125, 0.9  # lever arm [m] and R's share of the loop: chosen
RATIO = ((PLANT["a23"] / PLANT["a21"]) * (PLANT["a43"] / PLANT["a41"])) ** 0.5  # N / l
LEAD = ARM * RATIO  # N [m/rad]


def entries() -> tuple[np.ndarray, np.ndarray]:
    """Return (printed entries that are not zero, half of the last digit of each): Phi by rows, G, H."""
    words = [w for w in f"{PHI} {G} {H}".split() if float(w)]
    half = []
    for w in words:
        digits, _, power = w.lstrip("-").upper().partition("E")
        half.append(0.5 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2])))
    return np.array([float(w) for w in words]), np.array(half)


def plant(resistance: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (Phi, G, Gamma) of the truth over a tick: state (6), demand, bias of the loop's current sensor [A].

    `resistance`: rise of R as a fraction.
    """
    p, A, B = PLANT, np.zeros((6, 6)), np.zeros((6, 2))
    A[0, 1] = A[2, 3] = 1.0
    A[1, :3] = -p["a21"], -p["a22"], p["a21"] * RATIO
    A[3, [0, 2, 3, 4]] = p["a43"] / RATIO, -p["a43"], -p["a44"], p["a45"]
    A[4, 3:] = -p["a54"], -p["loop"] * (1.0 + SHARE * resistance), -p["drive"] * (p["b"] - p["a"])
    A[5, 5] = -p["b"]
    B[4, 0], B[5, 0], B[4, 1] = p["drive"], 1.0, -(1.0 - SHARE) * p["loop"]
    Phi, G, *_ = cont2discrete((A, B, np.eye(6), np.zeros((6, 2))), PERIOD)
    return Phi, G[:, 0], G[:, 1]


def motion(v: dict, hinge: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return (A, B) of (1) from its symbols, l where Phi has it; `hinge` [N m/rad] on the surface; B: u, moment."""
    l, N, K_s, gain = v["arm"], v["lead"], v["K_s"], v["K_gi"] / v["L"]
    J_N, J_M = v["J_N"], v["J_M"]
    A = np.array([
        [0, 1, 0, 0, 0, 0],
        [(hinge - l**2 * K_s) / J_N, -v["B_N"] / J_N, l * N * K_s / J_N, 0, 0, 0],
        [0, 0, 0, 1, 0, 0],
        [l * N * K_s / J_M, 0, -N**2 * K_s / J_M, -v["B_M"] / J_M, v["K_T"] / J_M, 0],
        [0, 0, 0, -v["K_B"] / v["L"], -(v["K_ic"] + v["R"]) / v["L"], -gain * (v["b"] - v["a"])],
        [0, 0, 0, 0, 0, -v["b"]],
    ])  # fmt: skip
    return A, np.array([[0, 0, 0, 0, gain, 1.0], [0, 1 / J_N, 0, 0, 0, 0]]).T


def kalman(
    u: np.ndarray, velocity: np.ndarray, position: np.ndarray, current: np.ndarray, elevator: dict | None = None
) -> tuple[np.ndarray, ...]:
    """Return (eta_bar, R1 [m], R2 [A]) of (5) to (9), each (ticks,), from the demand and the sensors.

    (5) is printed without Phi in the prediction of the state; it is Phi (x + K gamma) + G u. `u[k]` is the demand over
    the tick that ends at sample k. `elevator`: the symbols of another set, sensors a tick late, begun at its position.
    """
    late, lead = int(elevator is not None), elevator["lead"] if elevator else LEAD
    x, P, H = np.zeros(6), np.diag(P_0), np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.0])
    if elevator:
        Phi, G, *_ = cont2discrete((*motion(elevator), np.eye(6), np.zeros((6, 2))), PERIOD)
        G = G[:, 0]
        x[:3] = position[0] / elevator["arm"], 0.0, position[0] / lead  # the spring is at rest
    else:
        Phi, G, _ = plant()
    eta, R1, R2 = np.zeros(len(u)), np.zeros(len(u)), np.zeros(len(u))
    for k in range(len(u)):
        if k:
            x, P = Phi @ x + G * u[k - late], Phi @ P @ Phi.T
        S = H @ P @ H + R
        gamma = 0.05 * velocity[k] - H @ x
        K = P @ H / S
        x, P = x + K * gamma, P - np.outer(K, H @ P)
        eta[k] = gamma / S**0.5  # (6)
        R1[k], R2[k] = position[k] - lead * x[2], current[k] - x[4]  # (9)
    mean = np.convolve(eta, np.full(10, 0.1))[: len(eta)]  # (7); what is not there yet counts as zero
    return mean, R1, R2


def steady(v: dict, dt: float, sigma_load: float, tau: float, q: float, sigma: float) -> tuple[np.ndarray, ...]:
    """Return (Phi, G, K, S^1/2) of (5) with process noise, iterated until it rests: five states of (1) and a load.

    The load [N m] decays with `tau` and has the deviation `sigma_load`; `q` [rad/s] a tick on the motor's rate, `sigma`
    [rad/s] of its sensor. K is for a surface that its hinge holds back by 20 kN m/rad, Phi to first order in that.
    """
    found = []
    for hinge in (0.0, 1e3, -1e3):
        A, B = motion(v, hinge)
        whole = np.zeros((7, 7))
        whole[:5, :5], whole[:5, 5], whole[:5, 6], whole[5, 5] = A[:5, :5], B[:5, 1], B[:5, 0], -1.0 / tau
        found.append(expm(whole * dt))
    Phi, H = (found[0] - 20.0 * (found[1] - found[2]) / 2.0)[:6, :6], np.eye(6)[3]
    Q = np.diag([0, 0, 0, q**2, 0, sigma_load**2 * (1.0 - np.exp(-2.0 * dt / tau))])
    A, G, P = Phi.T, np.outer(H, H) / sigma**2, Q  # of one step of (5), then of 2, 4, 8 ... of them
    for _ in range(32):
        W = np.linalg.inv(np.eye(6) + G @ P)
        A, G, P = A @ W @ A, G + A @ W @ G @ A.T, P + A.T @ P @ W @ A
    S = H @ P @ H + sigma**2
    return found[0][:6, :6], found[0][:6, 6], P @ H / S, S**0.5
