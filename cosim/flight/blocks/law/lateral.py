"""Roll and yaw axes of the control law: bank or heading in, ailerons and rudder out."""

import math

from actuators.block import kernel
from actuators.constants import G0
from cosim.flight.blocks.law.pitch import BANK_MAX
from cosim.flight.blocks.law.signals import ALPHA, BETA, CAS, PSI, TAS, THETA, P, R, clip, trust

AILERON_SHARE = 0.75  # of the aileron that holding a bank may take: the rest is left for gusts and failures
LIFT_SHARE = 0.95     # of the load factor that the angle-of-attack limit leaves, likewise


@kernel
def bank_limit(p, tas, speed2):
    """Return the bank that the ailerons hold against the turn and whose turn the wing carries, at this speed [rad]."""
    turn = AILERON_SHARE * p.da_max * speed2 / max(abs(p.da_t), 0.01)
    carried = LIFT_SHARE * p.n_stall * speed2
    return min(math.atan(turn * tas / G0), math.acos(1.0 / max(carried, 1.02)))


@kernel
def lateral(x, u, p, dt):
    """Set aileron and rudder commands."""
    y, age = x.held, x.age
    tas = max(y[TAS], 50.0)
    speed2 = clip((y[CAS] / p.cas_0) * (y[CAS] / p.cas_0), 0.25, 2.5)
    phi_dem = u.phi_dem
    if u.hold_psi > 0.0:
        e = p.psi_0 + u.psi_dem - y[PSI]
        e = math.atan2(math.sin(e), math.cos(e))
        phi_dem = clip(p.w_psi * tas / G0 * e, -p.phi_hold, p.phi_hold) * trust(age[PSI])
    most = bank_limit(p, tas, speed2)
    phi_dem = clip(phi_dem, -most, most)
    a_ref = p.w_p * (clip(p.w_phi * (phi_dem - x.phi_ref), -p.p_max, p.p_max) - x.p_ref)
    x.p_ref = x.p_ref + a_ref * dt
    x.phi_ref = x.phi_ref + x.p_ref * dt
    phi = clip(x.phi_hat, -BANK_MAX, BANK_MAX)
    turn = G0 / tas * math.tan(phi)  # heading rate of the turn [rad/s]
    off = x.phi_ref - x.phi_hat
    steep = math.tan(clip(p.alpha_0 + (y[ALPHA] - p.alpha_0) * trust(age[ALPHA]), -0.1, 0.4))
    p_t = x.p_ref - turn * math.sin(y[THETA]) * trust(age[THETA])
    r_t = turn * math.cos(phi) * math.cos(y[THETA]) + steep * x.p_ref  # a roll about the path, not about the body
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
