"""[Alwi14] sections 3 to 5: the affine model's fit to this aircraft, and the certificate of the stored design."""

import json
from typing import Any

import numpy as np

from actuators.constants import M_PER_FT
from cosim.papers.row import Of, near
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


PRINTED = {"A": (210, 12500, 0.40), "B": (270, 12500, 0.51), "C": (210, 27500, 0.54), "D": (270, 27500, 0.68),
           "E": (240, 20000, 0.53)}  # table 4: airspeed [kt], altitude [ft], Mach number  # fmt: skip


def _mach():
    """Return (largest difference of the Mach number at table 4's airspeed and altitude from print, all of them)."""
    found = {}
    for point, (kt, ft, _) in PRINTED.items():
        pressure = (1.0 - 2.25577e-5 * ft * M_PER_FT) ** 5.25588  # over that at sea level, standard atmosphere
        impact = (1.0 + 0.2 * (kt / 661.479) ** 2) ** 3.5 - 1.0  # over the same; speed of sound there in knots
        found[point] = float(np.sqrt(5.0 * ((impact / pressure + 1.0) ** (1.0 / 3.5) - 1.0)))
    told = ", ".join(f"{point} {mach:.4f}" for point, mach in found.items())
    return max(abs(found[point] - PRINTED[point][2]) for point in found), told


def plan(of: Of) -> list[Any]:
    """Return the Planned rows of model and gains, from the stored design."""
    return [
        of.claim(
            "table 4, Mach number of calibrated airspeed and altitude of A to E: farthest from print",
            "section 4.3, table 4: two digits of the Mach number, half of the last can be off; standard atmosphere",
            _mach,
            0,
            0.005,
        ),
        of.ours(
            "section 4.3, affine fit on a second grid: largest error of an entry over its largest value",
            _entries,
            *near(0.123),
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
            'after (35): "its contribution to speed V_g and angle of attack α is small"; a tenth is ours',
            lambda: fit()["b11"] / fit()["b51"],
            0,
            0.1,
        ),
        of.claim(
            "section 3, slowest pole of the sliding motion at a vertex [rad/s]",
            'section 3: "inducing a stable sliding motion"',
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
