"""Fit the aircraft's tables to the published 747 data and write the JSBSim files that hold them.

    python -m cosim.aircraft_fit            writes aircraft/transport/aerodynamics.xml and Engines/turbofan.xml
    python -m cosim.aircraft_fit --check    exit status 1 when the files on disk are not what this script makes

Longitudinal: C(alpha, M, q̄) = T(alpha, M) + q̄ (t0 + t1 alpha) with T on a grid. T is the prior (a Prandtl-Glauert lift line up to a stall, a
parabolic polar, a constant static margin) plus the smoothest correction that meets, at flight conditions 3 to 10 of [CR-2144], the
trim value, the slope over alpha and the slope over speed, all three recovered from its tables IX-3 and IX-4. Linear least squares.
Details, sources and what is assumed: aircraft/README.md.
"""

import math
import sys
from pathlib import Path

import numpy as np

from cosim.aircraft_data import FLIGHT_CONDITIONS, LATERAL, derivatives, stabilizer_trim
from cosim.aircraft_xml import aerodynamics_xml, engine_xml

FOLDER = Path(__file__).resolve().parent.parent / "aircraft" / "transport"
ALPHA = np.radians(np.arange(-10.0, 31.0, 1.0))
MACH = np.array([0.2, 0.3, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95])

CL_STAB, CM_STAB = 0.70, -2.70  # per rad, Roskam (airplane J, cruise low)
Q_REF = 200.0  # psf: flexibility is written as (q̄ - Q_REF)


def cl_max(mach):
    """Return the largest lift coefficient over Mach: assumed, see README (1.3 g at every Alwi14 point)."""
    return np.interp(mach, [0.2, 0.45, 0.6, 0.7, 0.8, 0.9, 0.95], [1.58, 1.54, 1.44, 1.26, 1.05, 0.90, 0.80])


def _rounded(lift, top):
    """Bend a straight lift line smoothly over to `top`, then down: the stall.

    Below 0.75 top the line is untouched; above, y = top (1 - exp(-...)) type saturation with equal slope at the join.
    """
    join = 0.75 * top
    room = top - join
    s = np.maximum(lift - join, 0.0) / room
    soft = join + room * (np.tanh(s) - 0.10 * np.maximum(s - 1.5, 0.0))
    return np.where(lift > join, soft, lift)


def prior_lift(alpha, mach):
    slope = 4.55 / np.sqrt(1.0 - (0.55 * np.minimum(mach, 0.85)) ** 2)
    return _rounded(slope * (alpha + math.radians(2.5)), cl_max(mach))


def prior_drag(alpha, mach):
    lift = 4.8 * (np.maximum(alpha, math.radians(-12)) + math.radians(2.5))
    over = np.maximum(alpha - math.radians(10.0), 0.0)
    return 0.0165 + np.minimum(lift, 1.3) ** 2 / (math.pi * 6.96 * 0.85) + 0.9 * over


def prior_moment(alpha, mach):
    """A static margin of 22 % of the lift, which turns into a stronger nose-down moment past the stall."""
    return -0.22 * 4.8 * alpha - 0.6 * np.maximum(alpha - math.radians(16.0), 0.0)


def _weights(alpha, mach):
    """Return the row that interpolates the grid bilinearly at one point, as JSBSim does."""
    row = np.zeros((ALPHA.size, MACH.size))
    i = int(np.clip(np.searchsorted(ALPHA, alpha) - 1, 0, ALPHA.size - 2))
    j = int(np.clip(np.searchsorted(MACH, mach) - 1, 0, MACH.size - 2))
    a = (alpha - ALPHA[i]) / (ALPHA[i + 1] - ALPHA[i])
    b = (mach - MACH[j]) / (MACH[j + 1] - MACH[j])
    row[i : i + 2, j : j + 2] = np.outer([1 - a, a], [1 - b, b])
    return row.ravel()


def _curvature():
    """Return rows of scaled second differences over alpha and over Mach, and of the mixed one."""
    n, m = ALPHA.size, MACH.size
    index = np.arange(n * m).reshape(n, m)
    rows = []

    def add(cells):
        row = np.zeros(n * m)
        for cell, value in cells:
            row[cell] += value
        rows.append(row)

    for i in range(n):
        for j in range(1, m - 1):
            left, right = MACH[j] - MACH[j - 1], MACH[j + 1] - MACH[j]
            scale = 0.05
            add([(index[i, j - 1], scale / left), (index[i, j], -scale / left - scale / right), (index[i, j + 1], scale / right)])
    for i in range(1, n - 1):
        for j in range(m):
            add([(index[i - 1, j], 3.0), (index[i, j], -6.0), (index[i + 1, j], 3.0)])
    return np.array(rows)


def fit(prior, targets, flex, ridge=2e-3):
    """Return the table (alpha, Mach) and the two flexibility constants that meet `targets`.

    targets: {condition: (value, slope over alpha [1/rad], slope over relative speed at constant altitude)};
    flex: prior of (t0, t1) [1/psf, 1/(psf rad)]. The speed slope is M dC/dM + 2 q̄ dC/dq̄.
    """
    base = prior(ALPHA[:, None], MACH[None, :]) * np.ones((ALPHA.size, MACH.size))
    cells = base.size
    rows, rhs = [], []

    def add(table_row, t0, t1, value, weight):
        rows.append(weight * np.concatenate([table_row, [t0, t1]]))
        rhs.append(weight * (value - table_row @ base.ravel() - t0 * flex[0] - t1 * flex[1]))

    da, dm = math.radians(1.0), 0.025
    for key, (value, by_alpha, by_speed) in targets.items():
        c = FLIGHT_CONDITIONS[key]
        a, M, q = math.radians(c.alpha_deg), c.mach, c.qbar_psf
        here = _weights(a, M)
        up, down = _weights(a + da, M), _weights(a - da, M)
        fast, slow = _weights(a, M + dm), _weights(a, M - dm)
        add(here, q - Q_REF, (q - Q_REF) * a, value, 300.0)
        add((up - down) / (2 * da), 0.0, q - Q_REF, by_alpha, 30.0)
        add(M * (fast - slow) / (2 * dm), 2 * q, 2 * q * a, by_speed, 100.0)
    smooth = _curvature()
    A = np.vstack([np.array(rows), np.hstack([smooth, np.zeros((len(smooth), 2))]),
                   np.hstack([ridge * np.eye(cells), np.zeros((cells, 2))]), np.hstack([np.zeros((2, cells)), np.diag([300.0, 100.0])])])
    b = np.concatenate([rhs, np.zeros(len(smooth) + cells + 2)])
    x = np.linalg.lstsq(A, b, rcond=None)[0]
    return base + x[:-2].reshape(base.shape), (flex[0] + x[-2], flex[1] + x[-1])


def build():
    """Return {file name: text} of everything that is fitted."""
    lift, drag, moment = {}, {}, {}
    for key in FLIGHT_CONDITIONS:
        d = derivatives(key)
        stab = stabilizer_trim(key)
        lift[key] = (d["CL"] - CL_STAB * stab, d["CL_alpha"], d["M_CL_M"])
        drag[key] = (d["CD"], d["CD_alpha"], d["M_CD_M"])
        moment[key] = (d["Cm"] - CM_STAB * stab, d["Cm_alpha"], d["M_Cm_M"])
    tables = {
        "CL": fit(prior_lift, lift, (0.0, -0.0017)),
        "CD": fit(prior_drag, drag, (0.0, 0.0)),
        "Cm": fit(prior_moment, moment, (0.0, 0.0012)),
    }
    return {
        FOLDER / "aerodynamics.xml": aerodynamics_xml(ALPHA, MACH, Q_REF, tables, LATERAL),
        FOLDER / "Engines" / "turbofan.xml": engine_xml(),
    }


def main():
    """Write the files, or compare them with those on disk."""
    stale = False
    for path, text in build().items():
        if "--check" in sys.argv:
            stale |= not path.is_file() or path.read_text() != text
        else:
            path.write_text(text)
    sys.exit(1 if stale else 0)


if __name__ == "__main__":
    main()
