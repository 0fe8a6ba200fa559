"""[Alwi14] (4) to (25), (27) to (32) as they are printed, against the observer that flies, its model and its synthesis.

The observer advances (12) with sampled signals: between samples outputs and commands are linear, the unit vector (15)
is implicit. The same is done here with the matrices as printed, the exponential of SciPy and a scalar root; A(rho),
B(rho) of (8) come from the affine model, the coordinates of (11) from the stored design.
"""

import dataclasses
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from actuators.constants import M_S_PER_KT, RAD_PER_DEG
from cosim.papers.alwi14.plant import trim_at
from cosim.papers.measured import all_valid, apart
from cosim.training import lpv as training
from fdi.lpv_smo import lpv_smo, synthesis
from fdi.lpv_smo import model as lpv_model
from fdi.lpv_smo.model import LpvModel
from fdi.lpv_smo.synthesis import Design

DT, TICKS = 0.005, 120
K, DELTA, A22 = 30.0, 1e-4, -(10.0 + 0.1 * np.arange(1, 7))  # section 5
DELAY, OMEGA, TAU_F, TAU_V, TAU_RHO = 2, 12.0, 0.2, 0.2, 0.5  # ours: commands' age [ticks], lags [1/s, s]


def _at(stack: Any, rho: Any) -> Any:
    """Return S_0 + sum rho_i S_i (27)."""
    return stack[0] + sum(r * S for r, S in zip(rho, stack[1:]))


def _augmented(model: LpvModel, A_f: Any, rho: Any) -> tuple[Any, ...]:
    """Return (A, B, C) of (8), (9) at rho, the model with the filter (7) of its last two outputs."""
    A, B, C, D = (_at(S, rho) for S in (model.A, model.B, model.C, model.D))
    A_f = np.diag(A_f)
    return (
        np.block([[A, np.zeros((5, 2))], [A_f @ C[4:], -A_f]]),
        np.vstack([B, A_f @ D[4:]]),
        np.block([[C[:4], np.zeros((4, 2))], [np.zeros((2, 5)), np.eye(2)]]),
    )


def _trim(model: LpvModel, rho: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return (trim of state and fault-prone outputs, of inputs): cubic in rho from -1 to 1 over the box."""
    low, high = model.box.T
    z = 2.0 * (rho - low) / (high - low) - 1.0
    e = [(a, b, c, d) for a in range(4) for b in range(4) for c in range(4) for d in range(4) if a + b + c + d <= 3]
    values = model.trim @ np.array([z[0] ** a * z[1] ** b * z[2] ** c * z[3] ** d for a, b, c, d in e])
    return np.concatenate([values[:5], values[-2:]]), values[5:7]


def _signals() -> dict[str, np.ndarray]:
    """Return what the observer reads, (TICKS,) each: SI, every signal in motion, rho too."""
    t = np.arange(TICKS) * DT
    wave = lambda f, p=0.0: np.sin(2.0 * np.pi * f * t + p)  # noqa: E731
    return {
        "h": 6000.0 + 3.0 * wave(0.7), "theta": 0.06 + 0.03 * wave(0.9), "V": 180.0 + 2.0 * wave(0.5, 1.0),
        "q": 0.04 * wave(1.2), "n_z": 1.0 + 0.6 * wave(1.1, 2.0), "alpha": 0.07 + 0.02 * wave(0.8, 2.0),
        "de_lo": -0.02 + 0.03 * wave(1.5), "de_li": -0.01 + 0.02 * wave(1.6), "de_ri": -0.03 + 0.01 * wave(1.7),
        "de_ro": -0.02 + 0.02 * wave(1.8), "stab": -0.03 + 0.002 * wave(0.6), "mass": 300e3 + 4e3 * wave(1.0),
        "cg": 0.31 + 0.01 * wave(0.8), "cas": 125.0 + 3.0 * wave(0.9), "mach": 0.53 + 0.02 * wave(0.7, 0.5),
    }  # fmt: skip


def test_state_e_y_nu_and_faults_are_those_of_7_to_25_on_moving_signals():
    """Over their range, sampled at 5 ms."""
    model, made = synthesis.load()
    p = lpv_smo.params(model=model, made=made, K=K, delta=DELTA, delay=DELAY, omega_a=OMEGA, tau_f=TAU_F,
                       tau_v=TAU_V, tau_rho=TAU_RHO)  # fmt: skip
    x, u, y = lpv_smo.init(p), all_valid(lpv_smo), _signals()
    found = []
    for k in range(TICKS):
        for name, values in y.items():
            u[name] = values[k]
        lpv_smo.step(x[0], u[0], p[0], DT)
        found.append(np.concatenate([
            x["alpha_hat"], *x["z"], *x["e"], *x["nu"], x["f_hat_elevator"], x["f_hat_n_z"], x["f_hat_n_z_raw"],
            x["f_hat_alpha"], x["f_sigma"],
        ]))  # fmt: skip
    theirs, ours = _observed(model, made, y), np.array(found)
    assert (np.abs(ours - theirs).max(0) <= 1e-8 * np.ptp(theirs, axis=0)).all()


def _observed(model: LpvModel, made: Design, y: dict) -> np.ndarray:
    """Return alpha_hat [rad], z_f, e_y, nu, faults [rad, g, g as (2) has it, rad], the deviation of the first.

    (TICKS, 20), of (7) to (25).
    """
    deg = lambda name: y[name] / RAD_PER_DEG  # noqa: E731
    elevator, stabiliser = (deg("de_lo") + deg("de_li") + deg("de_ri") + deg("de_ro")) / 4.0, deg("stab")
    at = np.stack([y["mass"] / 1e3, 100.0 * y["cg"], y["cas"] / M_S_PER_KT, y["mach"]], 1)
    prone, A_f, L, P_o = np.stack([y["n_z"], deg("alpha")], 1), made.A_f, made.L, np.diag(-0.5 / A22)
    lag = lambda tau: 1.0 - np.exp(-DT / tau)  # noqa: E731
    out: list[Any] = []
    rho, V, z, w, e, f, before = at[0], y["V"][0], prone[0], 0.0, np.zeros(6), np.zeros(3), np.zeros(6)
    s, followed = np.zeros(6), elevator[0]
    for k in range(TICKS):
        rho, V, last = rho + lag(TAU_RHO) * (at[k] - rho), V + lag(TAU_V) * (y["V"][k] - V), followed
        asked = max(k - 1 - DELAY, 0)
        followed = elevator[0] if k == 0 else followed + (1.0 - np.exp(-OMEGA * DT)) * (elevator[asked] - followed)
        if k:
            z = _linear(-np.diag(A_f), np.diag(A_f), z, prone[k - 1], prone[k])  # (7)
        s_old, s = s, made.y_from @ [y["h"][k], deg("theta")[k], V, deg("q")[k], *z]
        A, B, _ = _augmented(model, A_f, rho)
        back = np.linalg.inv(made.x_from)  # (11)
        A, B = made.x_from @ A @ back, made.x_from @ B
        x_eq, u_eq = _trim(model, rho)
        x_eq = made.x_from @ x_eq
        u_0, u_1 = (np.array([d, stabiliser[asked]]) - u_eq for d in (last, followed))
        L_A = A[:1] + L @ A[1:]  # of w = x_1 + L y: w' = (A11 + L A21) (x_1 - x_1eq) + (A12 + L A22) (y - y_eq) + ...
        given = (L, A, B, L_A, x_eq)
        if k:
            w = _linear(L_A[:, :1], np.eye(1), np.atleast_1d(w), _forced(s_old, u_0, *given), _forced(s, u_1, *given))[
                0
            ]
        else:
            w = prone[0, 1] + (L @ s)[0]
        x_1 = w - (L @ s)[0]
        rest = A[1:] @ (np.concatenate([[x_1], s]) - x_eq)  # of (12) without the elevator
        rest += B[1:, 1] * u_1[1]
        if k:
            forced = 0.5 * (before + rest + B[1:, 0] * (u_0[0] + u_1[0]))
            e = _slide(e + DT * forced - (s - s_old), P_o)
        else:
            e = _slide(np.zeros(6), P_o)
        before = rest
        nu = -K * P_o @ e / (np.linalg.norm(P_o @ e) + DELTA)  # (15)
        E = _at(model.B, rho)[4, 0]  # (35)
        f = f + lag(TAU_F) * (made.W @ nu / (E, 1.0, 1.0) - f)  # (22), (25)
        D51 = _at(model.D, rho)[4, 0]
        c = lag(TAU_F)  # of white noise of q through its difference and the lag: 0.02 deg/s a sample
        sigma = 0.02 * RAD_PER_DEG * c / DT * np.sqrt(2.0 / (2.0 - c)) / abs(E)
        faults = f[0] * RAD_PER_DEG, f[1] - D51 * f[0], f[1], f[2] * RAD_PER_DEG
        out.append([x_1 * RAD_PER_DEG, *z, *e, *nu, *faults, sigma])
    return np.array(out)


def _forced(s: Any, u: Any, L: Any, A: Any, B: Any, L_A: Any, x_eq: Any) -> np.ndarray:
    """Return what of w' depends on outputs s and inputs u, deviations of u from trim."""
    return L_A[:, 1:] @ (s - x_eq[1:]) - L_A[:, :1] @ (x_eq[:1] + L @ s) + (B[:1] + L @ B[1:]) @ u


def _linear(A: Any, B: Any, x: Any, u_0: Any, u_1: Any) -> np.ndarray:
    """Return x of x' = A x + B u after a tick over which u goes from u_0 to u_1."""
    n, m = len(A), B.shape[1]
    both = np.zeros((n + 2 * m,) * 2)
    both[:n, :n], both[:n, n : n + m], both[n : n + m, n + m :] = A, B, np.eye(m)
    return (expm(both * DT) @ np.concatenate([x, u_0, (u_1 - u_0) / DT]))[:n]


def _slide(b: np.ndarray, P_o: Any) -> np.ndarray:
    """Return e with e = b + h (A22s e - K P_o e / (|P_o e| + delta)) (12), (15)."""
    at = lambda m: np.linalg.solve(np.eye(6) - DT * np.diag(A22) + DT * K / (m + DELTA) * P_o, b)  # noqa: E731
    most = float(np.linalg.norm(P_o @ b))
    if most == 0.0:
        return b
    return at(brentq(lambda m: np.linalg.norm(P_o @ at(m)) - m, 0.0, most, xtol=1e-15, rtol=1e-14))


def test_the_output_canonical_form_is_4_8_9_and_11():
    """F_1 is zero, T orthogonal; of the stored model, and of the same in other states, its fault-free outputs mixed."""
    model, made = synthesis.load()
    rng, A_f = np.random.default_rng(1), made.A_f + np.array([0.2, 0.3])
    to, mix = np.eye(5) + 0.3 * rng.normal(size=(5, 5)), np.eye(6)
    mix[:4, :4] += 0.3 * rng.normal(size=(4, 4))
    back = np.linalg.inv(to)
    other = dataclasses.replace(
        model, A=to @ model.A @ back, B=to @ model.B, C=mix @ model.C @ back, D=mix @ model.D
    )
    for of, F_p in ((model, np.eye(5)[:, 4:]), (other, to[:, 4:])):
        form = synthesis.canonical(of.A, of.B, of.C, of.D, A_f=A_f, F=F_p)
        x_from, y_from = form["x_from"], form["y_from"]
        F = x_from @ np.block([[F_p, np.zeros((5, 2))], [np.zeros((2, 1)), np.diag(A_f)]])
        at_11 = np.vstack([np.zeros((4, 3)), form["F_o"]])
        assert np.abs(F - at_11).max() + np.abs(F - form["F"]).max() <= 1e-10
        pairs = [("T", y_from @ y_from.T, np.eye(6))]
        for rho in lpv_model.vertices(model.box):
            A, B, C = _augmented(of, A_f, rho)
            pairs += [
                ("(8)", _at(form["A"], rho) @ x_from, x_from @ A),
                ("(8)", _at(form["B"], rho), x_from @ B),
                ("(9)", np.hstack([np.zeros((6, 1)), y_from.T]) @ x_from, C),
                ("(4)", F_p * _at(form["E"], rho) + _at(form["neglected"], rho), _at(of.B, rho)[:, :1]),
                ("(4), neglected", F_p.T @ _at(form["neglected"], rho) + np.eye(1), np.eye(1)),
            ]
        assert [name for name, ours, theirs in pairs if not apart(ours, theirs) <= 1e-10] == []


def test_the_gain_to_the_error_of_the_faults_is_below_gamma_and_not_a_tenth_below():
    """Section 3, a design made anew: from xi and phi, largest at the 16 vertices, by the frequency response of the
    sliding motion that (12) to (24) give with e_y = d, 1e-4 to 1e4 rad/s."""
    made = training.design(synthesis.load()[0])
    n, F_2, worst, slow = len(made.L), np.vstack([np.zeros((3, 3)), made.F_o]), 0.0, []
    for rho in lpv_model.vertices(made.box):
        a = _at(made.A, rho)
        A11, A12, A21, A22_ = a[:n, :n], a[:n, n:], a[n:, :n], a[n:, n:]
        M1, M2, one = made.M[:n], made.M[n:], made.a_f * np.eye(6)
        slow.append(np.linalg.eigvals(A11 + made.L @ A21).real)
        S, X = made.y_from * made.delta_2, np.diag(made.delta_1)
        A = np.block([[A11 + made.L @ A21, A12 + made.L @ (A22_ + one)], [np.zeros((6, n)), -one]])
        B = np.block([[-(M1 + made.L @ M2) @ X, -made.a_f * made.L @ S], [np.zeros((6, len(X))), made.a_f * S]])
        C = -made.W @ np.hstack([A21, A22_ + one])
        D = made.W @ np.hstack([M2 @ X, made.a_f * S])
        for rate in np.logspace(-4, 4, 81):
            G = C @ np.linalg.solve(1j * rate * np.eye(n + 6) - A, B) + D
            worst = max(worst, float(np.linalg.norm(G, 2)))
    low, high = made.poles
    assert np.abs(made.W @ F_2 - np.eye(3)).max() < 1e-9 and np.abs(made.L @ F_2).max() < 1e-9
    assert -high * 1.001 <= np.min(slow) and np.max(slow) <= -low * 0.999
    assert min(np.linalg.eigvalsh(P)[0] for P in (made.P1, made.P2)) > 1.0 - 1e-6
    assert 0.9 <= worst / made.gamma <= 1.0


def test_the_affine_fit_and_the_trim_maps_are_those_of_27_and_29_to_32():
    """Of a family of models: an entry that hardly varies, or hardly matters in its row, is its mean, the others are
    weighted least squares."""
    rng, box = np.random.default_rng(4), np.array([[260.0, 405.0], [28.0, 36.0], [210.0, 270.0], [0.4, 0.68]])
    rho = rng.uniform(box[:, 0], box[:, 1], (60, 4))
    scale, weight = np.array([1.0, 3.0]), rng.uniform(0.5, 2.0, 60)
    true = rng.normal(size=(5, 3, 2)) / np.array([1.0, 100.0, 10.0, 60.0, 0.2])[:, None, None]
    S = np.array([_at(true, r) for r in rho])
    S[:, 1, 1] = 5.0 * (1.0 + 1e-3 * rng.normal(size=60))  # invariant
    S[:, 2, 0] = 1e-3 * rng.normal(size=60)  # insignificant in its row
    bent = S + 0.05 * rng.normal(size=S.shape) * (np.arange(2) == 0)  # what least squares is for
    bent[:, 2, 0] = S[:, 2, 0]
    stack, fixed = lpv_model.fit(rho, bent, box=box, scale=scale, weight=weight)
    X = np.hstack([np.ones((60, 1)), rho])  # (29)
    size = np.abs(bent).max(0)
    still = (np.ptp(bent, axis=0) <= 0.02 * size) | (size * scale <= 0.02 * (size * scale).max(1, keepdims=True))
    W = np.diag(weight)
    normal = np.einsum("ij,jkl->ikl", np.linalg.solve(X.T @ W @ X, X.T @ W), bent)  # (31)
    mean = np.einsum("k,kij->ij", weight / weight.sum(), bent)
    wanted = np.where(still, np.concatenate([mean[None], np.zeros((4, 3, 2))]), normal)
    assert np.abs((stack - wanted) * np.array([1, 400, 36, 270, 0.7])[:, None, None]).max() <= 1e-8
    assert np.array_equal(fixed, still)
    model, points = synthesis.load()[0], rng.uniform(box[:, 0], box[:, 1], (200, 4))
    values = np.array([np.concatenate(_trim(model, r)) for r in points])
    maps = lpv_model.fit_trim(points, values, box=box)
    trim = np.vstack([maps[:5], maps[7:], np.zeros((4, 35)), maps[5:7]])
    ours = dataclasses.replace(model, box=box, trim=trim)
    for r in rng.uniform(box[:, 0], box[:, 1], (5, 4)):
        x, u, y = trim_at(ours, r)
        theirs = np.concatenate(_trim(model, r))
        assert (np.abs(np.concatenate([x, y[-2:], u]) - theirs) <= 1e-8 * (1e-3 + np.abs(theirs))).all()
        assert np.abs(lpv_model.at(true, r) - _at(true, r)).max() <= 1e-8
