"""Design of the LPV sliding-mode observer on any affine LPV model given as arrays. Source: [Alwi14].

| symbol | here |
|---|---|
| x_p, u, y_p, rho (1), (2) | states, inputs, outputs (the fault-prone n_q last), scheduling parameters |
| H_p = F_p E_p(rho) (4) | `actuator` columns of B; F_p given |
| A_f (7), a_f (23), delta_1, delta_2 (24) | output filter, corruption model, design weights |
| A(rho), B(rho), C, F (8), (9) | `Design.A`, `.B` stacks in output canonical form C = [0 I], F = [0; 0; F_o] (11) |
| L = [L_1 0] (21), W (22), A22s, P_o (16) | gains; A22s diagonal, so P_o = -A22s^-1 / 2 |

Reduced-order sliding motion, derived here because the paper only cites it. With e_y = 0, e_2 = d and e_1 the error of
the unmeasured part,

    e_1' = (A11 + L A21) e_1 + (A12 + L A22 + a_f L) d - (M1 + L M2) xi - a_f L phi
    d'   = -a_f d + a_f phi
    f_hat - f = -W A21 e_1 - W (A22 + a_f I) d + W M2 xi + a_f W phi,       W F_2 = I, L F_2 = 0

which is linear in Y = P1 L and W for P = diag(P1, P2). The bounded real lemma at all vertices, with xi and phi scaled
by delta_1, delta_2 and d by delta_2, gives the least L2 gain gamma; Re(poles) of A11 + L A21 stay within `poles`,
without which the pole runs to -1e7 rad/s.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from fdi.common import lmi as lmi_tools
from fdi.common import tuning
from fdi.lpv_smo.model import LpvModel, at, vertices

Arrays = Any  # whatever numpy makes an array of
SMALL_Y, SMALL_W = 1e-2, 1e-4  # weights of |P1 L| and |W| against gamma


@dataclasses.dataclass(frozen=True)
class Design:
    """Hold a designed observer: canonical plant stacks, gains, certificates; arrays as named in the module's table."""

    A: np.ndarray  # (1+nr, n, n) augmented, canonical coordinates
    B: np.ndarray  # (1+nr, n, m)
    x_from: np.ndarray  # (n, n), canonical = x_from @ [x_p; z_f]
    y_from: np.ndarray  # (p, p), canonical outputs = y_from @ y_m; orthogonal
    F_o: np.ndarray  # (h+q, h+q)
    box: np.ndarray  # (nr, 2)
    A_f: np.ndarray  # (q,) diagonal of (7) [rad/s]
    L: np.ndarray  # (n-p, p)
    W: np.ndarray  # (h+q, p)
    A22s: np.ndarray  # (p,) diagonal, negative [rad/s]
    P1: np.ndarray
    P2: np.ndarray
    M: np.ndarray  # (n, k+q) in canonical coordinates
    a_f: float
    delta_1: np.ndarray
    delta_2: np.ndarray
    gamma: float
    storage: float  # scale of the storage function against the supply rate that makes P >= I
    poles: tuple


def canonical(
    A: Arrays, B: Arrays, C: Arrays, D: Arrays, *, F: Arrays, faulty: int = 2, actuator: Sequence[int] = (0,),
    A_f: Arrays | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Augment with the output filter (7)-(9) and put into the output canonical form (11).

    A (1+nr, n, n), B (1+nr, n, m), C (1+nr, p, n), D (1+nr, p, m): affine stacks, the `faulty` last outputs prone to
    faults. Returns a dict of A, B, E, x_from, y_from, F, F_o, A_f, neglected. Raises ValueError with the condition
    of section 2 that fails: C_1 constant and of full row rank, D_1 zero, rank(C_1 F_p) = n_h, enough outputs.
    """
    A, B, C, D = _stacks(A, B, C, D)
    nr, n, m, p, q = len(A) - 1, A.shape[1], B.shape[2], C.shape[1], faulty
    h, free = len(actuator), p - q
    A_f = _numbers("A_f", np.ones(q) if A_f is None else A_f, (q,))
    if np.abs(C[1:, :free]).max(initial=0) > 0:
        raise ValueError("C_1, the rows of the fault-free outputs, varies with rho; [Alwi14] (6) needs it constant")
    if np.abs(D[:, :free]).max(initial=0) > 0:
        raise ValueError("D_1 is not zero: the fault-free outputs must have no feedthrough ([Alwi14] after (38))")
    C1 = C[0, :free]
    if np.linalg.matrix_rank(C1) < free:
        raise ValueError(f"C_1 has rank {np.linalg.matrix_rank(C1)} of {free}: fault-free outputs are dependent")
    if not h + q < p < n + q:
        raise ValueError(f"n_h + n_q = {h + q} < n_p = {p} < n_n + n_q = {n + q} does not hold ([Alwi14] after (2))")
    H = B[:, :, list(actuator)]
    F = _numbers("F", np.reshape(F, (-1, h)), (n, h))
    if np.linalg.matrix_rank(C1 @ F) < h:
        raise ValueError(f"rank(C_1 F_p) = {np.linalg.matrix_rank(C1 @ F)} < n_h = {h}: the actuator fault is not seen")
    E = np.einsum("hn,rnk->rhk", np.linalg.pinv(F), H)
    A_a, B_a = np.zeros((nr + 1, n + q, n + q)), np.zeros((nr + 1, n + q, m))
    A_a[:, :n, :n], A_a[:, n:, :n], A_a[0, n:, n:] = A, A_f[:, None] * C[:, free:], -np.diag(A_f)
    B_a[:, :n], B_a[:, n:] = B, A_f[:, None] * D[:, free:]
    F_a = np.block([[F, np.zeros((n, q))], [np.zeros((q, h)), np.diag(A_f)]])
    C_a = np.block([[C1, np.zeros((free, q))], [np.zeros((q, n)), np.eye(q)]])
    null = np.linalg.svd(C_a)[2][p:]
    null = null * np.where(null[:, np.abs(null).argmax(1)].diagonal() < 0, -1.0, 1.0)[:, None]
    x_from = np.vstack([null, C_a])
    F_c = x_from @ F_a
    x_from[: n + q - p] -= F_c[: n + q - p] @ np.linalg.pinv(F_c[n + q - p :]) @ C_a  # F_1 = 0
    y_from = _bottom(F_c[n + q - p :])
    x_from[n + q - p :] = y_from @ x_from[n + q - p :]
    back = np.linalg.inv(x_from)
    F_c = x_from @ F_a
    return {
        "A": x_from @ A_a @ back, "B": x_from @ B_a, "E": E, "x_from": x_from, "y_from": y_from,
        "F": F_c, "F_o": F_c[-(h + q) :], "A_f": A_f,
        "neglected": H - F @ E,
    }  # fmt: skip


def design(
    A: Arrays, B: Arrays, C: Arrays, D: Arrays, *, F: Arrays, M: Arrays, box: Arrays = (), faulty: int = 2,
    actuator: Sequence[int] = (0,), A_f: Arrays | None = None, A22s: Arrays | None = None, a_f: float = 0.01,
    delta_1: Arrays | None = None, delta_2: Arrays | None = None, poles: tuple[float, float] = (5.0, 200.0),
) -> Design:  # fmt: skip
    """Design the observer by the bounded real lemma at all vertices of `box` (nr, 2); returns `Design`.

    `F` (n, h): F_p of the actuators' faults; `M` (n, k): directions of model error; weights `delta_1` (k,) default 100
    each and `delta_2` (p,) default 0.01 on unfiltered, 0 on filtered outputs [Alwi14] section 5. `poles`: bounds
    [rad/s] on the sliding motion. Raises ValueError naming the structural condition that
    fails, an E_p(rho) that changes sign in the box, a pole that no gain moves, or an infeasible LMI.
    """
    A, B, C, D = _stacks(A, B, C, D)
    box, n_x, h = _numbers("box", np.reshape(box, (-1, 2)), (len(A) - 1, 2)), A.shape[1], len(actuator)
    for wrong, message in (
        ((box[:, 0] >= box[:, 1]).any(), "each row of box is (lowest, highest) of a parameter"),
        (not 0.0 < poles[0] < poles[1], f"poles = {poles}: a slow and a faster bound, both positive [rad/s]"),
        (not a_f > 0.0, f"a_f = {a_f} is positive [rad/s]"),
        (A_f is not None and np.min(A_f) <= 0.0, "A_f are all positive [rad/s]"),
        (A22s is not None and np.max(A22s) >= 0.0, "A22s are all negative [rad/s]"),
        (not all(0 <= j < B.shape[2] for j in actuator), f"actuator = {actuator}: columns of B, of which there are "
                                                         f"{B.shape[2]}"),
    ):  # fmt: skip
        if wrong:
            raise ValueError(message)
    form = canonical(A, B, C, D, faulty=faulty, actuator=actuator, F=F, A_f=A_f)
    n, p, q = form["A"].shape[1], form["y_from"].shape[0], faulty
    corners = vertices(box)
    if len({float(np.sign(np.linalg.det(at(form["E"], r)))) for r in corners} | {0.0}) != 2:
        raise ValueError("E_p(rho) is singular inside the box (its determinant changes sign over the vertices)")
    k = np.shape(M)[-1]
    M = _numbers("M", M, (n_x, k))
    M_c = form["x_from"] @ np.block([[M, np.zeros((n_x, q))], [np.zeros((q, k)), np.diag(form["A_f"])]])
    delta_1 = _numbers("delta_1", np.r_[np.full(k, 100.0), np.zeros(q)] if delta_1 is None else delta_1, (k + q,))
    delta_2 = _numbers("delta_2", np.r_[np.full(p - q, 0.01), np.zeros(q)] if delta_2 is None else delta_2, (p,))
    A22s = _numbers("A22s", -(10 + 0.1 * np.arange(1, p + 1)) if A22s is None else A22s, (p,))
    plants = [at(form["A"], r) for r in corners]
    try:
        L, W, P1, P2, gamma, storage = _solve(
            plants, M_c, form["F_o"], form["y_from"], a_f, delta_1, delta_2, poles, n - p, h + q
        )
    except lmi_tools.Infeasible as error:
        raise ValueError(
            f"no L and W meet the LMIs with poles in {poles} rad/s: measure more, take fewer faults or "
            f"widen the bound [{error}]"
        ) from error
    made = Design(
        **{name: form[name] for name in ("A", "B", "x_from", "y_from", "F_o", "A_f")}, box=box, L=L, W=W,
        A22s=A22s, P1=P1, P2=P2, M=M_c, a_f=a_f, delta_1=delta_1, delta_2=delta_2, gamma=gamma, storage=storage,
        poles=tuple(poles),
    )  # fmt: skip
    report = verify(made)
    if not report["ok"]:
        raise ValueError(f"the solver's answer does not hold when substituted back: {report}")
    return made


def verify(made: Design) -> dict[str, Any]:
    """Substitute a design back: largest relative LMI eigenvalue, P's least eigenvalue, poles, W F_2 = I, L F_2 = 0.

    The bounded real lemma's matrix must be negative to 1e-6 of its norm at every vertex, P >= I, and every vertex pole
    of A11 + L A21 inside `made.poles`, to 1e-6. Returns a dict with these figures and `ok`.
    """
    n1 = made.L.shape[0]
    F_2 = np.vstack([np.zeros((made.W.shape[1] - len(made.F_o), len(made.F_o))), made.F_o])
    worst, found = -np.inf, []
    X, S = _weighted(made.M, made.y_from, made.delta_1, made.delta_2)
    for r in vertices(made.box):
        a = at(made.A, r)
        lmi = _lemma(np, a, X, S, made.P1, made.P2, made.P1 @ made.L, made.W, made.a_f, made.gamma, made.storage)
        worst = max(worst, lmi_tools.violation(lmi))
        found.append(np.linalg.eigvals(a[:n1, :n1] + made.L @ a[n1:, :n1]).real)
    rates = np.array(found)
    p_min = min(np.linalg.eigvalsh(P).min() for P in (made.P1, made.P2) if P.size)
    out = {
        "lmi": worst, "p_min": float(p_min), "pole_slowest": float(rates.max()),
        "pole_fastest": float(rates.min()),
        "w_f": float(np.abs(made.W @ F_2 - np.eye(len(F_2.T))).max()), "l_f": float(np.abs(made.L @ F_2).max()),
    }  # fmt: skip
    low, high = made.poles
    in_bound = -high * (1 + 1e-6) <= rates.min() and rates.max() <= -low * (1 - 1e-6)
    matched = out["w_f"] < 1e-9 and out["l_f"] < 1e-9
    out["ok"] = bool(out["lmi"] <= 1e-6 and p_min >= 1 - 1e-6 and in_bound and matched)
    return out


def plain(model: LpvModel, made: Design) -> dict[str, Any]:
    """Return model and design as plain data."""
    return {"model": tuning.plain(model), "design": tuning.plain(made)}


def pair(stored: dict[str, Any]) -> tuple[LpvModel, Design]:
    """Return the model and the design of JSON data as `plain` makes it."""
    return tuning.from_plain(LpvModel, stored["model"]), tuning.from_plain(Design, stored["design"])


def load() -> tuple[LpvModel, Design]:
    """Return the stored (LpvModel, Design) of the paper's box."""
    return pair(tuning.read("lpv_smo"))


def load_boxes(own: Any = None) -> list[tuple[LpvModel, Design]]:
    """Return the (LpvModel, Design) of every stored box; `own` as for `fdi.common.tuning.read`."""
    return [pair(box) for box in tuning.read("lpv_smo_boxes", own)["boxes"]]


def _stacks(A, B, C, D):
    """Return A, B, C, D as float stacks of 1 + nr matrices, of one if a matrix; ValueError where sizes differ."""
    A, B, C, D = (np.array(S, float, ndmin=3) for S in (A, B, C, D))
    (terms, n, _), m, p = A.shape, B.shape[2], C.shape[1]
    shapes = {"A": (terms, n, n), "B": (terms, n, m), "C": (terms, p, n), "D": (terms, p, m)}
    return [_numbers(name, S, shapes[name]) for name, S in zip("ABCD", (A, B, C, D))]


def _numbers(name, value, shape):
    """Return `value` as finite numbers of `shape`; ValueError otherwise."""
    value = np.asarray(value, float)
    if value.shape != shape or not np.isfinite(value).all():
        raise ValueError(f"{name} takes finite numbers of shape {shape}; it has shape {value.shape}")
    return value


def _solve(plants, M, F_o, y_from, a_f, delta_1, delta_2, poles, n1, nf):
    """Minimise gamma over P1, P2, Y = P1 L and W at all vertices; returns L, W, P1, P2, gamma, storage."""
    cp = lmi_tools.cvxpy()
    p = y_from.shape[0]
    X, S = _weighted(M, y_from, delta_1, delta_2)
    nd = S.shape[1]
    P1, P2 = cp.Variable((n1, n1), symmetric=True), cp.Variable((nd, nd), symmetric=True)
    Y1, W1, gamma = cp.Variable((n1, p - nf)), cp.Variable((nf, p - nf)), cp.Variable()
    Y, W = cp.hstack([Y1, np.zeros((n1, nf))]), cp.hstack([W1, np.linalg.inv(F_o)])
    rules = [P1 >> 1e-6 * np.eye(n1), P2 >> 1e-6 * np.eye(nd)]
    for a in plants:
        rules.append(lmi_tools.negative(_lemma(cp, a, X, S, P1, P2, Y, W, a_f, gamma, 1.0), 0.0))
        motion = P1 @ a[:n1, :n1] + Y @ a[n1:, :n1]
        both = motion + motion.T
        rules += [both << -2 * poles[0] * 1.001 * P1, both >> -2 * poles[1] * 0.999 * P1]
    # the small norms pick one of the many L and W that reach the same gamma: only some of their entries are determined
    problem = cp.Problem(cp.Minimize(gamma + SMALL_Y * cp.norm(Y1) + SMALL_W * cp.norm(W1, "fro")), rules)
    lmi_tools.solve(problem, tolerance=1e-8)
    L = np.linalg.solve(P1.value, np.hstack([Y1.value, np.zeros((n1, nf))]))
    W = np.hstack([W1.value, np.linalg.inv(F_o)])
    # the inequality is homogeneous in (P, storage): scaling both gives P >= I without letting that rule bind
    storage = 1.01 / min(np.linalg.eigvalsh(P1.value).min(), np.linalg.eigvalsh(P2.value).min())
    return L, W, storage * P1.value, storage * P2.value, float(gamma.value) * (1 + 1e-4), float(storage)


def _weighted(M, y_from, delta_1, delta_2):
    """Return M diag(delta_1), which scales xi, and S = y_from diag(delta_2), which scales phi and d; a column without
    weight is left out."""
    return (M @ np.diag(delta_1))[:, delta_1 > 0], (y_from @ np.diag(delta_2))[:, delta_2 > 0]


def _lemma(lib, a, X, S, P1, P2, Y, W, a_f, gamma, storage):
    """Return the bounded real lemma's matrix of the sliding motion at the vertex `a`, of `lib` = numpy or cvxpy, that
    must be negative semidefinite; X and S of `_weighted`."""
    n1, nd, nx, nf = P1.shape[0], S.shape[1], X.shape[1], W.shape[0]
    A21, A22f = a[n1:, :n1], a[n1:, n1:] + a_f * np.eye(len(S))
    motion, cross = P1 @ a[:n1, :n1] + Y @ A21, (P1 @ a[:n1, n1:] + Y @ A22f) @ S
    xi, phi = -(P1 @ X[:n1] + Y @ X[n1:]), -a_f * (Y @ S)
    out_1, out_d = -(W @ A21), -(W @ A22f) @ S
    out_xi, out_phi = W @ X[n1:], a_f * (W @ S)
    zero = np.zeros((nd, nx))
    rows = [
        [motion + motion.T, cross, xi, phi, out_1.T],
        [cross.T, -2 * a_f * P2, zero, a_f * P2, out_d.T],
        [xi.T, zero.T, -gamma * storage * np.eye(nx), np.zeros((nx, nd)), out_xi.T],
        [phi.T, a_f * P2, np.zeros((nd, nx)), -gamma * storage * np.eye(nd), out_phi.T],
        [out_1, out_d, out_xi, out_phi, -gamma / storage * np.eye(nf)],
    ]
    return lib.vstack([lib.hstack(row) for row in rows])


def _bottom(F_2):
    """Return an orthogonal T^T with T^T F_2 = [0; F_o]; the identity where F_2 already has that form."""
    p, k = F_2.shape
    if np.abs(F_2[: p - k]).max(initial=0) < 1e-12:
        return np.eye(p)
    full = np.linalg.qr(F_2, mode="complete")[0].T
    return np.vstack([full[k:], full[:k]])
