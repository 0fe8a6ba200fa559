"""[Alwi14] sections 4.3 and 5: the affine model's fit to this aircraft, L and W, and the printed design choices."""

import json
import math

import numpy as np

from cosim.papers.row import judged, ours
from cosim.training import lpv as design_lpv
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import synthesis as lpv_smo_design

PRINTED: dict = {
    "a_f": 0.01,
    "A22": (-10.1, -10.2, -10.3, -10.4, -10.5, -10.6),
    "delta_1": (100, 100, 0, 0),
    "delta_2": (0.01, 0.01, 0.01, 0.01, 0, 0),
    "K": 30,
    "delta": 1e-4,
    "tau": 0.2,
}  # section 5


def _fit():
    fit = json.loads(design_lpv.STORED.read_text(encoding="utf-8"))["fit"]
    A, B, C, D = (np.array(fit[k]) for k in "ABCD")
    says = "(31): least squares over the region, no errors printed"
    for name, value in (
        ("B51", B[4, 0]), ("C51 (n_z over alpha)", C[4, 0]), ("D51", D[4, 0]),
        ("A11", A[0, 0]), ("A51 (pitch stiffness)", A[4, 0]), ("A55 (pitch damping)", A[4, 4]),
    ):  # fmt: skip
        item = f"section 4.3, error of {name} on a second grid over its largest value"
        yield ours("alwi14", item, lambda v=value: v, says=says)
    item = "section 4.3, short-period frequency, 95 % of the second grid"
    yield ours("alwi14", item, lambda: np.quantile(fit["wn_error"], 0.95), says=says)
    item = "section 4.3, short-period damping, largest error"
    yield ours("alwi14", item, lambda: max(fit["zeta_error"]), says=says)
    yield judged(
        "alwi14",
        "largest B51 at the 16 vertices [deg/s2 per deg]",
        "(4): E(rho) invertible",
        max(fit["b51_vertices"]),
        -9,
        -0.01,
    )
    yield judged("alwi14", "after (35), neglected B11 over B51", '"B11 ~ 0"', fit["b11"] / fit["b51"], 0, 0.1)


def _gains():
    made = lpv_smo_design.load()[1]
    report = lpv_smo_design.verify(made)
    says = "35.4237; another aircraft, its pole not bounded in print: not to be compared"
    yield ours("alwi14", "section 5, L over altitude [deg/m]", lambda: made.L[0, 0], says=says)
    says = "-1.1031; not determined by the problem"
    yield ours("alwi14", "section 5, L over theta [-]", lambda: made.L[0, 1], says=says)
    yield judged(
        "alwi14",
        "section 5, slowest pole of the sliding motion at a vertex [rad/s]",
        "stable",
        report["pole_slowest"],
        -200,
        -5,
    )
    yield judged(
        "alwi14",
        "section 3, largest LMI eigenvalue when substituted back, relative",
        "negative",
        report["lmi"],
        -1,
        1e-6,
    )
    yield judged("alwi14", "section 3, least eigenvalue of P", "positive", report["p_min"], 1, math.inf)
    p, printed = lpv_smo.params()[0], PRINTED
    own: dict = {
        "a_f": made.a_f,
        "A22": tuple(made.A22s),
        "delta_1": tuple(made.delta_1),
        "delta_2": tuple(made.delta_2),
        "K": p.K,
        "delta": p.delta,
        "tau": p.tau_f,
    }
    off = [k for k in printed if not np.allclose(own[k], printed[k], rtol=1e-12)]
    yield judged(
        "alwi14",
        "section 5, of seven printed design choices (a_f, A22, delta_1, delta_2, K, delta, filter) those not kept",
        "a_f 0.01, A22 -10.1 to -10.6, delta_1 100, delta_2 0.01, K 30, delta 1e-4, 0.2 s",
        len(off),
        0,
        0,
        note=", ".join(off),
    )
    w = "; ".join(" ".join(f"{v:.3g}" for v in row[:3]) for row in made.W)
    yield ours(
        "alwi14",
        "section 5, W F_o less the identity, largest entry",
        lambda: (np.abs(made.W[:, 3:] - np.eye(3)).max(), f"W over altitude, theta, V: {w}"),
        0,
        1e-9,
        says="W is not printed; (22) needs the identity",
    )


def plan():
    """Return the Rows of model and gains, from the stored design."""
    return [*_fit(), *_gains()]
