"""Position of an EMA from its velocity sensor: dead reckoning, tied slowly to the position sensor while all is well.

    reckon += N dt (w_k + w_k-1) / 2,   pos_hat = reckon + c,   R1 = y_position - pos_hat
    c+ = c + dt b,   b+ = b + noise     corrected by R1 with a large assumed noise, so that it ties within some 20 s

Kinematics alone: no load, no torque and no parameter but the screw's lead enters.
"""

import math

from actuators.block import kernel
from actuators.ema.jay import PERIOD
from fdi.common.decision import usable
from fdi.ema.ema_kalman import POSITION, VELOCITY

T_SURFACE = 2.0  # a position that is lost is tied to the surface's within [s]
# what a wrong velocity has moved follows the position within [s]: settled before the alarm of a healed sensor ends (1 s
# of release), and slow beside the load estimate, which has to follow the hinge moment of the angle that is corrected
T_ANCHOR = 0.3
DOUBT = 0.5  # of a threshold, from which on nothing is learned


def slot(dt: float) -> float:
    """Return the ticks of a slot: the fewest of `dt` [s] that last 5 ms."""
    return float(max(math.ceil(PERIOD / dt - 1e-9), 1))


@kernel
def _tie(x, p):
    """Correct (c, b) by R1: a scalar Kalman update of two states."""
    S = x.P_cc + p.sigma_tie * p.sigma_tie
    k_c, k_b = x.P_cc / S, x.P_cb / S
    x.c += k_c * x.R1
    x.b = min(max(x.b + k_b * x.R1, -p.b_max * p.lead), p.b_max * p.lead)
    x.P_bb -= k_b * x.P_cb
    x.P_cb -= k_b * x.P_cc
    x.P_cc -= k_c * x.P_cc


@kernel
def _anchor(x, p, share):
    """Follow the position by `share` of R1: what a wrong velocity has left in c, and its covariance, leak away."""
    x.c += share * x.R1
    x.P_cc += share * (p.sigma_pos * p.sigma_pos - x.P_cc)
    x.P_cb -= share * x.P_cb


@kernel
def _slot(x, p, h):
    """End a slot of `h` seconds: R1 and the anchor."""
    mean, seen = x.sum_drift / p.n_sub, x.n_position > 0.0
    x.sum_drift = x.n_position = 0.0
    if seen:
        x.R1 = mean - x.c
    witnessed = seen and x.age_surface == 0.0 and x.r_pair < DOUBT
    if (seen and x.isolated_part == VELOCITY) or (witnessed and x.alarm < 0.5 and math.fabs(x.R1) >= p.th_R1):
        _anchor(x, p, h / T_ANCHOR)
    elif x.isolated_part == POSITION and x.age_surface == 0.0:
        x.c += h / T_SURFACE * (x.y_arm + x.rigging - x.reckon - x.c)
        x.P_cc += h / T_SURFACE * (p.sigma_rig * p.sigma_rig - x.P_cc)
        x.P_cb = 0.0
    elif seen and x.age_vel == 0.0 and x.alarm < 0.5:
        if math.fabs(x.R1) < p.th_R1 and max(x.r_pair, x.r_speed) < DOUBT:
            _tie(x, p)


@kernel
def reckon_position(x, u, p, dt, back):
    """Form R1; tie the anchor while nothing is suspected; `back`: velocity returns after a gap."""
    walk, wander = p.lead * p.sigma_vel * dt, p.lead * p.walk_b
    x.c += x.b * dt
    x.P_cc += 2.0 * dt * x.P_cb + dt * dt * x.P_bb + walk * walk
    x.P_cb += dt * x.P_bb
    x.P_bb += wander * wander
    if usable(u.y_position, u.position_valid) > 0.5:
        x.drift = u.y_position - x.reckon
        if back or x.age == dt:
            x.c = x.drift
            x.sum_drift = x.drift * ((x.count if x.count > 0.0 else p.n_sub) - 1.0)  # the slot's ticks before this one
        x.n_position += 1.0
    x.sum_drift += x.drift
    if x.count == 0.0:
        _slot(x, p, p.n_sub * dt)
    x.pos_hat = x.reckon + x.c
    if x.age_vel == 0.0:  # the filter's angle sees the hinge stiffness alone: a velocity error would stay in its load
        turn = dt / T_ANCHOR * (x.pos_hat / p.lead - x.x_hat[2])
        x.x_hat[2] += turn
        x.x_hat[0] += p.ratio * turn
    x.pos_sigma = math.sqrt(p.sigma_rig * p.sigma_rig + x.P_cc)
