"""Signals of the control law: what it measures, in which order, and how far to trust a signal after its flag fell."""

import math

from actuators.block import kernel
from actuators.constants import G0

SENSORS = ("alpha", "q", "theta", "phi", "p", "r", "psi", "n_z", "cas", "tas", "h_inertial", "hdot", "beta")
N = len(SENSORS)
ALPHA, Q, THETA, PHI, P, R, PSI, NZ, CAS, TAS, H, HDOT, BETA = range(N)
HOLD_S = 0.2  # a lost signal is held that long [s]
FADE_S = 0.5  # and its feedback then fades out in that time [s]
TAU_PHI = 10.0  # with which a bank carried on by p is drawn to that of the yaw rate [s]
SINE_MAX = 0.87  # of that bank: 60 deg


@kernel
def clip(v, low, high):
    """Return v within low and high."""
    return min(max(v, low), high)


@kernel
def trust(age):
    """Return the share of a feedback left at `age` [s], 1 while its signal is held, then fading to 0."""
    return min(1.0, max(0.0, 1.0 - (age - HOLD_S) / FADE_S))


@kernel
def receive(x, u, dt):
    """Take what is valid, keep the last value of the rest; carry the bank on without its sensor."""
    for i in range(N):
        if u.valid[i] > 0.0 and math.isfinite(u.y[i]):
            x.held[i] = u.y[i]
            x.age[i] = max(0.0, min(x.age[i], HOLD_S + FADE_S) - dt)
        else:
            x.age[i] = x.age[i] + dt
    if x.fresh == 0.0:
        x.fresh = 1.0
        x.h_ref = x.held[H]
        x.phi_ref = x.phi_hat = x.held[PHI]
    elif u.valid[PHI] > 0.0 and math.isfinite(u.y[PHI]):
        x.phi_hat = x.held[PHI]
    else:
        of_turn = math.asin(clip(x.held[R] * x.held[TAS] / G0, -SINE_MAX, SINE_MAX))
        drawn = (of_turn - x.phi_hat) / TAU_PHI * trust(x.age[R])
        x.phi_hat = x.phi_hat + dt * (x.held[P] * trust(x.age[P]) + drawn)
