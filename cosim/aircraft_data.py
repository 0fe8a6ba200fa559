"""Published 747 data that the aircraft is fitted to, and their conversion to coefficients.

[CR-2144]  R. K. Heffley, W. F. Jewell, Aircraft Handling Qualities Data, NASA CR-2144, 1972, section IX: tables IX-3 (trim) and IX-4
           (longitudinal dimensional derivatives in body axes), clean, 636,636 lb, CG 25 %.
[Roskam]   J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls, airplane J, cruise low.
"""

import math
from typing import NamedTuple

W_LB, IYY, S_FT2, CBAR_FT, SPAN_FT, G = 636636.0, 33.1e6, 5500.0, 27.31, 195.68, 32.174
THRUST_ARM_FT, THRUST_TILT = 10.0, math.radians(2.5)


class Condition(NamedTuple):
    """A row of table IX-3."""

    altitude_ft: float
    mach: float
    tas_ft_s: float
    qbar_psf: float
    alpha_deg: float


FLIGHT_CONDITIONS = {
    3: Condition(0.0, 0.45, 502.0, 300.0, 3.1),
    4: Condition(0.0, 0.65, 726.0, 626.0, 0.0),
    5: Condition(20000.0, 0.50, 518.0, 170.0, 6.8),
    6: Condition(20000.0, 0.65, 674.0, 288.0, 2.5),
    7: Condition(20000.0, 0.80, 830.0, 436.0, 0.0),
    8: Condition(40000.0, 0.70, 678.0, 135.0, 7.3),
    9: Condition(40000.0, 0.80, 774.0, 177.0, 4.6),
    10: Condition(40000.0, 0.90, 871.0, 224.0, 2.4),
}

# Table IX-4: Xu*, Zu*, Mu*, Xw, Zw, Mw, Zwdot, Zq, Mwdot, Mq (ft, s, per unit mass and inertia).
DIMENSIONAL = {
    3: (-0.00499, -0.0807, 0.000146, 0.0743, -0.736, -0.00262, 0.0297, -10.4, -0.000221, -0.699),
    4: (-0.00777, -0.126, -0.000199, 0.0345, -0.963, -0.00239, 0.0293, -12.8, -0.000228, -0.925),
    5: (-0.00247, -0.0679, 0.000247, 0.0782, -0.433, -0.00170, 0.0157, -6.39, -0.000125, -0.421),
    6: (-0.00280, -0.0832, 0.0000885, 0.0482, -0.539, -0.00190, 0.0156, -8.09, -0.000155, -0.535),
    7: (-0.00643, -0.0941, -0.000222, 0.0253, -0.624, -0.00153, 0.0144, -9.98, -0.000212, -0.659),
    8: (0.00187, -0.0696, 0.000259, 0.0263, -0.292, -0.00101, 0.00704, -4.32, -0.0000905, -0.284),
    9: (-0.00276, -0.0650, 0.000193, 0.0389, -0.317, -0.00105, 0.00556, -5.16, -0.000116, -0.339),
    10: (-0.0200, -0.0424, -0.0000623, 0.0159, -0.401, -0.00190, 0.00614, -6.71, -0.000160, -0.401),
}

# Trim drag coefficient: 5, 7 figure IX-6 as scaled by Caughey; 8, 9, 10 figure IX-6; 3, 4, 6 the polar of 5 and 7 at the same lift.
TRIM_DRAG = {3: 0.0216, 4: 0.0158, 5: 0.0393, 6: 0.0222, 7: 0.0174, 8: 0.0747, 9: 0.0430, 10: 0.0427}

# Stabiliser at trim [deg, trailing edge down +], figure IX-5 (SL and 40K still first estimates)
STABILIZER_DEG = {3: 0.5, 4: 1.0, 5: -0.53, 6: 0.74, 7: 1.63, 8: 0.0, 9: 0.5, 10: 1.0}

LATERAL = {
    "CY_beta": -0.90, "Cl_beta": -0.16, "Cn_beta": 0.16, "Cl_p": -0.34, "Cn_p": -0.026, "Cl_r": 0.13, "Cn_r": -0.28,
    "Cl_da": 0.013, "Cn_da": 0.0018, "CY_dr": 0.12, "Cl_dr": 0.008, "Cn_dr": -0.10,
}


def stabilizer_trim(key):
    """Return the stabiliser at trim [rad], trailing edge down +."""
    return math.radians(STABILIZER_DEG[key])


def derivatives(key):
    """Turn a row of table IX-4 into coefficients in stability axes.

    d/dV = cos a d/du + sin a d/dw, d/dalpha = V (-sin a d/du + cos a d/dw); then rotate forces by alpha. Returns CL, CD, Cm (aerodynamic, balancing
    the thrust moment), their slopes over alpha [1/rad], over speed at constant altitude (M_C*_M = V dC/dV, thrust taken as constant with
    speed), and the rate derivatives per (q c / 2V) and (alphadot c / 2V).
    """
    c = FLIGHT_CONDITIONS[key]
    Xu, Zu, Mu, Xw, Zw, Mw, _, Zq, Mwd, Mq = DIMENSIONAL[key]
    a, V = math.radians(c.alpha_deg), c.tas_ft_s
    ca, sa, qS, m = math.cos(a), math.sin(a), c.qbar_psf * S_FT2, W_LB / G
    CD = TRIM_DRAG[key]
    thrust = CD * qS / math.cos(a + THRUST_TILT)
    CL = (W_LB - thrust * math.sin(a + THRUST_TILT)) / qS
    Cm = -thrust * THRUST_ARM_FT / (qS * CBAR_FT)
    XV, ZV, MV = ca * Xu + sa * Xw, ca * Zu + sa * Zw, ca * Mu + sa * Mw
    Xa, Za, Ma = V * (ca * Xw - sa * Xu), V * (ca * Zw - sa * Zu), V * (ca * Mw - sa * Mu)
    CX, CZ = -CD * ca + CL * sa, -CL * ca - CD * sa
    rate = 2.0 * V / CBAR_FT
    return {
        "CL": CL, "CD": CD, "Cm": Cm,
        "CL_alpha": (-Za * ca + Xa * sa) * m / qS + CZ * sa + CX * ca,
        "CD_alpha": (-Xa * ca - Za * sa) * m / qS + CX * sa - CZ * ca,
        "Cm_alpha": Ma * IYY / (qS * CBAR_FT),
        "M_CL_M": (-ZV * ca + XV * sa) * m * V / qS - 2 * CL,
        "M_CD_M": (-XV * ca - ZV * sa) * m * V / qS - 2 * CD,
        "M_Cm_M": MV * IYY * V / (qS * CBAR_FT) - 2 * Cm,
        "CL_q": -Zq * m / qS * rate,
        "Cm_q": Mq * IYY / (qS * CBAR_FT) * rate,
        "Cm_alphadot": Mwd * V * IYY / (qS * CBAR_FT) * rate,
    }
