"""The stored designs of [Sun13] against its theorems: inequalities, conditions, E, what (28) gains."""

import numpy as np
from scipy.linalg import expm, subspace_angles

from cosim.papers.measured import apart, worst
from cosim.papers.sun13 import variants
from cosim.training import rfafe as training
from cosim.training.flights import DT
from cosim.training.rfafe import RANK_E
from fdi.rfafe import rfafe
from fdi.rfafe.store import choose, from_plain
from fdi.rfafe.synthesis import Design


def lmis() -> tuple[float, str]:
    """Return the largest eigenvalue of the left sides of (15), (30), (31) over their size, for the stored design."""
    return worst(left_sides(choose("rfafe", "hydraulic", DT)[0]))


def left_sides(d: Design) -> dict[str, float]:
    """Return {inequality: largest eigenvalue of its left side over its size} of a Design."""
    PN, TF = d.P @ d.N, d.T @ d.F
    c, r, decay = d.region.centre, d.region.radius, d.region.decay
    sides = {
        "(15)": np.block(
            [
                [PN + PN.T, -PN.T @ TF / d.alpha],
                [-(PN.T @ TF).T / d.alpha, -2 / d.alpha * TF.T @ d.P @ TF + d.G / (d.alpha * d.theta)],
            ]
        ),
        "(30)": np.block([[-r * d.P, c * d.P + PN.T], [c * d.P + PN, -r * d.P]]),
        "(31)": PN + PN.T + 2 * decay * d.P,
    }
    return {k: np.linalg.eigvalsh(M).max() / np.abs(M).max() for k, M in sides.items()}


def conditions() -> tuple[float, str]:
    """Return (how many conditions of theorem 1 the stored design's matrices do not meet, the ranks)."""
    d, rank = choose("rfafe", "hydraulic", DT)[0], np.linalg.matrix_rank
    A1 = d.A - d.H @ d.C @ d.A
    unstable = [s for s in np.linalg.eigvals(A1) if s.real >= -1e-9]
    seen = [rank(np.vstack([s * np.eye(len(A1)) - A1, d.C])) == len(A1) for s in unstable]
    both = rank(np.hstack([d.E, d.F])) == d.E.shape[1] + d.F.shape[1]
    held = rank(d.C @ d.E) == rank(d.E), rank(d.C @ d.F) == rank(d.F), both, all(seen)
    return len(held) - sum(held), f"{d.E.shape[1]} unknown inputs, {d.F.shape[1]} faults, {len(d.C)} outputs"


def speed() -> tuple[float, str]:
    """Return (settling time of (9), (28) after a step without the proportional part over with it, both [ms])."""
    d, h = choose("rfafe", "hydraulic", DT)[0], 1e-3
    (n, m), F, gain = (len(d.A), len(d.C)), d.T @ d.F, d.Gamma @ d.M
    took = []
    for share in (0.0, 1.0):
        A = np.zeros((n + m + 1,) * 2)  # e_x, the integral of r, the fault of the left side
        A[:n, :n], A[:n, n : n + m], A[n : n + m, :n] = d.N - share * F @ gain @ d.C, -d.alpha * F @ gain, d.C
        A[:n, -1] = F[:, 0]
        step, x, seen = expm(A * h), np.zeros(n + m + 1), []
        x[-1] = 1.0
        for _ in range(2000):
            seen.append((gain @ (share * d.C @ x[:n] + d.alpha * x[n : n + m]))[0])
            x = step @ x
        took.append(1e3 * h * (1 + np.flatnonzero(np.abs(np.array(seen) - 1.0) > 0.05)[-1]))
    return took[0] / took[1], f"{took[0]:.0f} and {took[1]:.0f} ms"


def reduced() -> tuple[float, str]:
    """Return the largest angle [deg] of E by (36), of flights flown anew, to what the code makes and to the stored."""
    raw = training.unknown_inputs()
    largest = np.linalg.svd(raw)[0][:, :RANK_E]  # (36) keeps the largest, whatever order the indices suggest
    stored = choose("rfafe", "hydraulic", DT)[0].E[:4]
    found = [np.degrees(subspace_angles(largest, E).max()) for E in (rfafe.reduce_E(raw, RANK_E), stored)]
    return float(max(found)), "code {:.2g}, stored {:.2g}".format(*found)


def again() -> tuple[float, str]:
    """Return how far P, N, M and Gamma, designed anew, are from the stored ones, over the size of each."""
    stored = choose("rfafe", "hydraulic", DT)[0]
    anew = from_plain(variants.published("six flights")["designs"]["hydraulic"]["design"])
    return worst({n: apart(getattr(anew, n), getattr(stored, n)) for n in ("P", "N", "M", "Gamma")})
