"""Template of a detector: the surface against the rod, a threshold and a confirmation time."""

import math

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from fdi.common.decision import confirm, usable
from fdi.common.record import Detector, Estimate
from fdi.common.verdict import NONE, SENSOR

ISOLABLE_PARTS = ("", "rod", "surface")
PARAMS = dtype([("threshold", "f8", "m"), ("t_confirm", "f8", "s"), ("t_release", "f8", "s")])
INPUTS = dtype([
    ("rod", "f8", "m"), ("rod_valid", "f8", "-"), ("surface", "f8", "rad"), ("surface_valid", "f8", "-"),
])  # fmt: skip
STATE = dtype([
    ("timer", "f8", "s"), ("f_hat", "f8", "m"), ("r", "f8", "-"), ("alarm", "f8", "-"), ("verdict", "f8", "-"),
    ("isolated_part", "f8", "-"), ("valid", "f8", "-"),
])  # fmt: skip
OUTPUTS = ("f_hat", "r", "alarm", "verdict", "isolated_part", "valid")
DETECTOR = Detector(
    id="template",
    level="local",
    summary="rod against surface",
    technologies=("hydraulic",),
    inputs={"rod": "rod", "surface": "surface"},
    designed_for={"hydraulic.rod": ("sensor",)},
    blind="compares two sensors of one actuator",
    estimates=(Estimate("rod", "f_hat", "m"),),
    fit=lambda site: params(),
)


def params(**values):
    """Return PARAMS; `values` replace any field."""
    return record(PARAMS, **{"threshold": 0.004, "t_confirm": 0.1, "t_release": 0.5, **values})


def init(p):
    """Return STATE of p's shape."""
    return np.zeros(p.shape, STATE)


@kernel
def step(x, u, p, dt):
    """Compare, confirm, name."""
    x.valid = min(usable(u.rod, u.rod_valid), usable(u.surface, u.surface_valid))
    if x.valid < 0.5:
        return
    x.f_hat = u.rod - linkage.ARM * u.surface
    x.r = math.fabs(x.f_hat) / p.threshold
    x.timer, x.alarm = confirm(x.timer, x.alarm, x.r >= 1.0, dt, p.t_confirm, p.t_release)
    x.verdict = SENSOR if x.alarm > 0.5 else NONE
    x.isolated_part = x.alarm


rollout = entry(step, STATE, INPUTS, PARAMS)
