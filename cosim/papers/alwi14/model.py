"""[Alwi14] sections 3 to 5: the affine model's fit to this aircraft, and the certificate of the stored design."""

import json
from typing import Any

import numpy as np

from cosim.papers.row import Of
from cosim.training import lpv as design_lpv
from fdi.lpv_smo import synthesis as lpv_smo_design

ENTRIES = {
    "B51": ("B", 4, 0),
    "C51": ("C", 4, 0),
    "D51": ("D", 4, 0),
    "A11": ("A", 0, 0),
    "A51": ("A", 4, 0),
    "A55": ("A", 4, 4),
}


def fit() -> Any:
    """Return what the stored design says about the fit on a second grid."""
    return json.loads(design_lpv.STORED.read_text(encoding="utf-8"))["fit"]


def certificate() -> dict[str, float]:
    """Return the report of the stored design, substituted back into its inequalities."""
    return lpv_smo_design.verify(lpv_smo_design.load()[1])


def _entries():
    held = fit()
    found = {name: np.array(held[m])[i, j] for name, (m, i, j) in ENTRIES.items()}
    told = ", ".join(f"{n} {v:.3f}" for n, v in found.items())
    return (
        max(found.values()),
        f"{told}; short-period frequency {np.quantile(held['wn_error'], 0.95):.3f} at 95 %, "
        f"damping {max(held['zeta_error']):.3f}",
    )


def plan(of: Of) -> list[Any]:
    """Return the Planned rows of model and gains, from the stored design."""
    return [
        of.ours(
            "section 4.3, affine fit on a second grid: largest error of an entry over its largest value",
            _entries,
            says="(31): least squares over the region, no errors printed",
        ),
        of.claim(
            "section 2.2, B51 nearest to zero at the 16 vertices [deg/s2 per deg]",
            "(4): E(rho) is invertible over the region: no change of sign",
            lambda: max(fit()["b51_vertices"]),
            -9,
            -0.01,
        ),
        of.claim(
            "section 5, neglected B11 over B51",
            'after (35): "B11 ~ 0 ... quite standard"; a tenth is ours',
            lambda: fit()["b11"] / fit()["b51"],
            0,
            0.1,
        ),
        of.claim(
            "section 3, slowest pole of the sliding motion at a vertex [rad/s]",
            "stable",
            lambda: (
                certificate()["pole_slowest"],
                f"L {lpv_smo_design.load()[1].L[0, 0]:.1f} deg/m; 35.4 printed "
                "for another aircraft, its pole not bounded in print",
            ),
            -1e4,
            -1e-3,
        ),
        of.claim(
            "section 3, largest eigenvalue of the LMIs when the design is substituted back, relative",
            "section 3: the LMIs hold at every vertex",
            lambda: certificate()["lmi"],
            -1,
            1e-6,
        ),
    ]
