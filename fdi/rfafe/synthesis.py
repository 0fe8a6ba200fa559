"""Robust fast adaptive fault estimator: existence conditions and LMI design on any linear model [Sun13, section II].

    plant      x' = A x + B u + E d + F f,  y = C x + D u                                                  (1), (41)
    observer   z' = N z + T B u + K y + T F f_hat,  x_hat = z + H y,  r = y - C x_hat                     (2), (11)
    fault law  f_hat' = Gamma M (r' + alpha r)                                                            (17), (28)

    n states, r inputs u, m outputs y (D u is subtracted first), q unknown inputs d, l faults f
    H, T, N, K = K1 + K2, M, P, G  as printed; Y = P K1; gamma of (29) is driven to zero by construction
    centre, radius  disk (30) about (-q, 0), its q > 0 and r;  decay  strip (31), its zeta;  1/s

(15), (30), (31) are linear in (P, Y); (16) is made exact by choosing P in the subspace {P = P', (TF)' P null(C) = 0},
which is stronger than minimising gamma in (29). G = g theta (TF)'P(TF), so theta cancels in (15) and in the bound
delta: it has no effect. All is solved in balanced states and in units of the disk's centre, and scaled back so that P
>= I in the caller's units.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from fdi.common import conditions, lmi
from fdi.common.conditions import DesignError
from fdi.rfafe.discrete import Discrete, discretise

G_SHARE = 0.05  # g above: gives up 2.5 % of (15)'s lower right block for a finite bound delta
BANDWIDTH = 40.0  # wb of f_hat [rad/s]: middle of the useful 27-60, where 2 Hz passes and gyro noise stays small


@dataclass(frozen=True)
class Region:
    """Disk of `radius` about -`centre` (30), left of -`decay` (31), in 1/s: the paper's r, q > 0 and zeta."""

    centre: float
    radius: float
    decay: float

    def holds(self, eigenvalues: Any, slack: float = 1e-6) -> Any:
        """Say for each eigenvalue whether it lies inside, to `slack` of the centre."""
        s = slack * self.centre
        e = np.asarray(eigenvalues)
        return (abs(e + self.centre) < self.radius + s) & (e.real < -self.decay + s)


@dataclass(frozen=True)
class Report:
    """What a design was checked for; `violation` is lambda_max over the norm, negative when the inequality holds."""

    rank_E: int
    angle_deg: float  # smallest principal angle between range(E) and range(F); 90 without E
    TF_ratio: float  # smallest |T F_i| / |F_i| over the faults
    singular_CE: tuple[float, ...]  # of C E, with unit columns spanning E
    undetectability: float  # distance of (C, A1) to a pair with a mode in Re >= 0, relative to |A1|, balanced
    fixed_modes: tuple[complex, ...]  # invariant zeros of (A1, TF, C), which no gain moves
    lmi15: float
    lmi30: float
    lmi31: float
    gamma: float  # |(TF)'P - MC| / |(TF)'P|: (16), and (29)
    decoupling: float  # |(I - HC) E| / |E|
    eigenvalues_N: tuple[complex, ...]
    eigenvalues_loop: tuple[complex, ...]  # of (e_x, e_f) with the fault law closed
    bandwidth: tuple[float, ...]  # eigenvalues of Gamma (TF)'P(TF) [rad/s]
    tracking: tuple[tuple[float, complex], ...]  # (frequency [Hz], f_hat/f) of the continuous loop, first fault
    delta: float  # bound delta of (23) per squared fault rate
    condition_P: float


@dataclass(frozen=True)
class Design:
    """An estimator: the paper's matrices in the caller's units, its discrete form and what was checked."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray  # (n, q) as used, full column rank
    F: np.ndarray
    N: np.ndarray
    T: np.ndarray
    K: np.ndarray
    K1: np.ndarray
    K2: np.ndarray
    H: np.ndarray
    M: np.ndarray
    P: np.ndarray
    Y: np.ndarray
    G: np.ndarray
    Gamma: np.ndarray
    alpha: float
    theta: float
    dt: float
    region: Region
    discrete: Discrete
    report: Report

    def estimate(self, y: np.ndarray, u: np.ndarray | None = None) -> np.ndarray:
        """Run the estimator over samples y (ticks, m) and return f_hat (ticks, l), in the model's units.

        u (ticks, r) is held from each sample to the next, None: zero; y and u are deviations from the trim. It starts
        with a state that fits the first sample and no fault. The blocks `fdi.rfafe.rfafe` do the same for aircraft of
        Sun13's states, compiled, with lost samples.
        """
        d, y = self.discrete, np.asarray(y, float)
        u = np.zeros((len(y), d.Gu.shape[1])) if u is None else np.asarray(u, float)
        s, out = np.zeros(len(d.Phi)), np.zeros((len(y), len(d.S)))
        s[: len(self.A)] = (np.linalg.pinv(self.C) - self.H) @ (y[0] - self.D @ u[0])
        for k in range(1, len(y)):
            s = d.Phi @ s + d.Gu @ u[k - 1] + d.Gy0 @ y[k - 1] + d.Gy1 @ y[k]
            out[k] = d.S @ s + d.Sy @ y[k] + d.Su @ u[k - 1]
        return out


def design(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    D: Any,
    E: np.ndarray,
    F: np.ndarray,
    *,
    dt: float,
    region: Any = None,
    alpha: float | None = None,
    theta: float = 1.0,
    Gamma: Any = None,
    bandwidth: Any = BANDWIDTH,
    sigma: float | None = None,
    parallel: str = "error",
    min_ratio: float = 0.5,
) -> Any:
    """Design the estimator for a linear model and return a `Design`.

    A (n, n), B (n, r), C (m, n), D (m, r) or None, E (n, q) or None, F (n, l), any units; dt in s.

    region     Region, (centre, radius, decay) or a mapping with these names or the paper's q, r, zeta: a disk about
               -centre = -q; None: centre half the bandwidth, or what suits alpha, widened to hold the modes that no
               gain moves
    alpha      [1/s]; None: centre (1 + centre / 2 wb), which makes |f_hat/f| flat when N = -centre I
    Gamma      learning rate, a number or (l, l); None: bandwidth ((TF)'P(TF))^-1, `bandwidth` in rad/s
    sigma      standard deviation of each output's noise (m,): M then weighs the outputs by it; None: by size only
    parallel   when |TF|/|F| < min_ratio: "error", "remove" (E's part along F) or "rank" (E's smallest singular values)

    Raises DesignError (conditions (i)-(iv), the ratio, sizes), lmi.Infeasible (which inequality), ImportError (no
    solver).
    """
    A, B, C, D, E, F = _shapes(A, B, C, D, E, F)
    for name, value in {"dt": dt, "bandwidth": bandwidth, "theta": theta, "alpha": alpha}.items():
        good = isinstance(value, int | float | np.number) and 0.0 < value < math.inf
        if not good and not (name == "alpha" and value is None):
            raise DesignError(f"{name} is a positive number, not {value!r}")
    if sigma is not None and (np.shape(sigma) != (len(C),) or not np.all(np.asarray(sigma, float) > 0.0)):
        raise DesignError(f"sigma is one positive number per output ({len(C)}), not {sigma!r}")
    if parallel != "error":
        E = conditions.separate(E, F, C, min_ratio=min_ratio, method=parallel)
    E = conditions.basis(E)
    H, T = conditions.decouple(C, E, F)
    ratio = float(np.min(np.linalg.norm(T @ F, axis=0) / np.linalg.norm(F, axis=0)))
    angle = conditions.angle_deg(E, F)
    if ratio < min_ratio:
        raise DesignError(
            f"|TF|/|F| is {ratio:.3f}, below {min_ratio}: E lies {angle:.1f} deg from F, so decoupling it removes the "
            "fault and multiplies the noise; lower the rank of E or remove its part along F (see `parallel`)")
    A1 = conditions.without_rounding(T @ A, np.abs(T) @ np.abs(A))
    scale = conditions.balance(A1, C, T @ F, sigma)
    model = _scaled(A1, C, T @ F, scale)
    distance, state = conditions.undetectability(*model[:2])
    zeros = conditions.fixed_modes(*model)
    region = _region(region, bandwidth, alpha, zeros)
    if alpha is None:
        alpha = region.centre * (1.0 + region.centre / (2.0 * bandwidth))

    try:
        P, Y, scale = _solve(A1, C, T @ F, (scale, conditions.balance(A, C, F, sigma), np.ones(len(A))), region, alpha)
    except lmi.Infeasible as error:
        near = f"(C, A1) is {distance:.1e} of |A1| from an undetectable pair (mostly state {state})"
        raise lmi.Infeasible(f"{error}; {near}") from error
    least = np.linalg.eigvalsh(P)[0] / np.max(scale) ** 2  # bound of the least eigenvalue in the caller's units
    P, Y = P / np.outer(scale, scale), Y / scale[:, None]
    found = np.linalg.eigvalsh(P)[[0, -1]]
    known = found[0] - 8.0 * np.finfo(float).eps * len(P) * found[1]  # the same less what rounding hides
    least = known if known > 0.0 else least
    P, Y = P * (1.0 + 1e-9) / least, Y * (1.0 + 1e-9) / least  # homogeneous: P >= I fixes the scale
    K1 = np.linalg.solve(P * np.outer(scale, scale), Y * scale[:, None]) * scale[:, None]
    N = A1 - K1 @ C
    TF = T @ F
    M = _exact_M(TF, P, C)
    X = TF.T @ P @ TF
    Gamma = bandwidth * np.linalg.inv(X) if Gamma is None else _learning_rate(Gamma, F.shape[1])
    K2 = N @ H
    made = {"A": A, "B": B, "C": C, "D": D, "E": E, "F": F, "N": N, "T": T, "K": K1 + K2, "K1": K1, "K2": K2, "H": H,
            "M": M, "P": P, "Y": Y, "G": G_SHARE * theta * X, "Gamma": Gamma, "alpha": float(alpha),
            "theta": float(theta), "dt": float(dt), "region": region}
    report = _check(made, scale, ratio=ratio, angle=angle, distance=distance, zeros=zeros)
    discrete = discretise(N=N, T=T, K=made["K"], H=H, C=C, B=B, D=D, TF=TF, gain=Gamma @ M, alpha=alpha, dt=dt)
    return Design(**made, discrete=discrete, report=report)


def _shapes(A, B, C, D, E, F):
    """Return the matrices as float arrays of agreeing sizes; DesignError names the one that does not agree."""
    A, C = _matrix("A", A), _matrix("C", C)
    n, m = A.shape[0], C.shape[0]
    B, E, F = (_columns(name, X, n) for name, X in (("B", B), ("E", E), ("F", F)))
    D = np.zeros((m, B.shape[1])) if D is None else _columns("D", D, m)
    if A.shape != (n, n) or C.shape != (m, n) or D.shape != (m, B.shape[1]):
        raise DesignError(f"sizes do not agree: A {A.shape}, B {B.shape}, C {C.shape}, D {D.shape}")
    for name, X in (("A", A), ("B", B), ("C", C), ("D", D), ("E", E), ("F", F)):
        if not np.isfinite(X).all():
            raise DesignError(f"{name} holds {'NaN' if np.isnan(X).any() else 'an infinite value'}")
    if F.shape[1] == 0:
        raise DesignError("F has no column")
    return A, B, C, D, E, F


def _matrix(name, X):
    if np.iscomplexobj(X):
        raise DesignError(f"{name} is complex")
    X = np.atleast_2d(np.asarray(X, float))
    if X.ndim > 2:
        raise DesignError(f"{name} has {X.ndim} dimensions; one linear model is designed for at a time")
    return X


def _columns(name, X, rows):
    """Return X (rows, columns); None and an empty one have no column, a vector is one column."""
    X = np.zeros((rows, 0)) if X is None or np.size(X) == 0 else np.asarray(X)
    X = _matrix(name, X[:, None] if X.ndim == 1 else X)
    if len(X) != rows:
        raise DesignError(f"{name} has {len(X)} rows, not {rows}")
    return X


def _scaled(A1, C, TF, scale):
    """Return A1, C, TF in states divided by `scale`."""
    return A1 / scale[:, None] * scale, C * scale, TF / scale[:, None]


def _solve(A1, C, TF, scales, region, alpha):
    """Return P, Y and the scale they are in, the first of `scales` and of the margins that works.

    Raises lmi.Infeasible that names the inequality without which a solution exists.
    """
    last = None
    for margin in (1e-3, 1e-5, 1e-7):
        for scale in scales:
            try:
                return *_attempt(*_scaled(A1, C, TF, scale), region, alpha, margin, ("15", "30", "31")), scale
            except lmi.Infeasible as error:
                last = last or error
    blame = []
    for name in ("15", "30", "31"):
        rest = tuple(k for k in ("15", "30", "31") if k != name)
        try:
            _attempt(*_scaled(A1, C, TF, scales[0]), region, alpha, 1e-7, rest)
            blame.append(f"({name})")
        except lmi.Infeasible:
            continue
    hint = f"{region}"
    if "(15)" in blame:  # N = -centre I satisfies (15) for alpha > centre / 4 (1 - g/2): the least to be said unsolved
        hint = f"alpha = {alpha:g}, try {region.centre / 3:.3g} and above, or a slower {region}"
    without = f"without {' or '.join(blame)} they do" if blame else "leaving out (15), (30) or (31) alone does not help"
    raise lmi.Infeasible(f"no P, Y satisfy (15), (16), (30), (31) together; {without}; {hint} [{last}]")


def _attempt(A1, C, TF, region, alpha, margin, which):
    """Solve the inequalities `which` for P, Y, time in units of 1/centre, e_f scaled by sqrt(alpha centre)."""
    cp = lmi.cvxpy()
    n, unit = A1.shape[0], region.centre
    A1 = A1 / unit
    TF = TF / np.linalg.norm(TF, axis=0)
    U, s, Vt = np.linalg.svd(C, full_matrices=False)
    rank = conditions.rank_of(s)
    span = _symmetric_basis(TF, Vt[:rank], n)
    p, Yr = cp.Variable(span.shape[1]), cp.Variable((n, rank))
    t = cp.Variable()
    P = cp.reshape(span @ p, (n, n), order="F")
    PN = P @ A1 - Yr @ Vt[:rank]
    X = TF.T @ P @ TF
    cross = -math.sqrt(unit / alpha) * PN.T @ TF
    inequality = {
        "15": cp.bmat([[PN + PN.T, cross], [cross.T, -(2.0 - G_SHARE) * X]]),
        "30": cp.bmat([[-(region.radius / unit) * P, P + PN.T], [P + PN, -(region.radius / unit) * P]]),
        "31": PN + PN.T + 2.0 * region.decay / unit * P,
    }
    constraints = [lmi.negative(inequality[k], margin) for k in which]
    constraints += [lmi.negative(np.eye(n) - P, 0.0), lmi.negative(P - t * np.eye(n), 0.0)]
    # well-conditioned P, and N near the disk's centre: modest gains, and an f_hat/f that alpha can make flat
    lmi.solve(cp.Problem(cp.Minimize(t + cp.norm(PN + P, "fro")), constraints))
    P = (span @ p.value).reshape(n, n, order="F")
    return (P + P.T) / 2, unit * Yr.value @ np.diag(1.0 / s[:rank]) @ U[:, :rank].T


def _symmetric_basis(TF, Cr, n):
    """Return columns vec(P_i) that span {P = P' : (TF)' P null(C) = 0}."""
    from scipy.linalg import null_space  # imports of SciPy cost a start a tenth of a second

    units = []
    for i in range(n):
        for j in range(i, n):
            S = np.zeros((n, n))
            S[i, j] = S[j, i] = 1.0 if i == j else math.sqrt(0.5)
            units.append(S)
    stack = np.array([S.ravel() for S in units]).T
    hidden = null_space(Cr)
    if hidden.shape[1] == 0:
        return stack
    rows = np.array([(TF.T @ S @ hidden).ravel() for S in units]).T
    return stack @ null_space(rows, rcond=1e-12)


def _exact_M(TF, P, C):
    """Return M with MC = (TF)'P (16), least squares in outputs scaled to unit rows."""
    size = np.linalg.norm(C, axis=1)
    size[size == 0.0] = 1.0
    return TF.T @ P @ np.linalg.pinv(C / size[:, None]) / size


def _check(d, scale, *, ratio, angle, distance, zeros):
    """Return the Report of everything substituted back, balanced; raise lmi.Infeasible when an inequality fails."""
    full = d["T"] @ d["F"]
    P, N, TF = d["P"] * np.outer(scale, scale), d["N"] / scale[:, None] * scale, full / scale[:, None]
    region, alpha, theta = d["region"], d["alpha"], d["theta"]
    size = np.linalg.norm(P, 2)
    P, G = P / size, d["G"] / size
    PN, X = P @ N, TF.T @ P @ TF
    s = 1.0 / np.sqrt(np.diag(X) / alpha)  # congruence: unit diagonal below, as |P N| = 1 above
    top = 1.0 / math.sqrt(np.linalg.norm(PN, 2))
    lmi15 = np.block([[(PN + PN.T) * top * top, -PN.T @ TF / alpha * top * s],
                      [(-PN.T @ TF / alpha * top * s).T, (-2.0 / alpha * X + G / (alpha * theta)) * np.outer(s, s)]])
    lmi30 = np.block([[-region.radius * P, region.centre * P + PN.T], [region.centre * P + PN, -region.radius * P]])
    lmi31 = PN + PN.T + 2.0 * region.decay * P
    violations = {"15": lmi.violation(lmi15), "30": lmi.violation(lmi30), "31": lmi.violation(lmi31)}
    for name, value in violations.items():
        if value > 1e-6:
            raise lmi.Infeasible(f"({name}) is violated by {value:.1e} of its size when the solution is substituted "
                                 "back: the model is too ill-conditioned for this region")
    goal = full.T @ d["P"]
    residual = np.linalg.norm((goal - d["M"] @ d["C"]) * scale) / np.linalg.norm(goal * scale)
    gain = d["Gamma"] @ d["M"] @ d["C"]
    loop = np.block([[d["N"] - full @ gain, -alpha * full], [gain, np.zeros((full.shape[1],) * 2)]])
    E = d["E"]
    return Report(
        rank_E=E.shape[1], angle_deg=angle, TF_ratio=ratio,
        singular_CE=tuple(float(x) for x in conditions.singular(d["C"] @ E)),
        undetectability=distance, fixed_modes=tuple(complex(x) for x in zeros),
        lmi15=violations["15"], lmi30=violations["30"], lmi31=violations["31"], gamma=float(residual),
        decoupling=float(np.linalg.norm(d["T"] @ E) / max(np.linalg.norm(E), 1e-300)),
        eigenvalues_N=tuple(complex(x) for x in np.linalg.eigvals(d["N"])),
        eigenvalues_loop=tuple(complex(x) for x in np.linalg.eigvals(loop)),
        bandwidth=tuple(float(x) for x in np.sort(np.linalg.eigvals(d["Gamma"] @ (full.T @ d["P"] @ full)).real)),
        tracking=tuple((hz, tracking(d["N"], full, gain, alpha, hz)) for hz in (0.5, 1.0, 2.0)),
        delta=float(np.max(np.linalg.eigvals(np.linalg.inv(d["Gamma"] @ d["G"] @ d["Gamma"])).real) * theta / alpha),
        condition_P=float(np.linalg.cond(P)))


def tracking(N: Any, TF: np.ndarray, gain_C: Any, alpha: float, hz: float) -> complex:
    """Return f_hat/f of the first fault at `hz`, f_hat = L (f - f_hat), L = (1 + alpha/s) Gamma M C (sI - N)^-1 TF."""
    s = 2j * math.pi * hz
    L = (1.0 + alpha / s) * gain_C @ np.linalg.solve(s * np.eye(len(N)) - N, TF)
    return complex(np.linalg.solve(np.eye(len(L)) + L, L)[0, 0])


def _region(region, bandwidth, alpha, zeros):
    """Return the Region asked for, after checking that it can hold `zeros`; None: one that does and suits alpha."""
    if region is None:
        # the centre for which this alpha makes |f_hat/f| flat
        centre = bandwidth / 2.0 if alpha is None else bandwidth * (math.sqrt(1.0 + 2.0 * alpha / bandwidth) - 1.0)
        stable = [z for z in zeros if z.real < -1e-6 * centre]
        slow = float(min([centre / 4.0, *(-0.5 * z.real for z in stable)]))
        while not all(abs(z + centre) < centre - slow / 2.0 for z in stable):
            centre *= 1.5
        region = Region(centre, centre - slow / 2.0, slow)
    elif not isinstance(region, Region):
        names = {"q": "centre", "center": "centre", "r": "radius", "zeta": "decay"}
        region = {names.get(k, k): v for k, v in region.items()} if hasattr(region, "items") else region
        given = region if isinstance(region, dict) else dict(zip(("centre", "radius", "decay"), region))
        if set(given) != {"centre", "radius", "decay"} or len(region) != 3:
            raise ValueError(f"a region is (centre, radius, decay) [1/s] or a mapping with these names, not {region!r}")
        region = Region(**{k: float(v) for k, v in given.items()})
    if not region.centre > 0.0:
        raise ValueError(f"{region} lies about -centre, in the left half plane: give centre (the paper's q) > 0")
    if not (region.radius > 0.0 and 0.0 <= region.decay < region.centre + region.radius):
        raise ValueError(f"{region} is empty: radius > 0, 0 <= decay < centre + radius")
    outside = [z for z in zeros if not region.holds([z], slack=-1e-9)[0]]
    if outside:
        listed = ", ".join(f"{z:.4g}" for z in outside)
        raise DesignError(f"fixed modes {listed} 1/s (invariant zeros from fault and unknown input to the outputs) lie "
                          f"outside {region}: no gain moves them; measure more, lower the rank of E or widen it")
    return region


def _learning_rate(Gamma, l):
    G = np.asarray(Gamma, float)
    G = float(G) * np.eye(l) if G.ndim == 0 else np.atleast_2d(G)
    if G.shape != (l, l) or not np.allclose(G, G.T) or np.linalg.eigvalsh(G)[0] <= 0.0:
        raise ValueError(f"Gamma is a positive number or a symmetric positive definite ({l}, {l}) matrix")
    return G
