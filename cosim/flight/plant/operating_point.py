"""Operating point: the law's gains and the slopes of the hinge moments at a flight point.

Both take derivatives by moving an aircraft about, and the law solves a Riccati equation: those of nominal points are
kept on disk.
"""

import functools

import numpy as np

from actuators.kernels import cached_array
from cosim.flight.blocks import hinge_model, law
from cosim.flight.blocks.law import design as law_design
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.flight.plant.trim import Trim
from cosim.scenario.user_parts import identity


def designed(point: FlightPoint, trim: Trim, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (PARAMS (1,) of the law, slopes (segments, 2) for `hinge_model.design`) at a point with its `trim`.

    `dt` is the loop's tick [s]. Raises TrimError where the point has no level flight.
    """
    point, n = point.calm, law.PARAMS.itemsize // 8
    made = functools.partial(_made, point, trim, dt)
    if point.multipliers:  # hardly a second time
        both = made()
    else:
        both = cached_array((repr(point), dt, identity(point.record.folder).sha256), float, made, __file__)
    return both[:n].copy().view(law.PARAMS), both[n:].reshape(-1, 2).copy()


def _made(point, trim, dt):
    aircraft = point.record
    sketch = Plant(point, dt=dt)  # moved about to take derivatives
    level = linearize(point.level)
    stall = law_design.alpha_limit(sketch, trim if trim.level else level.trim)
    p = law_design.design(level, stall, aircraft, None if trim.level else trim)
    return np.concatenate([p.view("f8").ravel(), hinge_model.slopes(sketch, trim, aircraft.short.values()).ravel()])
