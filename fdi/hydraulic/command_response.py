"""Response of the valve to the fast part of its command, mostly noise of the servo's sensors: present or absent.

An oscillation added to the valve command and one in its place look the same while nothing else is commanded: f is a
sine, and so is w = f + d. What the servo's sensors put into the command above CORNER is always there. It is too fast
for the estimate of the input fault, so that where the valve does not do it the pressure misses its prediction by

    e = -deaf G_3 u,   deaf 0: the valve does all of its command, 1: nothing of it,

G_3 being what a tick of valve command adds to the pressure ([Lu17] (20)). `deaf` is the regression of e on -G_3 u, both
behind the same high-pass, over the last MEMORY; its error is 0.1. A valve that has lost a share of its flow shows that
share. `proof` is the logarithm of the ratio of the likelihoods of "obeys" and "does not".
"""

import math
from typing import Any

import numpy as np

from actuators.block import kernel
from actuators.disk_cache import kept
from fdi.common.decision import clipped

# of the high-pass, Butterworth [Hz]: an oscillation of up to 10 Hz and its third harmonic stay below; share of the rate
ORDER, CORNER, CORNER_MOST = 4, 40.0, 0.3
SECTIONS = ORDER // 2
MEMORY = 0.5  # [s]
DT_MOST = 0.01  # of longer ticks the fast part is gone [s]
LEAST, SIGMAS = 1e-8, 4.0  # variance of e [1]; one sample counts for no more than so many sigma
SURE = 12.0  # proof that is enough
LITTLE, MUCH = 0.35, 0.7  # of the command that does not come through
NEVER = -0.35  # less cannot be: a fast oscillation disturbs it

PARAMS = [
    ("deaf_b", "f8", (SECTIONS, 3)),  # numerators
    ("deaf_a", "f8", (SECTIONS, 2)),  # denominators, the leading one left out
    ("deaf_on", "f8"),  # 1 where ticks are short enough
]
STATE = [
    ("deaf_z", "f8", (2, SECTIONS, 2)),  # of the filters of e and of -G u
    ("deaf_ev", "f8", "-"),  # sums over MEMORY
    ("deaf_vv", "f8", "-"),
    ("deaf_ee", "f8", "-"),  # variance of e, lagged
    ("deaf", "f8", "-"),  # share of the command's fast part that does not come through
    ("proof", "f8", "-"),  # + the valve obeys, - it does not; 0 not known
]


def design(dt: float) -> dict[str, Any]:
    """Return the PARAMS fields for ticks of `dt` seconds."""
    on = dt <= DT_MOST
    rate = 1.0 / dt if on else 200.0
    sos = kept(("obeys", rate), float, lambda: _sections(rate).ravel(), __file__).reshape(SECTIONS, 6)
    return {"deaf_b": sos[:, :3], "deaf_a": sos[:, 4:], "deaf_on": 1.0 if on else 0.0}


def _sections(rate: float) -> np.ndarray:
    from scipy.signal import butter  # half a second, which a start does not wait for

    return butter(ORDER, min(CORNER, CORNER_MOST * rate), "high", fs=rate, output="sos")


@kernel
def passed(x, p, s, y):
    """Return sample `y` of signal `s` behind the high-pass."""
    for i in range(SECTIONS):
        z = x.deaf_z[s, i]
        out = p.deaf_b[i, 0] * y + z[0]
        z[0] = p.deaf_b[i, 1] * y - p.deaf_a[i, 0] * out + z[1]
        z[1] = p.deaf_b[i, 2] * y - p.deaf_a[i, 1] * out
        y = out
    return y


@kernel
def reset(x):
    """Begin the sums anew: what comes may be another valve."""
    x.deaf_ev = 0.0
    x.deaf_vv = 0.0
    x.deaf = 0.0
    x.proof = 0.0


@kernel
def update(x, p, good, dt):
    """Take a tick's innovation of the pressure, where it is `good`, and the command that it was predicted with."""
    if p.deaf_on < 0.5:
        return
    v = passed(x, p, 1, -x.G[2] * x.u_old[int(p.delay)])
    e = passed(x, p, 0, x.dp_e)
    if good < 0.5:
        reset(x)
        return
    a = dt / MEMORY
    most = SIGMAS * math.sqrt(x.deaf_ee + LEAST)
    e = clipped(e, most)
    x.deaf_ee += a * (e * e - x.deaf_ee)
    x.deaf_ev += e * v - a * x.deaf_ev
    x.deaf_vv += v * v - a * x.deaf_vv
    if x.deaf_vv > 0.0:
        x.deaf = x.deaf_ev / x.deaf_vv
    left = max(x.deaf_ee - a * x.deaf_ev * x.deaf, 0.3 * x.deaf_ee) + LEAST
    x.proof = (0.5 - x.deaf) * x.deaf_vv / left if x.deaf > NEVER else 0.0


@kernel
def present(x):
    """Return whether it is sure that the command comes through."""
    return x.proof > SURE and x.deaf < LITTLE


@kernel
def absent(x):
    """Return whether it is sure that the command does not come through."""
    return x.proof < -SURE and x.deaf > MUCH
