"""Fit the aircraft's tables to the published 747 data and write the JSBSim files that hold them.

    python tests/helpers/transport_fit.py      writes aerodynamics.xml, Engines/turbofan.xml, Systems/multipliers.xml

Longitudinal, for CL, CD and Cm alike:

    C(alpha, M, q̄) = mean(alpha, M) + sum_j b_j(M) (a_j0 + a_j1 alpha [+ a_j2 alpha^2]) + local(alpha, M)
                     + (q̄ - 200 psf)(t0 + t1 alpha)

with smooth bumps b_j over Mach, a grid of small local bumps and two flexibility constants. Ridge regression asks for
the trim value, the slope over alpha and the slope over speed at conditions 3 to 10 of [CR-2144]; the local bumps, held
down by the ridge, take up what functions of Mach alone cannot. The lift line is then bent over into the stall. Rates,
controls and lateral coefficients: `surface`. Details, sources and what is assumed: aircraft/transport/README.md.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from transport_data import BYPASS, CONTROLS, FLIGHT_CONDITIONS, LATERAL, STABILIZER, STABILIZER_UNSURE, derivatives

from actuators.constants import M_PER_FT
from cosim.flight.plant.estimate import ALPHA, ALPHA_COARSE, MACH_COARSE, aerodynamics, render, stalled, turbofan

FOLDER = Path(__file__).resolve().parents[2] / "aircraft" / "transport"
MACH = np.concatenate([np.arange(0.2, 0.4, 0.05), np.arange(0.4, 0.9501, 0.0125)])
QBAR = np.array([50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 400.0, 500.0, 650.0, 800.0])
Q_REF = 200.0  # psf
CL_STAB, CM_STAB = 0.70, -2.70  # per rad, [Roskam] C_L_ih, C_m_ih
ASPECT = 195.68**2 / 5500.0
MADE_BY = "tests/helpers/transport_fit.py"
CONSTANTS = {
    "chord_ft": 27.31, "span_ft": 195.68,
    "tail_arm_ft": 105.3,  # [Roskam] C_m_ih / C_L_ih = -2.70 / 0.70 chords behind the CG at 25 %
    "downwash": 0.40,  # assumed (typical of transports)
    "elevator_ft3": 8.0 / M_PER_FT**2 * (1.4 / M_PER_FT),  # area times chord of a segment
    "segments": {"lo": -26.6, "li": -12.1, "ri": 12.1, "ro": 26.6},  # tail span 72.75 ft: assumed halves
    "Ch_alpha": -0.05,  # balanced elevator: assumed (README)
    "Ch_delta": -0.17, "CL_ds": CL_STAB, "Cm_ds": CM_STAB, "CD_beta": 0.2,
    "Cl_dr": 0.0070,  # stability axes, condition 9 of table IX-8
    "Cn_da": 0.0002,
}  # fmt: skip

_CENTRES = np.arange(0.2, 1.01, 0.1)  # of the bumps over Mach
_LOCAL = [(a, m) for a in np.radians(np.arange(-4.0, 12.1, 2.5)) for m in np.arange(0.4, 1.0, 0.06)]


def cl_max(mach: Any) -> Any:
    """Return the largest lift coefficient over Mach: assumed, so that every point of [Alwi14] has 1.3 g (README)."""
    return np.interp(mach, [0.2, 0.45, 0.6, 0.7, 0.8, 0.9, 0.95], [1.60, 1.56, 1.46, 1.28, 1.06, 0.92, 0.82])


def buffet_lift(mach: float) -> Any:
    """Return the lift coefficient where separation drag begins: from the drag of conditions 5, 8, 9 and 10 (README)."""
    return np.interp(mach, [0.3, 0.5, 0.7, 0.8, 0.9], [0.75, 0.66, 0.52, 0.50, 0.45])


def mean_lift(alpha: float, mach: float) -> Any:
    """Return a straight lift curve [-] over angle of attack [rad], at which the fit begins."""
    return 0.2 + 4.75 * alpha + 0.0 * mach


def mean_drag(alpha: float, mach: float) -> Any:
    """A parabolic polar (Oswald 0.93), separation beyond `buffet_lift`, and a stall."""
    lift = np.minimum(0.2 + 4.75 * alpha, 1.6)
    beyond = np.maximum(lift - buffet_lift(mach), 0.0)
    return (
        0.0165
        + lift**2 / (math.pi * ASPECT * 0.93)
        + 0.10 * beyond**2
        + 0.8 * np.maximum(alpha - math.radians(16.0), 0.0)
    )


def mean_moment(alpha: float, mach: float) -> Any:
    """A static margin of 23 % of the lift."""
    return 0.08 - 1.09 * alpha + 0.0 * mach


def _basis(alpha, mach, qbar, powers):
    """Return the row of basis functions at one point: smooth in Mach, local, flexibility."""
    bump = np.exp(-0.5 * ((mach - _CENTRES) / 0.10) ** 2)
    local = [math.exp(-0.5 * (((alpha - a) / math.radians(3.0)) ** 2 + ((mach - m) / 0.07) ** 2)) for a, m in _LOCAL]
    q = (qbar - Q_REF) / 100.0
    return np.concatenate([*(bump * (alpha / 0.1) ** k for k in range(powers + 1)), local, [q, q * alpha / 0.1]])


def fit(
    mean: Any, targets: Any, tolerance: Any, ridge: Any, powers: Any = 1, relative: Any = False, loose: Any = ()
) -> Any:
    """Return (function of alpha and Mach, (t0 [1/psf], t1 [1/(psf rad)])).

    targets: {condition: (value, slope over alpha [1/rad], speed slope V dC/dV at constant altitude)}, the last M dC/dM
    + 2 q̄ dC/dq̄.
    tolerance: one standard deviation of those three (the last times the value when `relative`, the first times 5 at
    `loose` conditions); ridge: that of (smooth, local, flexibility) coefficients.
    """
    rows, rhs = [], []
    d = 1e-4
    for key, (value, by_alpha, by_speed) in targets.items():
        c = FLIGHT_CONDITIONS[key]
        a, M, q = math.radians(c.alpha_deg), c.mach, c.qbar_psf
        speed_tolerance = tolerance[2] * (abs(value) if relative else 1.0)

        def at(a, M, q):
            return _basis(a, M, q, powers)

        value_tolerance = tolerance[0] * (5.0 if key in loose else 1.0)
        rows.append(at(a, M, q) / value_tolerance)
        rhs.append((value - float(mean(a, M))) / value_tolerance)
        rows.append((at(a + d, M, q) - at(a - d, M, q)) / (2 * d) / tolerance[1])
        rhs.append((by_alpha - float(mean(a + d, M) - mean(a - d, M)) / (2 * d)) / tolerance[1])
        rows.append(
            (at(a, M * (1 + d), q * (1 + d) ** 2) - at(a, M * (1 - d), q * (1 - d) ** 2)) / (2 * d) / speed_tolerance
        )
        rhs.append((by_speed - float(mean(a, M * (1 + d)) - mean(a, M * (1 - d))) / (2 * d)) / speed_tolerance)
    smooth = (powers + 1) * _CENTRES.size
    sigma = np.concatenate([np.full(smooth, ridge[0]), np.full(len(_LOCAL), ridge[1]), np.full(2, ridge[2])])
    A, b = np.vstack([rows, np.diag(1 / sigma)]), np.concatenate([rhs, np.zeros(sigma.size)])
    x = np.linalg.lstsq(A, b, rcond=None)[0]

    def function(alpha, mach):
        alpha, mach = np.broadcast_arrays(alpha, mach)
        flat = [_basis(a, m, Q_REF, powers) @ x + float(mean(a, m)) for a, m in zip(alpha.ravel(), mach.ravel())]
        return np.array(flat).reshape(alpha.shape)

    return function, (x[-2] / 100.0, x[-1] / 10.0)


def surface(values: Any, second: Any, spread: float = 0.30, noise: float = 0.004) -> Any:
    """Return f(M, y), y = alpha [rad] or q̄ [psf], through {condition: value}: a plane plus Gaussian-process residual.

    Lengths: `spread` in Mach, 8 deg in alpha, 350 psf in q̄; noise relative to the largest value.
    """
    keys = list(values)
    length = math.radians(8.0) if second == "alpha" else 350.0

    def coordinate(key):
        c = FLIGHT_CONDITIONS[key]
        return c.mach / spread, (math.radians(c.alpha_deg) if second == "alpha" else c.qbar_psf) / length

    X = np.array([coordinate(k) for k in keys])
    y = np.array([values[k] for k in keys])
    scale = np.abs(y).max()

    def kernel(P, Q):
        return 0.15**2 * np.exp(-0.5 * ((P[:, None, :] - Q[None, :, :]) ** 2).sum(axis=2)) + (P @ Q.T) * 0.15**2 + 1.0

    mean = np.average(y)
    weights = np.linalg.solve(kernel(X, X) + noise**2 * np.eye(len(X)), (y - mean) / scale)

    def function(mach, other):
        mach, other = np.broadcast_arrays(mach, other)
        P = np.column_stack([mach.ravel() / spread, other.ravel() / length])
        return (mean + scale * kernel(P, X) @ weights).reshape(mach.shape)

    return function


def targets() -> Any:
    """Return the targets of CL, CD, Cm at every condition, the stabiliser's share taken off."""
    lift, drag, moment = {}, {}, {}
    for key in FLIGHT_CONDITIONS:
        d = derivatives(key)
        stab = math.radians(STABILIZER[key])
        lift[key] = (d["CL"] - CL_STAB * stab, d["CL_alpha"], d["M_CL_M"])
        drag[key] = (d["CD"], d["CD_alpha"], d["M_CD_M"])
        moment[key] = (d["Cm"] - CM_STAB * stab, d["Cm_alpha"], d["M_Cm_M"])
    return {"CL": lift, "CD": drag, "Cm": moment}


def longitudinal() -> Any:
    """Return {name: (function, (t0, t1))} of the three fits."""
    t = targets()
    return {
        "CL": fit(mean_lift, t["CL"], (0.003, 0.02, 0.03), (0.1, 0.010, 0.02), relative=True),
        "CD": fit(mean_drag, t["CD"], (0.0004, 0.005, 0.0005), (0.005, 0.008, 0.0005), powers=2),
        "Cm": fit(mean_moment, t["Cm"], (0.008, 0.01, 0.0003), (0.08, 0.008, 0.01), loose=STABILIZER_UNSURE),
    }


def tables() -> dict[str, Any]:
    """Return {name: (grid (alpha, Mach), (t0, t1))} with the stall built in."""
    fits = longitudinal()
    a, m = ALPHA[:, None], MACH[None, :]
    line = fits["CL"][0](a, m)
    lift = stalled(line, cl_max(m))
    lost = line - lift  # lift lost to separation: the nose-down moment of a tail that keeps its own
    drag = np.maximum(fits["CD"][0](a, m), 0.012)
    moment = fits["Cm"][0](a, m) - 0.15 * np.maximum(lost, 0.0)
    return {"CL": (lift, fits["CL"][1]), "CD": (drag, fits["CD"][1]), "Cm": (moment, fits["Cm"][1])}


def coefficients() -> dict[str, dict[int, float]]:
    """Return {name: {condition: value}} of rates, controls and lateral coefficients."""
    rates = {k: {c: derivatives(c)[k] for c in FLIGHT_CONDITIONS} for k in ("CL_q", "Cm_q", "Cm_alphadot")}
    return {**rates, **CONTROLS, **LATERAL}


def derivative_tables() -> Any:
    """Return {name: (second variable, second grid, table (Mach, second))} of `coefficients`."""
    out = {}
    for name, values in coefficients().items():
        second = "alpha" if name in ("Cl_beta", "Cl_r", "Cn_p") else "qbar"
        grid = ALPHA_COARSE if second == "alpha" else QBAR
        out[name] = (second, grid, surface(values, second)(MACH_COARSE[:, None], grid[None, :]))
    return out


def build() -> dict[Path, str]:
    """Return {path: text} of everything that is fitted."""
    return {
        FOLDER / "aerodynamics.xml": aerodynamics(MADE_BY, MACH, Q_REF, tables(), derivative_tables(), CONSTANTS),
        FOLDER / "Engines" / "turbofan.xml": turbofan(MADE_BY, 300e3, BYPASS),
        FOLDER / "Systems" / "multipliers.xml": render("multipliers.xml", made_by=MADE_BY),
    }


if __name__ == "__main__":
    for path, text in build().items():
        path.write_text(text)
