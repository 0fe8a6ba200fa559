"""Pitch axis of the control law: who asks for load factor, within which limits, by which elevator."""

import math

from actuators.block import kernel
from actuators.constants import G0
from cosim.flight.blocks.law.signals import ALPHA, CAS, FADE_S, HDOT, HOLD_S, NZ, TAS, THETA, H, Q, clip, trust

TAU_THETA = 0.1  # of the substitute pitch rate [s]
Q_LIMIT = 0.2    # largest substitute pitch rate [rad/s]: three times that of 2.5 g at 400 kt
TAU_TRIM = 2.0   # of the elevator seen by the automatic trim [s]
TAU_ROOM = 0.2   # of `room`: the noise of n_z is 0.2 deg there [s]
TAU_PATH = 1.0   # with which the held vertical speed gives way while a protection acts [s]
LAG_N = 0.6      # of the load factor behind its demand, for the path that is held when the stick comes free [s]
BANK_MAX = 1.05  # the trigonometry of the turn stops there [rad]
TRIM_BANK = 0.58   # automatic trim is off beyond this bank, 33 deg [rad]
STICK_FREE = 0.005  # smaller demands count as zero [g]


@kernel
def _path(x, u, p, n_m):
    """Return the load-factor increment that the pilot, the altitude hold or the path hold asks for [g]."""
    y, age = x.held, x.age
    if abs(u.nz_dem) > STICK_FREE:
        x.hdot_ref, x.h_ref = y[HDOT] + LAG_N * G0 * n_m, y[H]
        return u.nz_dem
    seen = trust(age[HDOT])
    if u.hold_h > 0.0 and age[H] < HOLD_S:
        x.hdot_ref = 0.0
        climb = p.w_h * p.w_h * (x.h_ref - y[H]) - 2.0 * p.zeta_h * p.w_h * y[HDOT]
        return clip(climb / G0, -p.n_hold, p.n_hold) * seen
    return clip(p.k_path * (x.hdot_ref - y[HDOT]) / G0, -p.n_hold, p.n_hold) * seen


@kernel
def _limit(x, p, n_c, n_m, level, q_path, speed2, dt):
    """Limit n_c by load factor, attitude and, without alpha, speed; set n_c, protection, alpha_lim."""
    y, age = x.held, x.age
    protection = 0.0
    low, high = p.n_min - level, p.n_max - level
    if age[ALPHA] > HOLD_S:
        high = min(high, max(p.n_stall * speed2 - level, 0.1 - level))
    if not low <= n_c <= high:
        n_c, protection = clip(n_c, low, high), 3.0
    highest = high
    if trust(age[THETA]) > 0.0:
        gain = max(y[TAS], 50.0) / G0 * p.k_theta
        ahead = gain * p.lead * q_path
        up, down = gain * (p.theta_max - y[THETA]), gain * (p.theta_min - y[THETA])
        highest = min(high, up)
        if not down - ahead <= n_c <= up - ahead:
            n_c, protection = clip(clip(n_c, down - ahead, up - ahead), low, high), 2.0
    x.n_c, x.protection = n_c, protection
    x.room = x.room + dt / TAU_ROOM * ((highest - n_m) / (p.n_alpha * speed2) - x.room)
    x.alpha_lim = min(p.alpha_max, y[ALPHA] + x.room)


@kernel
def pitch(x, u, p, dt):
    """Set elevator and stabiliser commands."""
    y, age = x.held, x.age
    speed2 = (y[CAS] / p.cas_0) * (y[CAS] / p.cas_0)
    s = 1.0 / clip(speed2, 0.25, 2.5)
    bank = clip(x.phi_hat, -BANK_MAX, BANK_MAX)
    # gravity here, over that of the definition, is in the trim
    upright = p.nz_0 * (1.0 + (math.cos(y[THETA]) / math.cos(p.theta_0) - 1.0) * trust(age[THETA]))
    level = upright / math.cos(bank)
    turn = G0 / max(y[TAS], 50.0)  # pitch rate per g [rad/s]
    seen = trust(age[NZ])
    n_m = (y[NZ] - level) * seen

    x.theta_lag = x.theta_lag + dt / TAU_THETA * (y[THETA] - x.theta_lag)
    known = trust(age[Q])
    q = y[Q] * known + (1.0 - known) * clip((y[THETA] - x.theta_lag) / TAU_THETA, -Q_LIMIT, Q_LIMIT)
    q_path = q - turn * upright * math.sin(bank) * math.tan(bank)
    _limit(x, p, _path(x, u, p, n_m), n_m, level, q_path, max(speed2, 0.1), dt)

    e = x.n_c * seen - n_m
    e_alpha = (p.k_alpha * (p.alpha_max - y[ALPHA]) - p.k_rate * (q_path - turn * n_m)) / math.sqrt(s)
    if e_alpha < e and age[ALPHA] < HOLD_S + FADE_S:
        e = e + trust(age[ALPHA]) * (e_alpha - e)
        x.protection = 1.0
    x.e = e
    direct = (1.0 - seen) * p.k_direct * x.n_c
    n_lead = n_m + e + (1.0 - seen) * x.n_c
    de = s * (p.k_nz * (n_m - p.b_n * n_lead) + p.k_q * (q_path - turn * n_lead) - direct) + x.xi + p.de_0 + u.de_add
    x.de_cmd = clip(de, p.de_min, p.de_max)
    # integrate unless that drives further into the stop, and not on a load factor that is not there
    if (x.de_cmd == de or (de - x.de_cmd) * e > 0.0) and (seen >= 1.0 or x.protection == 1.0):
        x.xi = x.xi - s * p.k_i * e * dt
    # the path that the stick left gives way to a protection, but not beyond level flight
    if x.protection > 0.0:
        can = clip(y[HDOT], min(x.hdot_ref, 0.0), max(x.hdot_ref, 0.0))
        x.hdot_ref = x.hdot_ref + dt / TAU_PATH * (can - x.hdot_ref)
    # automatic trim: off in protections, in steep turns and while the surface is driven directly
    x.de_slow = x.de_slow + dt / TAU_TRIM * (x.de_cmd - u.de_add - p.de_0 - x.de_slow)
    if x.protection == 0.0 and abs(bank) < TRIM_BANK and abs(u.nz_dem) < 0.5 and seen >= 1.0:
        off = x.de_slow - clip(x.de_slow, -p.trim_dead, p.trim_dead)
        x.stab_cmd = clip(x.stab_cmd + dt * clip(p.k_trim * off, -p.trim_rate, p.trim_rate), p.stab_min, p.stab_max)
