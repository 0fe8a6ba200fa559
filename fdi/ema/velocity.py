"""Prediction of the motor, its correction by the velocity sensor or, without that, by the position."""

import math

from actuators.block import kernel
from fdi.common.decision import clipped, usable
from fdi.ema.gains import GAIN, MAGNETS, RATE

NEAR = 0.95  # of V_max: this drive, whose constants are off by 5 %, may be at its limit
IMPACT = 0.45  # of `gate`, which the stall current does not reach in a tick
T_IMPACT = 0.05  # [s]


@kernel
def _limited(x, demand, omega, p):
    """Return (demand, at V_max): the demand that in the nominal drive without limits gives the current of this one,
    quasi-steady as in `ema`, with the gains that have been learned.
    """
    back = p.K_B * omega
    i = ((1.0 + x.own[GAIN]) * p.K_gi * demand - (1.0 - x.own[MAGNETS]) * back) / p.R_loop
    g = min(max(i, -p.I_max), p.I_max)
    volts = p.R * g + back
    if math.fabs(volts) > p.V_max:
        g = (math.copysign(p.V_max, volts) - back) / p.R
    return (g * p.R_loop + back) / p.K_gi, 1.0 if math.fabs(volts) > NEAR * p.V_max else 0.0


@kernel
def predict(x, demand, p):
    """Predict the state by a tick under a `demand`, as far as current and voltage let it through."""
    demand, x.at_limit = _limited(x, demand, x.x_hat[3], p)
    for i in range(6):
        s = p.G[i] * demand + p.G_h[i] * x.hm0
        for j in range(6):
            s += (p.Phi[i, j] + x.hmd * p.Phi_h[i, j]) * x.x_hat[j]
        x.work[i] = s
    x.turn = x.work[3] - x.x_hat[3]
    for i in range(6):
        x.x_hat[i] = x.work[i]


@kernel
def _follow(x, K, gamma, p):
    """Correct the state by the innovation `gamma` with the gain `K`."""
    for i in range(6):
        x.x_hat[i] += K[i] * gamma
    x.x_hat[5] = clipped(x.x_hat[5], p.load_max)


@kernel
def correct(x, u, p, dt):
    """Correct by the velocity sample, unless it is missing or impossible; return (rate, its mean over the tick,
    innovation) [rad/s]."""
    gamma = 0.0
    seen = usable(u.y_velocity, u.velocity_valid) > 0.5
    if seen:
        gamma = u.y_velocity - x.own[RATE] * x.turn - x.x_hat[3]  # as old as it has been learned to be
        # a spike is far from the model and from the sample before it
        seen = math.fabs(gamma) < p.gate or math.fabs(u.y_velocity - x.raw_last) < p.gate
        x.impact = T_IMPACT if math.fabs(u.y_velocity - x.raw_last) >= IMPACT * p.gate else max(x.impact - dt, 0.0)
        x.raw_last = u.y_velocity
    if seen:
        if x.age_vel > p.t_bad:  # over the gap the integral is not known
            x.impact = T_IMPACT
        x.age_vel = 0.0
        _follow(x, p.K, gamma, p)
    else:
        x.age_vel += dt
        gamma = 0.0
        if x.age_vel > p.t_bad and usable(u.y_position, u.position_valid) > 0.5:
            _follow(x, p.K_angle, u.y_position / p.lead - x.x_hat[2], p)
    w = u.y_velocity if x.age_vel == 0.0 else x.x_hat[3]
    mean = 0.5 * (w + x.w_last)
    x.w_last = w
    x.eta = gamma / p.S_root
    return w, mean, gamma
