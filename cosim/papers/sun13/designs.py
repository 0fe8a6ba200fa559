"""The stored design of [Sun13] against its theorems, and others that it is compared with: without E, other rate or P.

The latter are solved here when a row asks for them (a tenth of a second each): it takes the extra `design`.
"""

import dataclasses
import functools
from typing import Any

import numpy as np
from scipy.linalg import expm, subspace_angles

from cosim.papers.measured import apart, worst
from cosim.scenario.aircraft import DEFAULT, load_aircraft
from cosim.training import rfafe as training
from cosim.training.flights import DT
from cosim.training.rfafe import RANK_E
from fdi import rfafe
from fdi.common import tuning
from fdi.rfafe.discrete import discretise, noise
from fdi.rfafe.store import choose, from_plain
from fdi.rfafe.synthesis import G_SHARE, Design


def _stored() -> Design:
    return choose(tuning.read("rfafe"), "hydraulic", DT)[0]


@functools.cache
def published(with_E: bool = True, bandwidth: float | None = None) -> dict[str, Any]:
    """Return the stored form of the published design solved anew for the stored plant, hydraulic elevators, with the
    stored E or none; `bandwidth` [rad/s] of the loop is proportional to the learning rate."""
    held, d = tuning.read("rfafe")["designs"]["hydraulic"], _stored()
    air, position = training.sigmas(load_aircraft(DEFAULT))
    sigma, wb = np.array([*air, position, position]), bandwidth or training.BANDWIDTH["rfafe"]
    made = rfafe.design(d.A, d.B, d.C, None, d.E if with_E else None, d.F, dt=DT, bandwidth=wb, sigma=sigma)
    noise_deg = noise(made.discrete, sigma).tolist()
    return {"designs": {"hydraulic": held | {"design": tuning.plain(made), "noise_deg": noise_deg}}}


@functools.cache
def coupled(with_E: bool = True, cross: float = 0.7) -> dict[str, Any]:
    """Return the stored form of the published design with N = -20 I and a P that couples q and the actuator states.

    P = 2 I with `cross` between q and both: any P that meets (15), (16) is the paper's, our solver's is block-diagonal.
    """
    held = published(with_E)["designs"]["hydraulic"]
    d = from_plain(held["design"])
    P, N, TF = 2.0 * np.eye(6), -20.0 * np.eye(6), d.T @ d.F
    P[2, 4:] = P[4:, 2] = cross
    K1, X = d.T @ d.A - N, TF.T @ P @ TF  # (7) with C = I
    made = {"N": N, "K1": K1, "K2": N @ d.H, "K": K1 + N @ d.H, "P": P, "Y": P @ K1, "M": TF.T @ P}  # (4), (6), (16)
    d = dataclasses.replace(d, **made, Gamma=training.BANDWIDTH["rfafe"] * np.linalg.inv(X))
    d = dataclasses.replace(d, discrete=discretise(d, DT))
    return {"designs": {"hydraulic": held | {"design": tuning.plain(d)}}}


def left_sides(d: Design) -> dict[str, float]:
    """Return {inequality: largest eigenvalue of its left side over its size} of a Design."""
    PN, TF = d.P @ d.N, d.T @ d.F
    c, r, decay = d.region.centre, d.region.radius, d.region.decay
    corner = (G_SHARE - 2.0) / d.alpha * TF.T @ d.P @ TF  # G = G_SHARE theta (TF)'P(TF)
    sides = {
        "(15)": np.block([[PN + PN.T, -PN.T @ TF / d.alpha], [-(PN.T @ TF).T / d.alpha, corner]]),
        "(30)": np.block([[-r * d.P, c * d.P + PN.T], [c * d.P + PN, -r * d.P]]),
        "(31)": PN + PN.T + 2 * decay * d.P,
    }
    return {k: np.linalg.eigvalsh(M).max() / np.abs(M).max() for k, M in sides.items()}


def lmis() -> tuple[float, str]:
    """Return the largest eigenvalue of the left sides of (15), (30), (31) over their size, for the stored design."""
    return worst(left_sides(_stored()))


def conditions() -> tuple[float, str]:
    """Return (how many conditions of theorem 1 the stored design's matrices do not meet, the ranks)."""
    d, rank = _stored(), np.linalg.matrix_rank
    A1 = d.A - d.H @ d.C @ d.A
    unstable = [s for s in np.linalg.eigvals(A1) if s.real >= -1e-9]
    seen = [rank(np.vstack([s * np.eye(len(A1)) - A1, d.C])) == len(A1) for s in unstable]
    both = rank(np.hstack([d.E, d.F])) == d.E.shape[1] + d.F.shape[1]
    held = rank(d.C @ d.E) == rank(d.E), rank(d.C @ d.F) == rank(d.F), both, all(seen)
    return len(held) - sum(held), f"{d.E.shape[1]} unknown inputs, {d.F.shape[1]} faults, {len(d.C)} outputs"


def speed() -> tuple[float, str]:
    """Return (settling time of (9), (28) after a step without the proportional part over with it, both [ms])."""
    d, h = _stored(), 1e-3
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
    found = [np.degrees(subspace_angles(largest, E).max()) for E in (rfafe.reduce_E(raw, RANK_E), _stored().E[:4])]
    return float(max(found)), "code {:.2g}, stored {:.2g}".format(*found)


def again() -> tuple[float, str]:
    """Return how far P, N, M and Gamma, designed anew, are from the stored ones, over the size of each."""
    stored, anew = _stored(), from_plain(published()["designs"]["hydraulic"]["design"])
    return worst({n: apart(getattr(anew, n), getattr(stored, n)) for n in ("P", "N", "M", "Gamma")})
