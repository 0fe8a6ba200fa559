"""What the blocks hold, against [Lu17] as it is printed: constants, (4), (9)-(13), (15)-(36), truth of the bench.

The right sides are `transcription` and what stands here, literally from the paper, on NumPy and SciPy; r = 3 in (13),
see the row on the relative degree; Phi and Gamma of (19), (20) come from one exponential, about x_hat: (20) prints G at
x_bar, which moves nothing (G holds the rod and the pressure only, where both agree to V f). Q^xf = 0.
"""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from actuators.common import linkage
from actuators.hydraulic import lu17, servo
from cosim.papers.lu17 import bench, transcription
from cosim.papers.lu17.transcription import A_P, P_S, PHI_N, V_M, B, E, L, M, rate
from fdi.hydraulic import iotsekf, rtsekf
from fdi.hydraulic.separate_bias import transition

CONSTANTS = {"A_p": A_P, "B": B, "P_s": P_S, "phi_n": PHI_N, "V_m": V_M, "E": E, "M": M, "L": L}
DRAWS = 500


def _states():
    """Yield (x1, x2, x3, u, f, F_d) over the stroke, either sign of u, loads below the supply."""
    rng = np.random.default_rng(4)
    for _ in range(DRAWS):
        yield (rng.uniform(-0.1, 0.1), *rng.uniform(-0.9, 0.9, 3), rng.uniform(-0.05, 0.05), rng.uniform(-2e4, 2e4))


def constants() -> tuple[int, str]:
    """Return how many of the eight constants a block holds otherwise than printed, over plant, servo and filters."""
    held = {"equation": lu17.params(), "servo": servo.params(), "iotsekf": iotsekf.params(), "rtsekf": rtsekf.params()}
    wrong = [f"{who} {name}" for who, p in held.items() for name, v in CONSTANTS.items() if p[name][0] != v]
    return len(wrong), ", ".join(wrong) or f"{len(CONSTANTS)} constants in {', '.join(held)}"


def equation() -> float:
    """Return the largest difference of what servo and filters integrate from (4), over the size of each derivative."""
    p, worst = lu17.params()[0], 0.0
    for x1, x2, x3, u, f, F_d in _states():
        ours, theirs = np.array(lu17.rhs(x1, x2, x3, u, u, f, F_d, p)), np.array(rate(x1, x2, x3, u, f, F_d))
        worst = max(worst, float(np.max(np.abs(ours - theirs) / (np.abs(theirs) + 1e-3))))
    return worst


def inversion() -> float:
    """Return the largest difference of the servo's valve command from (13) with (9) to (12), r = 3 [1].

    Without the lead of half a tick that our servo gives (13), since its command is held.
    """
    p, x, worst = servo.params(u_max=1e3)[0], servo.init(servo.params())[0], 0.0
    for x1, x2, x3, _, nu, F_d in _states():
        f2 = (A_P * P_S * x3 - B * x2 + F_d) / M  # (9)
        k = 2 * E * V_M / (P_S * (V_M**2 - A_P**2 * x1**2))
        f3 = k * A_P * (-L * x3 - x2)
        third, gain = (A_P * P_S * f3 - B * f2) / M, A_P * P_S / M * k * PHI_N  # L_f^3 h, L_g L_f^2 h without its root
        demand = 1e4 * nu
        w = (demand - third) / gain
        u = w / np.sqrt(1.0 - np.sign(w) * x3)  # (11), (13)
        x["q"], x["qd"], x["x3"], x["load"] = x1, x2, x3, F_d
        x["r"], x["rd"], x["rdd"], x["rddd"] = x1, x2, f2, demand  # its linear controller sees no error
        worst = max(worst, abs(servo._invert(x, p, 0.0) - u) / (1.0 + abs(u)))
    return worst


def truth(scenario: str = "liquid OFC", load: str = "F_d known", seconds: float = 2.0) -> float:
    """Return how far the bench's rod is from (4), integrated by SciPy from the onset on under its valve [mm]."""
    out, tick = bench.fly(scenario, load, quiet=True, seeds=1)[0], bench.schedule(scenario)
    first, n = round(bench.ONSET / bench.DT), round(seconds / bench.DT)
    x, worst = np.array([out[name][first] for name in ("q", "qd", "x3")]), 0.0
    for k in range(first, first + n):
        v = (1.0 - tick["s_u"][k]) * out["u"][k] + tick["f_u"][k]

        def slope(_, x, v=v):
            F_d = (bench.HM0 + bench.HMD * x[0] / linkage.ARM) / linkage.ARM if load != "no load" else 0.0
            return rate(x[0], x[1], x[2], v, 0.0, F_d)

        x = solve_ivp(slope, (0.0, bench.DT), x, rtol=1e-9, atol=1e-12).y[:, -1]
        worst = max(worst, 1e3 * abs(x[0] - out["q"][k + 1]))
    return worst


def _linear(x: Any, u: float, f: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (Phi, Gamma) of (19), (20) about x from differences of (4)."""
    at, steps = np.array([*x, f]), (1e-5, 1e-4, 1e-5, 1e-5)
    columns = []
    for i, h in enumerate(steps):
        d = np.zeros(4)
        d[i] = h
        up, down = at + d, at - d
        columns.append((np.array(rate(*up[:3], u, up[3], 0.0)) - rate(*down[:3], u, down[3], 0.0)) / (2 * h))
    both = np.zeros((4, 4))
    both[:3] = np.stack(columns, 1)
    both = expm(both * dt)
    return both[:3, :3], both[:3, 3]


def linearisation() -> float:
    """Return the largest difference of the filter's Phi and Gamma from (19), (20), over the size of their rows."""
    p, worst = iotsekf.params(load=0, dt=bench.DT)[0], 0.0
    for x1, x2, x3, u, f, _ in list(_states())[:50]:
        Phi, G = np.zeros((4, 4)), np.zeros(4)
        transition(Phi, G, np.array([x1, x2, x3, 0.0]), u, u, f, 0.0, False, p, bench.DT)
        printed = np.column_stack(_linear((x1, x2, x3), u, f, bench.DT))
        ours = np.column_stack([Phi[:3, :3], G[:3]])
        worst = max(worst, float((np.abs(ours - printed).max(1) / np.abs(printed).max(1)).max()))
    return worst


def two_stage(ticks: int = 3000) -> tuple[float, str]:
    """Return the largest difference of f_hat from that of (15)-(36), over figure 3's fault, from 10 s on.

    One seed, without load; both read the same samples and valve commands.
    """
    out = bench.fly("liquid OFC", seeds=1)[0][:ticks]
    p = iotsekf.params(load=0, dt=bench.DT, delay_s=0.0)[0]
    dt, H, r = bench.DT, np.array([1.0, 0.0, 0.0]), float(p["r_rod"])
    Q, Q_f = np.diag(p["q"][:3]) * dt, float(p["q_f"]) * dt
    x, P, V = np.array([out["y"][0], 0.0, 0.0]), np.diag(p["P0"][:3]), np.zeros(3)
    f, P_f, found = 0.0, float(p["P0_f"]), np.zeros(len(out))
    for k in range(1, len(out)):
        u, y = out["u"][k - 1], out["y"][k]
        Phi, Gamma = _linear(x + V * f, u, f, dt)  # (15), (19), (20)
        U_bar = Phi @ V + Gamma  # (33)
        P_f = P_f + Q_f  # (28)
        U = U_bar - U_bar * Q_f / P_f  # (35)
        x = np.array(transcription.advance(*x, u, 0.0, dt)) + (U_bar - U) * f  # (17), (31)
        P = Phi @ P @ Phi.T + Q + np.outer(U, U_bar * Q_f)  # (18), (32)
        S = H @ U  # (34)
        K = P @ H / (H @ P @ H + r)  # (22)
        K_f = P_f * S / (H @ P @ H + r + S * P_f * S)  # (29)
        before = x
        x = x + K * (y - H @ x)  # (23), (24)
        left = np.eye(3) - np.outer(K, H)
        P = left @ P @ left.T + r * np.outer(K, K)  # (25)
        f = f + K_f * (y - H @ before - S * f)  # (26), (27)
        P_f = (1.0 - K_f * S) * P_f  # (30)
        V = U - K * S  # (36)
        found[k] = f
    late = slice(round((bench.ONSET - 2.0) / dt), None)
    return float(np.abs(found - out["f_hat"])[late].max() / bench.OFC_U), f"rms of f_hat {np.std(found[late]):.2g}"
