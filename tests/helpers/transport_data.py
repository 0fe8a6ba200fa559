"""Published 747 data that the aircraft is fitted to, and their conversion to coefficients.

[CR-2144]  R. K. Heffley, W. F. Jewell, Aircraft Handling Qualities Data, NASA CR-2144, 1972, section IX: tables IX-3
(trim) and IX-4
           (longitudinal dimensional derivatives in body axes), clean, 636,636 lb, CG 25 %.
[Roskam]   J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls, airplane J, cruise low.
"""

import math
from typing import Any, NamedTuple

from cosim.flight.plant.estimate import thrust_ratio

W_LB, IYY, S_FT2, CBAR_FT, G = 636636.0, 33.1e6, 5500.0, 27.31, 32.174
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

# Trim drag coefficient: figure IX-6 (5 to 10); 3, 4 from Xu* = -q̄S 2 C_D / (m V), no compressibility drag.
TRIM_DRAG = {3: 0.0225, 4: 0.0162, 5: 0.0400, 6: 0.0225, 7: 0.0177, 8: 0.0747, 9: 0.0430, 10: 0.0427}

# Stabiliser at trim [deg, trailing edge down +], figure IX-5; where its curves cross the reading is unsure.
STABILIZER = {3: 1.03, 4: 1.94, 5: -0.53, 6: 0.74, 7: 1.60, 8: 0.08, 9: 1.0, 10: 0.9}
STABILIZER_UNSURE = (7, 8, 9, 10)

# Figures IX-9 and on, stability axes, per rad; condition 9 from the primed body-axis derivatives of table IX-8.
CONTROLS = {
    "CL_de": {3: 0.263, 4: 0.188, 5: 0.360, 6: 0.333, 7: 0.273, 8: 0.406, 9: 0.364, 10: 0.306},
    "Cm_de": {3: -1.024, 4: -0.723, 5: -1.403, 6: -1.277, 7: -1.041, 8: -1.575, 9: -1.444, 10: -1.183},
    "Cl_da": {3: 0.0130, 4: 0.0120, 5: 0.0129, 6: 0.0123, 7: 0.0119, 8: 0.0137, 9: 0.0137, 10: 0.0140},
    "CY_dr": {3: 0.120, 4: 0.080, 5: 0.130, 6: 0.120, 7: 0.100, 8: 0.130, 9: 0.1147, 10: 0.075},
    "Cn_dr": {3: -0.0959, 4: -0.0715, 5: -0.1074, 6: -0.1000, 7: -0.0976, 8: -0.120, 9: -0.1257, 10: -0.100},
}
LATERAL = {
    "CY_beta": {3: -0.867, 4: -0.880, 5: -0.900, 6: -0.880, 7: -0.882, 8: -0.892, 9: -0.877, 10: -0.863},
    "Cl_beta": {3: -0.1768, 4: -0.1524, 5: -0.1920, 6: -0.1714, 7: -0.1640, 8: -0.2100, 9: -0.2797, 10: -0.0983},
    "Cn_beta": {3: 0.1420, 4: 0.1640, 5: 0.1465, 6: 0.1640, 7: 0.1931, 8: 0.1680, 9: 0.1946, 10: 0.2047},
    "Cl_p": {3: -0.3174, 4: -0.3285, 5: -0.3242, 6: -0.3255, 7: -0.3270, 8: -0.3174, 9: -0.3295, 10: -0.3054},
    "Cn_p": {3: -0.0334, 4: 0.0036, 5: -0.0695, 6: -0.0276, 7: 0.0030, 8: -0.0598, 9: -0.0407, 10: 0.0212},
    "Cl_r": {3: 0.1167, 4: 0.0540, 5: 0.2136, 6: 0.1359, 7: 0.1001, 8: 0.2857, 9: 0.3040, 10: 0.1965},
    "Cn_r": {3: -0.2545, 4: -0.2413, 5: -0.2765, 6: -0.2744, 7: -0.2621, 8: -0.2700, 9: -0.2737, 10: -0.2760},
}


BYPASS = 5.0  # of the engines


def thrust_speed_slope(key: Any) -> Any:
    """Return V dT/dV / T of our engine at fixed throttle and altitude."""
    c = FLIGHT_CONDITIONS[key]
    x = c.qbar_psf / (0.7 * c.mach**2 * 2116.22)
    d = 1e-4
    slower, here, faster = (thrust_ratio(c.mach * (1 + e), x, BYPASS) for e in (-d, 0.0, d))
    return (faster - slower) / (2 * d) / here


def derivatives(key: Any) -> Any:
    """Turn a row of table IX-4 into coefficients in stability axes.

    d/dV = cos a d/du + sin a d/dw, d/dalpha = V (-sin a d/du + cos a d/dw); then rotate forces by alpha. Returns CL,
    CD, Cm (aerodynamic, balancing the thrust moment), their slopes over alpha [1/rad] and over speed at constant
    altitude (M_C*_M = V dC/dV; the starred derivatives hold all of the aircraft, so what our engine's thrust
    contributes is taken off), and the rate derivatives per (q c / 2V) and (alphadot c / 2V).
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
    thrust_V = thrust * thrust_speed_slope(key) / qS
    return {
        "CL": CL,
        "CD": CD,
        "Cm": Cm,
        "CL_alpha": (-Za * ca + Xa * sa) * m / qS + CZ * sa + CX * ca,
        "CD_alpha": (-Xa * ca - Za * sa) * m / qS + CX * sa - CZ * ca,
        "Cm_alpha": Ma * IYY / (qS * CBAR_FT),
        "M_CL_M": (-ZV * ca + XV * sa) * m * V / qS - 2 * CL - thrust_V * math.sin(a + THRUST_TILT),
        "M_CD_M": (-XV * ca - ZV * sa) * m * V / qS - 2 * CD + thrust_V * math.cos(a + THRUST_TILT),
        "M_Cm_M": MV * IYY * V / (qS * CBAR_FT) - 2 * Cm - thrust_V * THRUST_ARM_FT / CBAR_FT,
        "CL_q": -Zq * m / qS * rate,
        "Cm_q": Mq * IYY / (qS * CBAR_FT) * rate,
        "Cm_alphadot": Mwd * V * IYY / (qS * CBAR_FT) * rate,
    }
