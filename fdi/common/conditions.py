"""When the estimator exists: conditions (i)-(iv) of [Sun13, theorem 1], each with how far it is from failing.

Rank decisions are taken on matrices with unit rows of C and unit columns of E and F, so that they do not depend on
units.
"""

import numpy as np

RANK = 1e-9  # singular values below this count as zero


class DesignError(ValueError):
    """A condition for the estimator to exist fails; the message says which and by how much."""


def decouple(C: np.ndarray, E: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return H = E (CE)^+ (12) and T = I - HC (6); raise DesignError that says which of conditions (i)-(iii) fails.

    E (n, q) has full column rank, C (m, n), F (n, l). Singular values are those of matrices with unit rows of C and
    unit columns of F.
    """
    n, m, q, l = C.shape[1], C.shape[0], E.shape[1], F.shape[1]
    unit_C, unit_F = unit_rows(C), unit_columns(F)
    short = f"{q} unknown inputs, {m} outputs: " if q > m else ""
    _full("(i)", "rank(CE)", unit_C @ E, f"rank(E) = {q}", q, f"{short}lower the rank of E or measure more")
    _full("(ii)", "rank(F)", unit_F, str(l), l, "parallel faults cannot be told apart: estimate their sum")
    _full("(ii)", "rank(CF)", unit_C @ unit_F, f"rank(F) = {l}", l,
          "a fault must move the rate of an output at once (first-order actuator model)")  # fmt: skip
    _full("(iii)", "rank([E F])", np.hstack([E, unit_F]), f"q + l = {q + l}", q + l, "part of F lies in the range of E")
    CE = C @ E
    H = E @ np.linalg.pinv(CE, rcond=1e-13) if q else np.zeros((n, m))
    T = without_rounding(np.eye(n) - H @ C, np.eye(n) + np.abs(H) @ np.abs(C))
    _full("(iii)", "rank(C T F)", unit_C @ T @ unit_F, f"rank(F) = {l}", l,
          "(16) has no solution: lower the rank of E or measure more")  # fmt: skip
    return H, T


def _full(condition, what, X, needs, rank, remedy):
    """Raise DesignError that `condition` fails unless X, which `what` names, has the `rank` that it `needs`."""
    s = np.linalg.svdvals(X)
    if rank_of(s, RANK) < rank:
        values = ", ".join(f"{x:.2e}" for x in s)
        raise DesignError(f"condition {condition} fails: {what} = {rank_of(s, RANK)} < {needs} (singular values "
                          f"{values}); {remedy}")  # fmt: skip


def without_rounding(X: np.ndarray, size: int) -> np.ndarray:
    """Return X with zeros where it is below 1e-13 of `size`, the sum of the magnitudes that an entry was made from.

    A decoupled state has a row of zeros; rounding there, in badly scaled units, else passes for a coupling.
    """
    return np.where(np.abs(X) <= 1e-13 * size, 0.0, X)


def separate(E: np.ndarray, F: np.ndarray, C: np.ndarray, *, min_ratio: float = 0.5) -> np.ndarray:
    """Return an orthonormal E* whose decoupling leaves |TF|/|F| >= min_ratio.

    E (n, q) of any rank, its columns weighted by their length; F (n, l), C (m, n). The part of E along F is taken out,
    then the smallest singular values are dropped [Sun13] (35)-(36). Rank 0 always suffices.
    """
    E = E - F @ np.linalg.lstsq(F, E, rcond=None)[0]
    U, s, _ = np.linalg.svd(E, full_matrices=False)
    for k in range(rank_of(s), 0, -1):
        try:
            _, T = decouple(C, U[:, :k], F)
        except DesignError:
            continue
        if np.min(np.linalg.norm(T @ F, axis=0) / np.linalg.norm(F, axis=0)) >= min_ratio:
            return U[:, :k]
    return np.zeros((E.shape[0], 0))


def fixed_modes(A1: np.ndarray, C: np.ndarray, TF: np.ndarray) -> np.ndarray:
    """Return the invariant zeros of (A1, TF, C): eigenvalues that stay in N under (16) for every K1.

    They are the unobservable eigenvalues of (C, A2), A2 = (I - TF (C TF)^+ C) A1, among them those of (C, A1) itself.
    """
    return unobservable_modes(A1 - TF @ np.linalg.pinv(C @ TF) @ C @ A1, C)


def shows(A: np.ndarray, C: np.ndarray, mode: complex) -> np.ndarray:
    """Return [(mode I - A) / |A|; C], C with unit rows: it loses rank where a mode of A does not show in C (Popov,
    Belevitch, Hautus)."""
    return np.vstack([(mode * np.eye(len(A)) - A) / max(np.linalg.norm(A, 2), 1e-12), unit_rows(C)])


def unobservable_modes(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of A that do not show in C."""
    return np.array([mode for mode in np.linalg.eigvals(A) if np.linalg.svdvals(shows(A, C, mode))[-1] <= RANK])


def detectable(A1: np.ndarray, C: np.ndarray) -> None:
    """Raise DesignError where a mode of A1 that is not stable does not show in C, condition (iv); it names the mode."""
    for value in unobservable_modes(A1, C):
        if value.real >= -1e-9 * np.linalg.norm(A1, 2):
            _, values, Vt = np.linalg.svd(shows(A1, C, value))
            raise DesignError(
                f"condition (iv) fails: the mode {value:.4g} 1/s of A1 = (I - HC) A is not stable and does not show "
                f"in C (smallest singular value {values[-1]:.1e}, mostly state {np.argmax(abs(Vt[-1]))}); measure it "
                "or lower the rank of E"
            )


def balance(A: np.ndarray, C: np.ndarray, F: np.ndarray, sigma: float | None = None) -> np.ndarray:
    """Return state scales s, x = s * x_balanced: Osborne's balance of [A F; C 0] with unit rows of C, columns of F.

    With `sigma` (m,), the outputs' noise, a state that shows in an output is scaled to that noise: P near the
    identity then weighs the outputs in M by what they are worth. Only the others are balanced.
    """
    n = A.shape[0]
    s, rate = np.ones(n), max(np.max(abs(np.linalg.eigvals(A))), 1e-6)
    seen = np.zeros(n, bool)
    if sigma is not None:
        weight = np.linalg.norm(C / np.asarray(sigma, float)[:, None], axis=0)
        seen = weight > 0.0
        s[seen] = 1.0 / weight[seen]
        s[~seen] = np.exp(np.mean(np.log(s[seen])))
    for _ in range(30):
        As, Fs, Cs = A / rate / s[:, None] * s, unit_columns(F / s[:, None]), unit_rows(C * s)
        np.fill_diagonal(As, 0.0)
        row = np.sqrt((As**2).sum(1) + (Fs**2).sum(1))
        column = np.sqrt((As**2).sum(0) + (Cs**2).sum(0))
        ok = (row > 1e-12) & (column > 1e-12) & ~seen
        step = np.where(ok, 2.0 ** np.round(0.5 * np.log2(np.where(ok, row / np.where(ok, column, 1.0), 1.0))), 1.0)
        if (step == 1.0).all():
            break
        s = s * np.sqrt(step)  # half a step: all states move at once, the full one would overshoot
    return s


def basis(E: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of range(E)."""
    U, s, _ = np.linalg.svd(unit_columns(E), full_matrices=False)
    return U[:, : rank_of(s)]


def angle_deg(E: np.ndarray, F: np.ndarray) -> float:
    """Return the smallest principal angle between the ranges of E and F [deg]; 90 when E has no column."""
    from scipy.linalg import subspace_angles

    return 90.0 if E.shape[1] == 0 else float(np.degrees(np.min(subspace_angles(E, F))))


def unit_columns(X: np.ndarray) -> np.ndarray:
    """Return X with its columns scaled to length one; zero columns stay."""
    size = np.linalg.norm(X, axis=0)
    return X / np.where(size > 0.0, size, 1.0)


def unit_rows(X: np.ndarray) -> np.ndarray:
    """Return X with its rows scaled to length one; zero rows stay."""
    return unit_columns(X.T).T


def rank_of(s: np.ndarray, tolerance: float | None = None) -> int:
    """Return how many singular values exceed `tolerance`, or RANK times the largest."""
    return int(np.sum(s > (RANK * (s[0] if len(s) else 0.0) if tolerance is None else tolerance)))
