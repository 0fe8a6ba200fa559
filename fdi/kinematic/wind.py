"""Horizontal wind as the kinematic rows need it: what the air itself moves over the ground, slowly changing.

    (along, right) of the heading:   along' = psi' right + noise,   right' = -psi' along + noise

A Kalman filter on two readings. Along the heading: V_g cos a_g less the airspeed's part, with the gusts in it. Across
it only where the aircraft banks, by the climb: hdot less what u, w and the vane's lateral velocity make of it is
-sin phi cos theta times the lateral velocity that is missing. That reading is inertial, so that a second of a roll
tells more than a minute of level flight. It is not used while its row
fires: a step there is a sensor's. Until a bank has told the wind across, its variance widens the limits of the rows in
which it shows.
"""

import math

from actuators.block import kernel
from actuators.constants import G0
from fdi.kinematic.signatures import CLIMB

PRIOR = 20.0  # rms of the wind before anything is known [m/s]: 60 kt is one and a half of it
WALK = 0.15  # of the wind [m/s per root s]: 10 kt/1000 ft at 2000 ft/min is 0.17 m/s2, for a second
GUST_S = 2.7  # for which a gust is alike [s]: 1750 ft, the scale of MIL-F-8785C above 2000 ft, at 200 m/s
ALONG, ACROSS = 0.5, 0.06  # rms of the readings without gusts, correlated for GUST_S [m/s]: air data; hdot and attitude
SURE = 2.5  # deviations of the wind that widen a limit

STATE = [
    ("wind", "f8", (2,), "m/s"),  # along the heading, from left to right
    ("cov", "f8", (3,), "m2/s2"),  # its variances, and the covariance
    ("lateral_ground", "f8", "m/s"),  # lateral velocity over the ground
    ("doubt", "f8", (3,), "m/s"),  # of climb, turn and speed by the wind's deviation
]


@kernel
def _update(x, h0, h1, e, r):
    """Correct the wind by a reading e = h . (error of the wind) of variance r."""
    p00, p11, p01 = x.cov[0], x.cov[1], x.cov[2]
    g0, g1 = p00 * h0 + p01 * h1, p01 * h0 + p11 * h1
    s = h0 * g0 + h1 * g1 + r
    x.wind[0] += g0 / s * e
    x.wind[1] += g1 / s * e
    x.cov[0], x.cov[1], x.cov[2] = p00 - g0 * g0 / s, p11 - g1 * g1 / s, p01 - g0 * g1 / s


@kernel
def blow(x, p, dt):
    """Advance the wind by one tick of readings; set the lateral velocity over the ground and what limits widen by."""
    y, ok = x.y, x.ok
    if x.cov[0] == 0.0:
        x.cov[0], x.cov[1] = PRIOR * PRIOR, PRIOR * PRIOR
    sp, cp, st, ct = math.sin(y[3]), math.cos(y[3]), math.sin(y[4]), math.cos(y[4])
    rates, air = ok[0] * ok[1] * ok[2] * ok[3] * ok[4], ok[11] * ok[16] * ok[17]
    turn = dt * rates * (y[1] * sp + y[2] * cp) / ct
    a, b = x.wind[0], x.wind[1]
    x.wind[0], x.wind[1] = a + turn * b, b - turn * a
    p00, p11, p01 = x.cov[0], x.cov[1], x.cov[2]
    x.cov[0] = p00 + 2.0 * turn * p01 + WALK * WALK * dt
    x.cov[1] = p11 - 2.0 * turn * p01 + WALK * WALK * dt
    x.cov[2] = p01 + turn * (p11 - p00)
    lateral = y[11] * math.sin(y[17]) if ok[11] * ok[17] > 0.5 else 0.0
    x.lateral_ground = lateral + cp * x.wind[1] + sp * st * x.wind[0]
    white = 2.0 * GUST_S / dt
    if ok[3] * ok[4] * ok[14] * ok[15] > 0.5:
        u, w = plane(x)
        if air > 0.5:
            still = y[11] * math.cos(y[17])
            along = (u - still * math.cos(y[16])) * ct + (w - still * math.sin(y[16])) * cp * st
            along += (x.lateral_ground - lateral) * sp * st
            _update(x, 1.0, 0.0, along - x.wind[0], white * (ALONG * ALONG + x.rough * x.rough))
        if ok[8] * ok[17] > 0.5 and x.age > p.t_learn and x.fired[CLIMB] <= 0.0:
            e = y[8] - (u * st - x.lateral_ground * sp * ct - w * cp * ct) - x.offset[CLIMB]
            r = ACROSS * ACROSS + sp * sp * x.rough * x.rough
            _update(x, -sp * ct * sp * st, -sp * ct * cp, e, white * r)
        x.lateral_ground = lateral + cp * x.wind[1] + sp * st * x.wind[0]
    sigma, fade = SURE * math.sqrt(x.cov[1]), dt / p.tau
    x.doubt[0] += dt / p.tau_r * (math.fabs(sp) * sigma - x.doubt[0])
    x.doubt[1] += fade * (p.tau * math.fabs(y[0]) * sigma - x.doubt[1])
    x.doubt[2] += fade * (p.tau * G0 * math.fabs(sp) / max(y[15], 1.0) * sigma - x.doubt[2])


@kernel
def plane(x):
    """Return the velocity over the ground along and below the body [m/s]: what is lateral is taken out."""
    v = min(math.fabs(x.lateral_ground), 0.7 * x.y[15])
    speed = math.sqrt(x.y[15] * x.y[15] - v * v)
    return speed * math.cos(x.y[14]), speed * math.sin(x.y[14])
