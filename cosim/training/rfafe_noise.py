"""Noise of the Sun13 estimates in flight, predicted from the sensors: each one's white noise through the whole loop.

A design's `noise_deg` is what noise on the estimator's own measurements leaves in f_hat. In flight there is more: the
law turns noise of q, n_z and vertical speed into elevator command, the servos turn noise of rods and pressures into
motion of the surface, and the estimator's first-order actuator follows the command otherwise than the actuators do.
The loop that flies is disturbed here by a single noise sample of one sensor at a time,

    sigma_f^2 = sum over sensors and ticks k of h_k^2,    h the response of f_hat to one sample of one sigma,

which is exact for a linear loop. Friction is set to zero: what it does in flight (an elevator that stands still within
a few hundredths of a degree, then slips) no linear loop predicts.
"""

import functools
import math
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.training.flights import DT, MODULES, estimate, fly_aircraft

FRICTION = ("F_c", "F_s", "T_c", "T_s")  # of the hydraulic and of the electromechanical actuator
FIELD = {"rfafe": "f_hat_left", "rfafe_airframe": "f_hat"}
DISTURBED, TICKS = 200, 1200  # one sample at 1 s, when trims are learned; the response is over in 5 s


@functools.cache
def predicted(size: float = 1.0, sensors: Any = None) -> Any:
    """Return {estimator: {sensor: standard deviation of its f_hat [deg]}} at Sun13's point, hydraulic, in still air.

    `size` is that of the disturbance in sigma: a linear loop gives the same for any. `sensors` is a tuple of names,
    by default all that the loop has.
    """
    lanes, quiet = _response(None, size)
    out: dict = {name: {} for name in MODULES}
    for lane in sensors or lanes:
        _, disturbed = _response(lane, size)
        for name in MODULES:
            h = disturbed[name] - quiet[name]
            out[name][lane] = float(np.sqrt(np.sum(h * h))) / size
    return out


def total(parts: Any) -> float:
    """Return the standard deviation of the sum of independent `parts`, a mapping to standard deviations."""
    return math.sqrt(sum(s * s for s in parts.values()))


def _response(lane, size):
    """Return (sensors, {estimator: f_hat (ticks,) [deg]}) of a noiseless flight with one sample of `lane` disturbed."""
    sensors: list = []

    def prepare(setup):
        loop = setup.loop
        sensors.extend(loop.bus.lanes["sensors"])
        for block in loop.actuators:
            for field in set(FRICTION) & set(block.p.dtype.names):
                block.p[field] = 0.0

        loop.draw = _One(sensors.index(lane) if lane is not None else 0, size if lane is not None else 0.0)

    flown = fly_aircraft(duration=TICKS * DT, prepare=prepare)
    return sensors, {name: estimate(flown, name)[field] / RAD_PER_DEG for name, field in FIELD.items()}


class _One:
    """Noise that is nothing but one number in one lane at one tick."""

    def __init__(self, lane, size):
        self._lane, self._size = lane, size

    def schedule(self, tape, to):
        """Schedule on a tape what stands at the positions `to` of the bus."""
        block = np.zeros((TICKS, len(to)))
        block[DISTURBED, self._lane] = self._size
        tape.table(to, block)
