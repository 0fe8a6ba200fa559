"""[Lu17] as it is printed against what the blocks hold: constants, (4), (9)-(13), (15)-(36), (38)-(48), bench.

The right sides are `lu17.transcription` and what stands here, literally from the paper, on NumPy and SciPy: r = 3 in
(13); Phi and Gamma of (19), (20) come from one exponential, about x_hat; (20) prints G at x_bar, which moves nothing
(G holds the rod and the pressure only, where both agree to V f). Q^xf = 0 but where it is named.
"""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from actuators.common import linkage
from actuators.hydraulic import actuator, lu17, servo
from cosim.papers.lu17 import bench
from cosim.papers.lu17.transcription import A_P, P_S, PHI_N, V_M, B, E, L, M, advance, rate
from fdi.hydraulic import iotsekf, rtsekf
from fdi.hydraulic.two_stage_ekf import transition

CONSTANTS = {"A_p": A_P, "B": B, "P_s": P_S, "phi_n": PHI_N, "V_m": V_M, "E": E, "M": M, "L": L}


def _states(draws=500):
    """Yield (x1, x2, x3, u, f, F_d) over the stroke, either sign of u, loads below the supply."""
    rng = np.random.default_rng(4)
    for _ in range(draws):
        yield (rng.uniform(-0.1, 0.1), *rng.uniform(-0.9, 0.9, 3), rng.uniform(-0.05, 0.05), rng.uniform(-2e4, 2e4))


@pytest.mark.parametrize("block", [actuator, servo, iotsekf, rtsekf], ids=lambda b: b.__name__.rpartition(".")[2])
def test_the_eight_constants_below_equation_6_are_held_as_printed(block):
    p = block.params()
    assert {name: p[name][0] for name in CONSTANTS} == CONSTANTS


def test_servo_and_filters_integrate_equation_4():
    p = actuator.params()[0]
    for x1, x2, x3, u, f, F_d in _states():
        assert lu17.rhs(x1, x2, x3, u, u, f, F_d, p) == pytest.approx(rate(x1, x2, x3, u, f, F_d), rel=1e-12, abs=1e-15)


def test_the_valve_command_is_13_with_9_to_12_and_r_3():
    """Without the lead of half a tick that our servo gives (13), since its command is held."""
    p, x = servo.params(u_max=1e3)[0], servo.init_at(servo.params())[0]
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
        assert abs(servo._invert(x, p, 0.0) - u) <= 1e-12 * (1.0 + abs(u))


def test_the_truth_of_the_bench_is_equation_4():
    """The rod of figure 3 lies within a hundredth of its sensor's noise of SciPy's integration under its valve."""
    out, tick = bench.fly("liquid OFC", "F_d known", quiet=True, seeds=1)[0], bench.schedule("liquid OFC")
    first = round(bench.ONSET / bench.DT)
    x = np.array([out[name][first] for name in ("q", "qd", "x3")])
    for k in range(first, first + 400):
        v = (1.0 - tick["s_u"][k]) * out["u"][k] + tick["f_u"][k]
        slope = lambda _, x, v=v: rate(*x, v, 0.0, _known(x[0]))  # noqa: E731
        x = solve_ivp(slope, (0.0, bench.DT), x, method="DOP853", rtol=1e-9, atol=1e-12).y[:, -1]
        assert abs(x[0] - out["q"][k + 1]) <= 1e-6


def test_transition_of_the_filters_is_19_and_20():
    """Over the size of each row, to what differences of (4) give."""
    p = iotsekf.params(load=0, dt=bench.DT)[0]
    for x1, x2, x3, u, f, _ in _states(50):
        Phi, G = np.zeros((4, 4)), np.zeros(4)
        transition(Phi, G, np.array([x1, x2, x3, 0.0]), u, u, f, 0.0, False, p, bench.DT)
        printed = np.column_stack(_linear4(np.array([x1, x2, x3, 0.0]), u, u + f, 0, bench.DT))[:3, [0, 1, 2, 4]]
        ours = np.column_stack([Phi[:3, :3], G[:3]])
        assert (np.abs(ours - printed).max(1) / np.abs(printed).max(1)).max() <= 1e-6


FORMS: dict[str, tuple[str, dict]] = {  # of the filters: (which, its parameters), by what of (15)-(48) they stand for
    "as published": ("iotsekf", {"load": 0, "centre": 0.0, "total_sign": 0.0}),
    "correlated noises": ("iotsekf", {"load": 0, "centre": 0.0, "total_sign": 0.0, "q_xf": (1e-9, 2e-6, 5e-6, 0.0)}),
    "F_d known, at x_hat": ("iotsekf", {"load": 1, "delay": 3.0}),
    "F_d a fourth state": ("iotsekf", {"load": 2, "delay": 1.0}),
    "F_d a fourth state, at x_bar": ("iotsekf", {"load": 2, "centre": 0.0, "total_sign": 0.0}),
    "ticks of 20 ms": ("iotsekf", {"load": 2, "dt": 0.02}),
    "(38)-(48) as published": ("rtsekf", {"load": 0}),
    "(38)-(48), F_d known": ("rtsekf", {"load": 1, "delay": 3.0}),
}
HELD = ("x_hat", "f_hat", "f_sigma", "q_now", "v_now", "x3_now", "G")  # what is compared


@pytest.mark.parametrize("form", FORMS)
def test_filters_are_those_of_15_to_36_and_38_to_48(form):
    """Estimate, fault and its deviation, over their size, to what differences in (19) give over 20 ms.

    Both read the same samples, the filter's measurements as late as its form has them. (34), (22), (29) are taken for
    all measurements at once; (38)-(48) with m = p = 1, F = 1.
    """
    which, own = FORMS[form]
    ours, p, samples = _run(which, own, 300)
    dt, late = own.get("dt", bench.DT), int(own.get("delay", 0))
    theirs = (_two_stage if which == "iotsekf" else _three_step)(p, own["load"], *samples, dt, late)
    assert (np.abs(ours - theirs).max(0) <= 1e-7 * np.maximum(np.abs(theirs).max(0), 1e-9)).all()
    assert np.std(theirs[:, 4]) > 0.0


def test_the_two_stage_filter_errs_as_an_augmented_ekf_with_the_same_noises():
    """IV.B: "in an optimal minimum variance error sense"; state (q, q', x3, f), f a walk, 0.02 sin added to u; 5 %."""
    ticks = 1500
    ours, p, (u, y, _) = _run(*FORMS["as published"], ticks)
    dt, x, P, H = bench.DT, np.array([y[0], 0.0, 0.0, 0.0]), np.diag([*p["P0"][:3], p["P0_f"]]), np.eye(4)[0]
    Q, other = np.diag([*p["q"][:3], p["q_f"]]) * dt, np.zeros(ticks)
    for k in range(ticks):
        Phi, Gamma = _linear4(np.array([*x[:3], 0.0]), u[k], u[k] + x[3], 0, dt)
        Phi = np.block([[Phi[:3, :3], Gamma[:3, None]], [np.zeros((1, 3)), np.eye(1)]])
        x = np.array([*advance(*x[:3], u[k], x[3], 0.0, dt), x[3]])
        P = Phi @ P @ Phi.T + Q
        gain = P @ H / (H @ P @ H + p["r_rod"])
        x, P = x + gain * (y[k] - H @ x), P - np.outer(gain, H @ P)
        other[k] = x[3]
    true, late = 0.02 * np.sin(6.3 * np.arange(ticks) * dt), slice(200, None)
    own, his = (float(np.sqrt(np.mean((f - true)[late] ** 2))) for f in (ours[:, 4], other))
    assert own / his == pytest.approx(1.0, abs=0.05)


def _samples(ticks: int, dt: float, loaded: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (valve command, rod, pressure difference) of (4) with an input fault, both measured with noise."""
    rng, t, x = np.random.default_rng(5), np.arange(ticks) * dt, np.zeros(3)
    u = 0.06 * np.sign(np.sin(7.0 * t)) + 0.02 * np.sin(31.0 * t)
    y, dp = np.zeros(ticks), np.zeros(ticks)
    x[2] = -bench.HM0 / (linkage.ARM * A_P * P_S) if loaded else 0.0
    for k in range(ticks):
        for _ in range(4):
            F_d = _known(x[0]) if loaded else 0.0
            x = np.array(advance(*x, u[k] + 0.02 * np.sin(6.3 * t[k]), 0.0, F_d, dt / 4))
        y[k], dp[k] = x[0] + 1e-4 * rng.normal(), x[2] + 5e-3 * rng.normal()
    return u, y, dp


def _known(q: float) -> float:
    """Return F_d [N] of the bench's hinge moment at rod position q."""
    return (bench.HM0 + bench.HMD * q / linkage.ARM) / linkage.ARM


def _run(which: str, own: dict, ticks: int) -> tuple[np.ndarray, Any, tuple]:
    """Return (HELD of a filter at every tick that it has a sample, its parameters, the samples)."""
    module, dt, late = (iotsekf if which == "iotsekf" else rtsekf), own.get("dt", bench.DT), int(own.get("delay", 0))
    p = module.params(delay_s=0.0, **{"dt": dt, **own})
    u, y, dp = _samples(ticks, dt, own["load"] > 0)
    inputs, x, found = np.zeros(1, module.INPUTS), module.init(p), []
    for name in ("y_rod_valid", *(("y_dp_valid",) if which == "iotsekf" else ())):
        inputs[name] = 1.0
    if own["load"]:
        inputs["hm0_model"], inputs["hmd_model"] = bench.HM0, bench.HMD
    run = iotsekf.two_stage.estimate if which == "iotsekf" else rtsekf.step
    for k in range(ticks):
        inputs["u"], inputs["y_rod"] = u[k], y[k - late] if k >= late else np.nan
        if which == "iotsekf":
            inputs["y_dp"] = dp[k - late]
            iotsekf.two_stage.remember(x[0], inputs[0])
        run(x[0], inputs[0], p[0], dt)
        found.append(np.concatenate([np.ravel(x[name][0]) for name in HELD]))
    return np.array(found[late:]), p[0], (u, y, dp)


def _linear4(x: np.ndarray, side: float, u: float, load: int, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (Phi, Gamma) of (19), (20) for (q, q', x3, F_d / A_p P_s) about x from differences of (4)."""
    steps, A = (1e-5, 1e-4, 1e-5, 1e-5, 1e-5), np.zeros((5, 5))

    def slope(z):
        F_d = {0: 0.0, 1: _known(z[0]), 2: A_P * P_S * z[3]}[load]
        return np.array(rate(z[0], z[1], z[2], side, z[4] - side, F_d))

    for i, h in enumerate(steps):
        d, at = np.zeros(5), np.array([*x, u])
        d[i] = h
        A[:3, i] = (slope(at + d) - slope(at - d)) / (2 * h)
    both = expm(A * dt)
    return both[:4, :4], both[:4, 4]


def _two_stage(p: Any, load: int, u: Any, y: Any, dp: Any, dt: float, late: int) -> np.ndarray:
    """Return HELD (ticks - late, 13) of (15)-(36), from the samples of the rod, for load form 2 of the pressure too."""
    steps = max(1, round(dt / 0.01))  # (17) is integrated over 10 ms at most
    h, H = dt / steps, np.eye(4)[[0, 2] if load == 2 else [0]]
    R = np.diag([p["r_rod"], p["r_dp"]][: len(H)])
    Q, Q_f, Q_xf = np.diag(p["q"]) * h, float(p["q_f"]) * h, p["q_xf"] * h
    x = np.array([y[0], 0.0, dp[0], -dp[0]]) if load == 2 else np.array([y[0], 0.0, -_force(load, y[0]), 0.0])
    f: Any = 0.0
    P, V, P_f = np.diag(p["P0"] * (1.0, 1.0, 1.0, load == 2)), np.zeros(4), float(p["P0_f"])
    out = []

    def ahead(x, P, V, P_f, u):
        for _ in range(steps):
            x_hat = x + V * f  # (15)
            side = u + f if p["total_sign"] else u
            Phi, Gamma = _linear4(x_hat, side, u + f, load, h)  # (19), (20)
            U_bar = Phi @ V + Gamma  # (33)
            P_f = P_f + Q_f  # (28)
            U = U_bar + (Q_xf - U_bar * Q_f) / P_f  # (35)
            F_d = {0: 0.0, 1: _known(x_hat[0]), 2: A_P * P_S * (x_hat if p["centre"] else x)[3]}[load]
            if p["centre"]:  # (17) at x_hat with the fault, which (15) then takes off
                x = np.array([*advance(*x_hat[:3], side, u + f - side, F_d, h), x_hat[3]]) - U * f
            else:
                x = np.array([*advance(*x[:3], u, 0.0, F_d, h), x[3]]) + (U_bar - U) * f  # (17), (31)
            P = Phi @ P @ Phi.T + Q - np.outer(Q_xf, U_bar) - np.outer(U, Q_xf - U_bar * Q_f)  # (18), (32)
            V = U
        whole = Gamma  # of the tick, as the last step has it
        for _ in range(steps - 1):
            whole = Phi @ whole + Gamma
        return x, P, V, P_f, whole

    for k in range(late, len(u)):
        if not late:
            x, P, V, P_f, G = ahead(x, P, V, P_f, u[k])
        S = H @ V  # (34)
        R_bar = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(R_bar)  # (22)
        K_f = P_f * S @ np.linalg.inv(R_bar + P_f * np.outer(S, S))  # (29)
        seen, before = np.array([y[k - late], dp[k - late]])[: len(H)], x
        x = x + K @ (seen - H @ x)  # (23), (24)
        left = np.eye(4) - K @ H
        P = left @ P @ left.T + K @ R @ K.T  # (25)
        f = f + K_f @ (seen - H @ before - S * f)  # (26), (27)
        P_f = float(1.0 - K_f @ S) * P_f  # (30)
        V = V - K @ S  # (36)
        if late:
            x, P, V, P_f, G = ahead(x, P, V, P_f, u[k + 1 - late])
        now, x_hat = (x + V * f)[:3], x + V * f
        F_d = {0: 0.0, 1: _known(x_hat[0]), 2: A_P * P_S * x_hat[3]}[load]
        for i in range(late - 2, -1, -1):
            now = advance(*now, u[k - i], f, F_d, dt)
        out.append([*x_hat, f, np.sqrt(P_f), *now, *G])
    return np.array(out)


def _force(load: int, q: float) -> float:
    """Return what F_d is of the stall force at rod position q [1]."""
    return _known(q) / (A_P * P_S) if load == 1 else 0.0


def _three_step(p: Any, load: int, u: Any, y: Any, dp: Any, dt: float, late: int) -> np.ndarray:
    """Return HELD (ticks - late, 13) of (38)-(48) with H = (1, 0, 0), F = 1."""
    H, F, R, Q = np.eye(3)[:1], np.eye(1), np.array([[p["r_rod"]]]), np.diag(p["q"][:3]) * dt
    x, P, out = np.array([y[0], 0.0, -_force(load, y[0])]), np.diag(p["P0"][:3]), []

    def ahead(x, P, u):
        Phi, G = _linear4(np.array([*x, 0.0]), u, u, load, dt)
        Phi = Phi[:3, :3]
        return np.array(advance(*x, u, 0.0, _known(x[0]) if load else 0.0, dt)), Phi @ P @ Phi.T + Q, G  # (38), (39)

    for k in range(late, len(u)):
        if not late:
            x, P, G = ahead(x, P, u[k])
        S = H @ P @ H.T + R  # (40)
        gamma = np.array([y[k - late]]) - H @ x  # (41)
        P_f = np.linalg.inv(F.T @ np.linalg.inv(S) @ F)  # (43)
        N = P_f @ F.T @ np.linalg.inv(S)  # (48)
        f = N @ gamma  # (42)
        K = P @ H.T @ np.linalg.inv(S)  # (45)
        x = x + K @ (gamma - F @ f)  # (46)
        P = P - K @ (S - F @ P_f @ F.T) @ K.T  # (47)
        if late:
            x, P, G = ahead(x, P, u[k + 1 - late])
        now, F_d = x, _known(x[0]) if load else 0.0
        for i in range(late - 2, -1, -1):
            now = advance(*now, u[k - i], 0.0, F_d, dt)
        out.append([*x, 0.0, f[0], np.sqrt(P_f[0, 0]), *now, *G])
    return np.array(out)
