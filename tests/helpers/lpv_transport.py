"""A longitudinal transport written from public data, for tests only: nonlinear equations, trim and linearisation.

Data: Boeing 747 as printed by Roskam (airplane J, cruise low, M 0.65 at 20,000 ft; per radian, stability axes) in
data/b747_reference.json of the sources: geometry, CL, CD and Cm derivatives. Own assumptions, all marked: lift slope
follows Prandtl-Glauert about M 0.65, Cm_alpha moves with CG by CL_alpha (cg - 0.25), alpha-dot derivatives are left
out, thrust acts along the body axis through the CG, Iyy keeps its radius of gyration.

States and units are those of [Alwi14] (33), (37): x = [alpha deg, Z m, theta deg, V m/s, q deg/s],
u = [elevator deg, stabiliser deg] (trailing edge down +), y = [Z, theta, V, q, n_z (g), alpha],
rho = [mass t, CG per cent, CAS kt, Mach].
"""

import functools

import numpy as np
from scipy.optimize import brentq, fsolve

from cosim.papers.alwi14.flights import POINTS  # noqa: F401 (Table 4)
from cosim.papers.alwi14.plant import fly  # noqa: F401 (the tests fly this transport with it)
from fdi.lpv_smo import model as lpv_model

S_REF, B_REF, C_REF = 5500 * 0.3048**2, 196 * 0.3048, 27.3 * 0.3048
IYY_PER_MASS = 3.31e7 * 1.3558179 / (636636 * 0.45359237)  # radius of gyration squared [m2]
CD0, OSWALD, CL0, CLA, CLQ, CLDE, CLIH = 0.0171, 0.7, 0.21, 4.4, 6.6, 0.32, 0.7
CMA, CMQ, CMDE, CMIH, CM0 = -1.0, -20.5 - 4.0, -1.3, -2.7, 0.0  # Cm_q carries Cm_alpha-dot (own)
G, R, KT, DEG = 9.80665, 287.05287, 1852 / 3600, np.pi / 180
BOX = np.array([[260, 405], [28, 36], [210, 270], [0.40, 0.68]])  # [Alwi14] section 4.3


def atmosphere(h):
    """Return pressure [Pa], density [kg/m3], speed of sound [m/s] of the standard troposphere at `h` [m]."""
    t = 288.15 - 0.0065 * h
    p = 101325 * (t / 288.15) ** 5.2558797
    return p, p / (R * t), np.sqrt(1.4 * R * t)


def altitude(cas_kt, mach):
    """Return the altitude [m] where `cas_kt` is flown at `mach`."""
    impact = 101325 * ((1 + 0.2 * (cas_kt * KT / 340.294) ** 2) ** 3.5 - 1)
    return brentq(lambda h: atmosphere(h)[0] * ((1 + 0.2 * mach**2) ** 3.5 - 1) - impact, -5000, 16000)


def derivative(x, u, rho, thrust):
    """Return x' and n_z of the nonlinear model; `thrust` [N]."""
    a, z, th, v, q = x * [DEG, 1, DEG, 1, DEG]
    mass, cg = rho[0] * 1e3, rho[1] / 100
    _, density, sound = atmosphere(z)
    pg = np.sqrt((1 - 0.65**2) / (1 - min(v / sound, 0.9) ** 2))
    qs, qc = 0.5 * density * v * v * S_REF, q * C_REF / (2 * v)
    cl = CL0 + pg * CLA * a + CLQ * qc + CLDE * u[0] * DEG + CLIH * u[1] * DEG
    cd = CD0 + cl**2 / (np.pi * OSWALD * B_REF**2 / S_REF)
    cm = CM0 + (CMA + pg * CLA * (cg - 0.25)) * a + CMQ * qc + CMDE * u[0] * DEG + CMIH * u[1] * DEG
    gam = th - a
    v_dot = (thrust * np.cos(a) - qs * cd) / mass - G * np.sin(gam)
    a_dot = q - (qs * cl + thrust * np.sin(a)) / (mass * v) + G * np.cos(gam) / v
    q_dot = qs * C_REF * cm / (mass * IYY_PER_MASS)
    n_z = qs * (cl * np.cos(a) + cd * np.sin(a)) / (mass * G)
    return np.array([a_dot / DEG, v * np.sin(gam), q / DEG, v_dot, q_dot / DEG]), n_z


def trim(rho):
    """Return x, u, thrust of level flight at `rho`."""
    h = altitude(rho[2], rho[3])
    v = rho[3] * atmosphere(h)[2]

    def residual(w):
        dx, _ = derivative(np.array([w[0], h, w[0], v, 0]), np.array([0, w[1]]), rho, w[2] * 1e5)
        return [dx[0], dx[3], dx[4]]

    w = fsolve(residual, [3.0, 0.0, 2.0], xtol=1e-12)
    return np.array([w[0], h, w[0], v, 0.0]), np.array([0.0, w[1]]), w[2] * 1e5


def linearise(rho):
    """Return A, B, C, D by central differences, and the trim vector [x; u; y]."""
    x0, u0, thrust = trim(rho)

    def both(w):
        x, u = w[:5], w[5:]
        dx, n_z = derivative(x, u, rho, thrust)
        return np.concatenate([dx, [x[1], x[2], x[3], x[4], n_z, x[0]]])

    w0 = np.concatenate([x0, u0])
    step = np.array([1e-3, 1.0, 1e-3, 1e-2, 1e-3, 1e-3, 1e-3])
    J = np.column_stack([(both(w0 + e) - both(w0 - e)) / (2 * h) for e, h in zip(np.diag(step), step, strict=True)])
    return J[:5, :5], J[:5, 5:], J[5:, :5], J[5:, 5:], np.concatenate([w0, both(w0)[5:]])


def flyable(rho):
    """Say whether `rho` lies above the sea and below 85 % of a maximum lift coefficient of 1.4 (own)."""
    h = altitude(rho[2], rho[3])
    p = atmosphere(max(h, 0))[0]
    return 0 <= h <= 11000 and rho[0] * 1e3 * G / (0.7 * p * rho[3] ** 2 * S_REF) < 0.85 * 1.4


def grid(n):
    """Return the flyable points of a regular grid with `n` values per parameter, (k, 4)."""
    axes = [np.linspace(lo, hi, n) for lo, hi in BOX]
    points = np.array(np.meshgrid(*axes, indexing="ij")).reshape(4, -1).T
    return np.array([r for r in points if flyable(r)])


@functools.cache
def model():
    """Return the fitted `LpvModel` on a 4^4 grid."""
    rho = grid(4)
    parts = [linearise(r) for r in rho]
    scales = {"A": (3, 100, 3, 5, 3), "B": (5, 2), "C": (3, 100, 3, 5, 3), "D": (5, 2)}  # of states and inputs
    fitted = {
        name: lpv_model.fit(rho, np.array([p[i] for p in parts]), box=BOX, scale=np.array(scale))[0]
        for i, (name, scale) in enumerate(scales.items())
    }
    return lpv_model.LpvModel(
        **fitted,
        box=BOX,
        trim=lpv_model.fit_trim(rho, np.array([p[4] for p in parts]), box=BOX),
        states=("alpha_deg", "z_m", "theta_deg", "v_m_s", "q_deg_s"),
        inputs=("elevator_deg", "stabiliser_deg"),
        outputs=("z_m", "theta_deg", "v_m_s", "q_deg_s", "n_z_g", "alpha_deg"),
        rho=("mass_t", "cg_pct", "cas_kt", "mach"),
    )
