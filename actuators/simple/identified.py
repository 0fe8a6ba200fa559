"""An actuator as `cosim identify` finds it in a recording: second order with a dead band, a rate limit and a dead time.

    e = clip(command(t - delay)) - delta,    v = k1 (e less the dead band),   |v| <= v_max,    delta'' = k2 (v - delta')

held over the tick and integrated exactly. It has the inputs of an actuator that a scenario brings along with its own
servo (actuators/user_actuator.py): f_cmd and s_cmd are command faults; the hinge moment does not move it.
"""

import math
from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.common.limits import clip
from actuators.simple.actuator import move

PAST = 128  # commands kept: a dead time of 0.6 s at 200 Hz

PARAMS = dtype([
    ("k1", "f8", "1/s"),  # position error to rate
    ("k2", "f8", "1/s"),  # rate error to acceleration
    ("v_max", "f8", "rad/s"),  # rate limit
    ("dead_band", "f8", "rad"),  # error, to either side, that moves nothing
    ("delay", "f8", "s"),  # dead time from the command to the motion
    ("lo", "f8", "rad"),  # stop
    ("hi", "f8", "rad"),  # stop
])
INPUTS = dtype([
    ("command", "f8", "rad"),
    ("hm0", "f8", "N m"),  # not used
    ("hmd", "f8", "N m/rad"),  # not used
    ("f_cmd", "f8", "rad"),  # fault: added to the command
    ("s_cmd", "f8", "-"),  # fault: share of the command replaced [0..1]
])
STATE = dtype([
    ("delta", "f8", "rad"),  # surface angle
    ("delta_d", "f8", "rad/s"),  # its rate
    ("asked", "f8", "rad"),  # last finite command
    ("past", "f8", (PAST,), "rad"),  # commands of the last ticks, newest first
])
OUTPUTS = ("delta", "delta_d", "asked")


def params(
    *, omega: float = 30.0, zeta: float = 0.9, rate: float = linkage.RATE, dead_band: float = 0.0, delay: float = 0.0,
    lo: float = linkage.TRAVEL[0], hi: float = linkage.TRAVEL[1],
) -> np.ndarray:  # fmt: skip
    """Return PARAMS of shape (1,) from natural frequency [rad/s], damping, rate and stops [rad], dead time [s]."""
    own = {"k1": omega / (2.0 * zeta), "k2": 2.0 * zeta * omega, "v_max": rate}
    return record(PARAMS, **own, dead_band=dead_band, delay=delay, lo=lo, hi=hi)


def init_at(p: np.ndarray, delta: Any, hm0: Any = 0.0, hmd: Any = 0.0) -> np.ndarray:
    """Return the state at rest at `delta` [rad], which broadcasts over p; the hinge moment is not used."""
    x = np.zeros(p.shape, STATE)
    x["delta"] = delta
    x["asked"] = x["delta"]
    x["past"] = x["delta"][..., None]
    return x


@kernel
def step(x, u, p, dt):
    """Advance the actuator by one tick."""
    asked = (1.0 - u.s_cmd) * u.command + u.f_cmd
    if abs(asked) < 1e6:
        x.asked = clip(asked, p.lo, p.hi)
    late = min(p.delay / dt, PAST - 2.0)
    whole = int(late)
    for i in range(whole + 1, 0, -1):
        x.past[i] = x.past[i - 1]
    x.past[0] = x.asked
    part = late - whole
    e = (1.0 - part) * x.past[whole] + part * x.past[whole + 1] - x.delta
    e = e - clip(e, -p.dead_band, p.dead_band)
    v = clip(p.k1 * e, -p.v_max, p.v_max)
    move(x, (v - x.delta_d) * (1.0 - math.exp(-p.k2 * dt)) / dt, p, dt)


rollout = entry(step, STATE, INPUTS, PARAMS)
