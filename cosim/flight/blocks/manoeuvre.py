"""Manoeuvres: what the pilot or the flight-test computer demands, as a table of steps with limited slopes.

Every kind is a table of times and demanded values that hold until the next time; the demand moves towards them at a
limited rate, as a hand on a stick does.
The tables are built from the scenario's few numbers, the same way at every flight point.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record

N = 16  # longest table
CHANNELS = ("nz_dem", "phi_dem", "psi_dem", "de_add")

PARAMS = dtype([
    ("time", "f8", (N,), "s"),  # start of each step, inf where unused
    ("nz_dem", "f8", (N,), "g"),  # demanded load-factor increment over level flight
    ("phi_dem", "f8", (N,), "rad"), # demanded bank angle
    ("psi_dem", "f8", (N,), "rad"), # demanded change of heading, with the heading hold
    ("de_add", "f8", (N,), "rad"),  # surface motion added to the elevator command
    ("rate", "f8", (4,)),    # slope limits of the four [g/s, rad/s, rad/s, rad/s]
    ("hold_psi", "f8"),      # 1: the heading hold steers, not the bank demand
    ("hold_h", "f8"),        # 1: the altitude hold steers while the stick is free
    ("hold_v", "f8"),        # 1: the speed hold moves the throttles
])
INPUTS = dtype([("t", "f8", "s")])  # time of the tick
STATE = dtype([
    ("nz_dem", "f8", "g"),
    ("phi_dem", "f8", "rad"),
    ("psi_dem", "f8", "rad"),
    ("de_add", "f8", "rad"),
    ("hold_psi", "f8", "-"), ("hold_h", "f8", "-"), ("hold_v", "f8", "-"),  # holds engaged
])
OUTPUTS = ("nz_dem", "phi_dem", "psi_dem", "de_add", "hold_psi", "hold_h", "hold_v")


NZ_RATE = 2.0  # [g/s] full stick in one second
PHI_RATE = math.radians(3.0)  # [rad/s] a transport's gentle roll
PSI_RATE = math.radians(10.0)  # [rad/s] a hand on the heading knob


def params(
    steps: Any, *, hold_psi: bool = False, hold_h: bool = False, hold_v: bool = False, nz_rate: Any = NZ_RATE,
    phi_0: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Build the table from `steps`, a list of (time [s], {channel: value}), for a flight that starts at bank `phi_0`.

    A channel keeps its value where a step does not name it; there are at most 15 steps.
    """
    holds = {"hold_psi": float(hold_psi), "hold_h": float(hold_h), "hold_v": float(hold_v)}
    p = record(PARAMS, **holds, rate=(nz_rate, PHI_RATE, PSI_RATE, math.inf))
    p["time"][0, :] = np.inf
    p["time"][0, 0] = -np.inf
    now = {**dict.fromkeys(CHANNELS, 0.0), "phi_dem": phi_0}
    p["phi_dem"][0, 0] = phi_0
    for i, (time, values) in enumerate(steps, start=1):
        now.update(values)
        p["time"][0, i] = time
        for name in CHANNELS:
            p[name][0, i] = now[name]
    return p


def init(p: np.ndarray) -> np.ndarray:
    """Return the demands before the first step: zero, and the bank of the start."""
    x = np.zeros(p.shape, STATE)
    x["phi_dem"] = p["phi_dem"][:, 0]
    return x


@kernel
def _towards(x, target, most):
    return min(max(target, x - most), x + most)


@kernel
def step(x, u, p, dt):
    """Move each demand towards the table's value at time u.t, no faster than its slope limit."""
    i = 0
    while i + 1 < N and u.t > p.time[i + 1] - 0.5 * dt:
        i += 1
    x.nz_dem = _towards(x.nz_dem, p.nz_dem[i], p.rate[0] * dt)
    x.phi_dem = _towards(x.phi_dem, p.phi_dem[i], p.rate[1] * dt)
    x.psi_dem = _towards(x.psi_dem, p.psi_dem[i], p.rate[2] * dt)
    x.de_add = _towards(x.de_add, p.de_add[i], p.rate[3] * dt)
    x.hold_psi, x.hold_h, x.hold_v = p.hold_psi, p.hold_h, p.hold_v


rollout = entry(step, STATE, INPUTS, PARAMS)


def three_two_one_one(start: Any, unit: Any, channel: str, amplitude: Any) -> list[Any]:
    """Return the steps of a 3-2-1-1: alternating pulses of 3, 2, 1 and 1 units of time."""
    t = start + unit * np.cumsum([0, 3, 2, 1, 1])
    signs = (1.0, -1.0, 1.0, -1.0, 0.0)
    return [(float(ti), {channel: s * amplitude}) for ti, s in zip(t, signs)]


def doublet(start: float, half: float, channel: str, amplitude: float) -> list[Any]:
    """Return the steps of a doublet: one pulse up, one down, each `half` seconds."""
    return [(start, {channel: amplitude}), (start + half, {channel: -amplitude}), (start + 2 * half, {channel: 0.0})]
