"""NAME: an actuator of your own, here a first-order lag in plain Python, one record per segment.

`cosim run --set actuators.NAME.file=NAME.py --set elevator.left_inner=NAME` flies it; the contract is in
actuators/README.md.
"""

import numpy as np

from actuators.block import dtype

PARAMS = dtype([("tau", "f8", "s")])
INPUTS = dtype([(name, "f8") for name in ("command", "hm0", "hmd", "f_cmd", "s_cmd")])  # SI; f_cmd, s_cmd: faults
STATE = dtype([("delta", "f8", "rad")])
OUTPUTS = ("delta",)  # surface angle, trailing edge down + [rad]


def params(tau=0.1):
    """Return PARAMS (1,); tau is the time constant [s]."""
    return np.full(1, tau).view(PARAMS)


def init_at(p, delta, hm0, hmd):
    """Return STATE at rest at `delta` [rad] under the hinge moment hm0 + hmd delta [N m]."""
    return np.array(delta, float).reshape(-1).view(STATE)


def rollout(x, u, p, dt):
    """Advance every segment by one tick: x' = (command - x) / tau."""
    for i, own in enumerate(u[:, 0]):
        asked = (1.0 - own.s_cmd) * own.command + own.f_cmd
        x[i].delta += dt / p[i].tau * (asked - x[i].delta)
