"""Physical constants and factors between units, named by direction: h_m = M_PER_FT * h_ft."""

import math

RAD_PER_DEG, DEG_PER_RAD = math.pi / 180.0, 180.0 / math.pi
M_PER_FT, FT_PER_M = 0.3048, 1.0 / 0.3048
M_PER_IN = 0.0254
M_S_PER_KT, KT_PER_M_S = 1852.0 / 3600.0, 3600.0 / 1852.0
N_PER_LBF, KG_PER_SLUG = 4.4482216152605, 14.593902937206364
N_M_PER_LBF_FT, PA_PER_PSF = N_PER_LBF * M_PER_FT, N_PER_LBF / M_PER_FT**2
G0 = 9.80665  # standard gravity [m/s2]

TO_SI = {  # SI unit -> the units that are read as it, and their factor
    "rad": {"rad": 1.0, "deg": RAD_PER_DEG},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": M_PER_IN},
    "-": {"-": 1.0, "1": 1.0, "%": 0.01},
    "N m": {"N m": 1.0, "kN m": 1e3, "lbf ft": N_M_PER_LBF_FT},
    "N m/rad": {"N m/rad": 1.0, "kN m/rad": 1e3, "N m/deg": 1.0 / RAD_PER_DEG},
}
