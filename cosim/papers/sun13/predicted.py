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
from collections.abc import Mapping
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.training.flights import DT, estimate, fly_aircraft

FRICTION = ("F_c", "F_s", "T_c", "T_s")  # of the hydraulic and of the electromechanical actuator
DISTURBED, TICKS = 200, 1200  # one sample at 1 s, when trims are learned; the response is over in 5 s


@functools.cache
def predicted(sensors: tuple[str, ...] | None = None) -> dict[str, float]:
    """Return {sensor: standard deviation of the left f_hat [deg]} at Sun13's point, hydraulic, in still air; of
    `sensors`, by default all that the loop has."""
    lanes, quiet = _response(None)
    return {lane: float(np.linalg.norm(_response(lane)[1] - quiet)) for lane in sensors or lanes}


def total(parts: Mapping[str, float]) -> float:
    """Return the standard deviation of the sum of independent `parts`, {name: standard deviation}."""
    return math.hypot(*parts.values())


def _response(lane):
    """Return (sensors, left f_hat (ticks,) [deg]) of a noiseless flight with one sample of `lane` off by a sigma."""
    sensors: list[str] = []

    def prepare(setup):
        loop = setup.loop
        sensors.extend(loop.bus.lanes["sensors"])
        for block in loop.actuators:
            for field in set(FRICTION) & set(block.p.dtype.names):
                block.p[field] = 0.0
        loop.draw = _One(sensors.index(lane) if lane else None)

    flown = fly_aircraft(duration=TICKS * DT, prepare=prepare)
    return sensors, estimate(flown, "rfafe")["f_hat_left"] / RAD_PER_DEG


class _One:
    """Noise that is nothing but a one in one lane at one tick."""

    def __init__(self, lane: int | None):
        self._lane = lane

    def schedule(self, tape: Any, to: Any) -> None:
        """Schedule on a tape what stands at the positions `to` of the bus."""
        block = np.zeros((TICKS, len(to)))
        if self._lane is not None:
            block[DISTURBED, self._lane] = 1.0
        tape.table(to, block)
