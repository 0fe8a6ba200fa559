"""Roll and yaw axes of the control law: bank or heading in, ailerons and rudder out (cosim/law.py)."""

import math

from actuators.block import kernel
from cosim.law_pitch import BANK_MAX
from cosim.law_signals import ALPHA, BETA, CAS, G0, PSI, TAS, THETA, P, R, clip, trust


@kernel
def lateral(x, u, p, dt):
    """Set aileron and rudder commands."""
    y, age = x.held, x.age
    tas = max(y[TAS], 50.0)
    phi_dem = u.phi_dem
    if u.hold_psi > 0.0:
        e = p.psi_0 + u.psi_dem - y[PSI]
        e = math.atan2(math.sin(e), math.cos(e))
        phi_dem = clip(p.w_psi * tas / G0 * e, -p.phi_hold, p.phi_hold) * trust(age[PSI])
    a_ref = p.w_p * (clip(p.w_phi * (phi_dem - x.phi_ref), -p.p_max, p.p_max) - x.p_ref)
    x.p_ref = x.p_ref + a_ref * dt
    x.phi_ref = x.phi_ref + x.p_ref * dt
    phi = clip(x.phi_hat, -BANK_MAX, BANK_MAX)
    turn = G0 / tas * math.tan(phi)  # heading rate of the turn [rad/s]
    off = x.phi_ref - x.phi_hat
    steep = math.tan(clip(p.alpha_0 + (y[ALPHA] - p.alpha_0) * trust(age[ALPHA]), -0.1, 0.4))
    p_t = x.p_ref - turn * math.sin(y[THETA]) * trust(age[THETA])
    r_t = turn * math.cos(phi) * math.cos(y[THETA]) + steep * x.p_ref  # a roll about the path, not about the body
    speed2 = clip((y[CAS] / p.cas_0) * (y[CAS] / p.cas_0), 0.25, 2.5)
    steered = p.k_p * (p_t - y[P]) * trust(age[P]) + p.k_phi * off
    da = (p.da_a * a_ref + p.da_p * x.p_ref + p.da_t * turn + steered) / speed2 + x.xi_phi
    x.da_cmd = clip(da, -p.da_max, p.da_max)
    if x.da_cmd == da or (da - x.da_cmd) * off < 0.0:
        x.xi_phi = x.xi_phi + p.k_phii * off * dt

    e_r = (y[R] - r_t) * trust(age[R])
    x.r_lag = x.r_lag + dt / p.tau_r * (e_r - x.r_lag)
    # the dihedral rolls where the ailerons are at their stops
    beta = (y[BETA] - clip(p.k_cross * (da - x.da_cmd), -p.beta_max, p.beta_max)) * trust(age[BETA])
    damped = p.k_r * (e_r - x.r_lag) - p.k_beta * beta
    dr = (p.dr_a * a_ref + p.dr_p * x.p_ref + p.dr_t * turn + damped) / speed2 + x.xi_dr
    x.dr_cmd = clip(dr, -p.dr_max, p.dr_max)
    if x.dr_cmd == dr or (dr - x.dr_cmd) * beta > 0.0:
        x.xi_dr = x.xi_dr - p.k_betai * beta * dt
