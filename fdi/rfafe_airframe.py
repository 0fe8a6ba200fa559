"""Robust fast adaptive fault estimator on the aircraft's motion only: V, alpha, q, theta, no elevator position.

    x = [V, alpha, q, theta, delta],  y = [V, alpha, q, theta],  u = command,  F = [B_u; 0]         [Sun13] (1), (39)
    f = deviation of the mean elevator from what the command asks for; left and right are parallel columns, so the
    side is not to be had

The command goes through the actuator's model, never the measured surface. V in m/s, angles in deg, q in deg/s inside.
"""

import math

import numpy as np

from actuators.block import dtype, kernel, record
from fdi import rfafe_core
from fdi.decision import held, usable
from fdi.rfafe_core import advance
from fdi.rfafe_store import from_plain, read
from fdi.tuning import thresholds

CULPRITS = ("", "elevator")
DEG = math.pi / 180.0

PARAMS = dtype(rfafe_core.PARAMS)
INPUTS = dtype([
    ("tas", "f8"), ("tas_valid", "f8"),      # true airspeed [m/s]
    ("alpha", "f8"), ("alpha_valid", "f8"),  # angle of attack [rad]
    ("q", "f8"), ("q_valid", "f8"),          # pitch rate [rad/s]
    ("theta", "f8"), ("theta_valid", "f8"),  # pitch angle [rad]
    ("command", "f8"),                       # elevator, trailing edge down + [rad]
])
STATE = dtype([
    *rfafe_core.STATE,
    ("f_hat", "f8"),  # mean over the four segments [rad]
])
OUTPUTS = ("f_hat", "r", "alarm", "verdict", "culprit", "valid")


def params(which="flight", *, stored=None, trim=None, u_delay=1.0):
    """Return PARAMS from the stored design and threshold set `which`; arguments as in `fdi.rfafe.params`."""
    stored = read("rfafe_airframe") if stored is None else stored
    t = stored["trim"] if trim is None else trim
    p = record(PARAMS, **thresholds("rfafe_airframe", which))
    y = [t["tas"], t["alpha"] / DEG, 0.0, t["theta"] / DEG]
    design = from_plain(stored["design"])
    return rfafe_core.fill(p, design, y_trim=y, u_trim=[t["elevator"] / DEG], unit=DEG, u_delay=u_delay)


def init(p):
    """Return STATE of p's shape, not yet started."""
    return np.zeros(p.shape, STATE)


@kernel
def step(x, u, p, dt):
    """Convert to the paper's units and advance the estimator."""
    good = min(usable(u.tas, u.tas_valid), usable(u.alpha, u.alpha_valid))
    good = min(good, min(usable(u.q, u.q_valid), usable(u.theta, u.theta_valid)))
    if good > 0.5:
        x.y[0] = u.tas - p.y_trim[0]
        x.y[1] = u.alpha / DEG - p.y_trim[1]
        x.y[2] = u.q / DEG - p.y_trim[2]
        x.y[3] = u.theta / DEG - p.y_trim[3]
    x.u[0] = held(u.command / DEG - p.u_trim[0], 1.0, x.u[0])
    advance(x, p, good, dt)
    x.f_hat = x.f[0]


@kernel
def rollout(x, u, p, dt, log):
    """Step every lane through every tick; x, p: (lane,), u, log: (lane, tick)."""
    for i in range(u.shape[0]):
        for k in range(u.shape[1]):
            step(x[i], u[i, k], p[i], dt)
            log[i, k] = x[i]
