"""Put an actuator of your own in place of one segment's: here a first-order lag, in plain Python.

The text below is the file that a scenario names, `[actuators.lag] file = "lag.py"`; a co-simulation FMU flies the same
way, `fmu = "rig.fmu"`, with its variables mapped (actuators/README.md).
"""

from pathlib import Path

import cosim

Path("lag.py").write_text('''
import numpy as np
from actuators.block import dtype

PARAMS = dtype([("tau", "f8", "s")])
INPUTS = dtype([(name, "f8") for name in ("command", "hm0", "hmd", "f_cmd", "s_cmd")])  # SI; faults
STATE = dtype([("delta", "f8", "rad")])
OUTPUTS = ("delta",)


def params(tau=0.1):
    return np.full(1, tau).view(PARAMS)


def init_at(p, delta, hm0, hmd):
    return np.array(delta, float).reshape(-1).view(STATE)


def rollout(x, u, p, dt):
    for i, own in enumerate(u[:, 0]):
        asked = (1.0 - own.s_cmd) * own.command + own.f_cmd
        x[i].delta += dt / p[i].tau * (asked - x[i].delta)
''')

shipped, seen = ["duration_s=10", "manoeuvre.kind=nz_doublet", "manoeuvre.start_s=2"], ["truth.aircraft.de_li"]
mine = [*shipped, "actuators.lag.file=lag.py", "elevator.left_inner=lag"]
for name, changes in (("hydraulic", shipped), ("lag", mine)):
    angle = cosim.fly(cosim.load_scenario("cruise", changes), seen)[seen[0]]
    print(f"{name:10} {angle.min() * 57.3:6.2f} to {angle.max() * 57.3:5.2f} deg")
