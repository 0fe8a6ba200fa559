"""Physical constants and factors between units, named by direction: h_m = M_PER_FT * h_ft."""

import math

RAD_PER_DEG, DEG_PER_RAD = math.pi / 180.0, 180.0 / math.pi
M_PER_FT, FT_PER_M = 0.3048, 1.0 / 0.3048
M_PER_IN = 0.0254
M_S_PER_KT, KT_PER_M_S = 1852.0 / 3600.0, 3600.0 / 1852.0
N_PER_LBF, KG_PER_SLUG = 4.4482216152605, 14.593902937206364
N_M_PER_LBF_FT, PA_PER_PSF = N_PER_LBF * M_PER_FT, N_PER_LBF / M_PER_FT**2
G0 = 9.80665  # standard gravity [m/s2]
