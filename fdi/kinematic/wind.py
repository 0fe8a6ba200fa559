"""Horizontal wind as the kinematic rows need it: what the air itself moves over the ground, slowly changing.

    (along, right) of the heading:   along' = psi' right + noise,   right' = -psi' along + noise,   offset' = 0

A Kalman filter on two readings. Along the heading: V_g cos a_g less the airspeed's part, with the gusts in it. Across
it only where the aircraft banks, by the climb: hdot less what u, w and the vane's lateral velocity make of it is
-sin phi cos theta times the lateral velocity that is missing. That reading is inertial, so that a second of a roll
tells more than a minute of level flight. What the climb is off by wings level, its offset, is told by the same
reading, so that a bank in which it is learned leaves it uncertain and not wrong. It is not used while its row
fires: a step there is a sensor's. Until a bank has told the wind across, its variance widens the limits of the rows in
which it shows.
"""

import math

from actuators.block import kernel
from actuators.constants import G0
from fdi.kinematic.signatures import CLIMB

PRIOR = 20.0  # rms of the wind before anything is known [m/s]: 60 kt is one and a half of it
WIND_WALK = 0.15  # of the wind [m/s per root s]: 10 kt/1000 ft at 2000 ft/min is 0.17 m/s2, for a second
GUST_S = 2.7  # for which a gust is alike [s]: 1750 ft, the scale of MIL-F-8785C above 2000 ft, at 200 m/s
ALONG, ACROSS = 0.5, 0.06  # rms of the readings without gusts, correlated for GUST_S [m/s]: air data; hdot and attitude
OFFSET_SD = 1.0  # rms of the climb's offset before anything is known [m/s]: half a degree of attitude at 115 m/s
DEVIATIONS = 2.5  # deviations of the wind that widen a limit
LEARNED = 6.0  # of level flight without gusts: what is uncertain of the offset then is in the trained threshold [s]

STATE = [
    ("wind", "f8", (3,), "m/s"),  # along the heading, from left to right; last the climb's offset
    ("cov", "f8", (3, 3), "m2/s2"),  # their covariance
    ("lateral_ground", "f8", "m/s"),  # lateral velocity over the ground
    ("doubt", "f8", (3,), "m/s"),  # of climb, turn and speed by the wind's deviation
    ("push", "f8", (3,), "m2/s2"),  # covariance of the wind and what was read last
]


@kernel
def _variance(x, h0, h1, h2):
    """Fill x.push with P h and return h' P h."""
    for i in range(3):
        x.push[i] = x.cov[i, 0] * h0 + x.cov[i, 1] * h1 + x.cov[i, 2] * h2
    return h0 * x.push[0] + h1 * x.push[1] + h2 * x.push[2]


@kernel
def _update(x, h0, h1, h2, e, r):
    """Correct the wind and the offset by a reading e = h . (their errors) of variance r."""
    s = _variance(x, h0, h1, h2) + r
    for i in range(3):
        x.wind[i] += x.push[i] / s * e
        for j in range(3):
            x.cov[i, j] -= x.push[i] * x.push[j] / s


@kernel
def blow(x, p, dt):
    """Advance the wind by one tick of readings; set the lateral velocity over the ground and what limits widen by."""
    y, ok, P = x.y, x.ok, x.cov
    if P[0, 0] == 0.0:
        P[0, 0], P[1, 1], P[2, 2] = PRIOR * PRIOR, PRIOR * PRIOR, OFFSET_SD * OFFSET_SD
    sp, cp, st, ct = math.sin(y[3]), math.cos(y[3]), math.sin(y[4]), math.cos(y[4])
    rates, air = ok[0] * ok[1] * ok[2] * ok[3] * ok[4], ok[11] * ok[16] * ok[17]
    turn = dt * rates * (y[1] * sp + y[2] * cp) / ct
    a, b = x.wind[0], x.wind[1]
    x.wind[0], x.wind[1] = a + turn * b, b - turn * a
    p00, p11, p01 = P[0, 0], P[1, 1], P[0, 1]
    P[0, 0] = p00 + 2.0 * turn * p01 + WIND_WALK * WIND_WALK * dt
    P[1, 1] = p11 - 2.0 * turn * p01 + WIND_WALK * WIND_WALK * dt
    P[0, 1] = P[1, 0] = p01 + turn * (p11 - p00)
    a, b = P[0, 2], P[1, 2]
    P[0, 2] = P[2, 0] = a + turn * b
    P[1, 2] = P[2, 1] = b - turn * a
    lateral = y[11] * math.sin(y[17]) if ok[11] * ok[17] > 0.5 else 0.0
    x.lateral_ground = lateral + cp * x.wind[1] + sp * st * x.wind[0]
    white = 2.0 * GUST_S / dt
    h0, h1 = -sp * ct * sp * st, -sp * ct * cp
    if ok[3] * ok[4] * ok[14] * ok[15] > 0.5:
        u, w = plane(x)
        if air > 0.5:
            still = y[11] * math.cos(y[17])
            along = (u - still * math.cos(y[16])) * ct + (w - still * math.sin(y[16])) * cp * st
            along += (x.lateral_ground - lateral) * sp * st
            _update(x, 1.0, 0.0, 0.0, along - x.wind[0], white * (ALONG * ALONG + x.rough * x.rough))
        if ok[8] > 0.5 and x.age > p.t_settle and x.fired[CLIMB] + x.alarm <= 0.0:
            e = y[8] - (u * st - x.lateral_ground * sp * ct - w * cp * ct) - x.wind[2]
            gust = x.rough if ok[17] > 0.5 else PRIOR  # without the vane the lateral velocity is anything
            _update(x, h0, h1, 1.0, e, white * (ACROSS * ACROSS + sp * sp * gust * gust))
        x.lateral_ground = lateral + cp * x.wind[1] + sp * st * x.wind[0]
    sigma, fade = DEVIATIONS * math.sqrt(P[1, 1]), dt / p.tau
    climb = max(_variance(x, h0, h1, 1.0) - 2.0 * GUST_S * ACROSS * ACROSS / LEARNED, 0.0)
    x.doubt[0] += (1.0 - math.exp(-dt / p.tau_r)) * (DEVIATIONS * math.sqrt(climb) - x.doubt[0])
    x.doubt[1] += fade * (p.tau * math.fabs(y[0]) * sigma - x.doubt[1])
    x.doubt[2] += fade * (p.tau * G0 * math.fabs(sp) / max(y[15], 1.0) * sigma - x.doubt[2])
    x.offset[CLIMB] = x.wind[2]


@kernel
def plane(x):
    """Return the velocity over the ground along and below the body [m/s]: what is lateral is taken out."""
    v = min(math.fabs(x.lateral_ground), 0.7 * x.y[15])
    speed = math.sqrt(x.y[15] * x.y[15] - v * v)
    return speed * math.cos(x.y[14]), speed * math.sin(x.y[14])
