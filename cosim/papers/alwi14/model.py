"""[Alwi14] sections 3 to 5: the affine model's fit to this aircraft, and the certificate of the stored design."""

import math

from cosim.papers.alwi14.flights import SENSIBLE
from cosim.papers.measured import apart, worst
from cosim.training import lpv as design_lpv
from fdi.common import tuning
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import model as lpv_model
from fdi.lpv_smo import synthesis as lpv_smo_design


def _vertices() -> list[float]:
    """Return B51 of the stored model at the 16 vertices [deg/s2 per deg]."""
    model, _ = lpv_smo_design.load()
    return [lpv_model.at(model.B, v)[4, 0] for v in lpv_model.vertices(model.box)]


def certificate() -> dict[str, float]:
    """Return the report of the stored design, substituted back into its inequalities."""
    return lpv_smo_design.verify(lpv_smo_design.load()[1])


def nearest() -> float:
    """Return the B51 nearest to zero at the 16 vertices [deg/s2 per deg]."""
    return max(_vertices())


def modulated() -> tuple[float, str]:
    """Return what (17) asks at least, the size of figure 2's faults (E f_e, f_n_z, f_alpha) at a vertex, over K."""
    elevator, *sensors = SENSIBLE
    size = max(math.hypot(b51 * elevator, *sensors) for b51 in _vertices())
    K = float(lpv_smo.params(model=lpv_smo_design.load()[0], made=lpv_smo_design.load()[1])["K"][0])
    return size / K, f"K {K:g}"


def neglected() -> float:
    """Return the neglected B11 over B51, the largest of each on a second grid."""
    largest = tuning.read("lpv_smo")["largest_B"]
    return largest[0][0] / largest[4][0]


def slowest() -> tuple[float, str]:
    """Return the slowest pole of the sliding motion at a vertex [rad/s]."""
    L = lpv_smo_design.load()[1].L[0, 0]
    note = f"L {L:.1f} deg/m; 35.4 printed for another aircraft, its pole not bounded in print"
    return certificate()["pole_slowest"], note


def lmi() -> float:
    """Return the largest eigenvalue of the LMIs with the design substituted back, relative."""
    return certificate()["lmi"]


def again() -> tuple[float, str]:
    """Return how far gamma, L and W, designed anew from the stored model, are from the stored ones, over their size."""
    model, stored = lpv_smo_design.load()
    anew = design_lpv.design(model)
    return worst({n: apart(getattr(anew, n), getattr(stored, n)) for n in ("gamma", "L", "W")})
