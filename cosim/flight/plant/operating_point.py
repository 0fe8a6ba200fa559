"""Operating point: the law's gains and the slopes of the hinge moments at a flight point.

Both take derivatives by moving an aircraft about, and the law solves a Riccati equation. So they are worked out once:
the last points are remembered, nominal ones on disk, too.
"""

from collections import OrderedDict

import numpy as np

from actuators.kernels import cached_array
from cosim.flight.blocks import hinge_model, law
from cosim.flight.blocks.law import design as law_design
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.flight.plant.trim import Trim
from cosim.scenario.user_parts import identity

POINTS = 16  # that are remembered
_known: OrderedDict[tuple, np.ndarray] = OrderedDict()


def designed(point: FlightPoint, trim: Trim, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (PARAMS (1,) of the law, slopes (segments, 2) for `hinge_model.design`) at a point with its `trim`.

    `dt` is the loop's tick [s]. Raises TrimError where the point has no level flight.
    """
    n = law.PARAMS.itemsize // 8
    both = _both(point.calm, trim, dt)
    return both[:n].copy().view(law.PARAMS), both[n:].reshape(-1, 2).copy()


def _both(point, trim, dt):
    if not point.aircraft.isidentifier():  # a folder may change
        return _made(point, trim, dt)
    key = repr(point), dt
    if key not in _known:
        if point.multipliers:  # hardly a second time
            _known[key] = _made(point, trim, dt)
        else:
            about = *key, identity(point.record.folder).sha256
            _known[key] = cached_array(about, float, lambda: _made(point, trim, dt), __file__)
        if len(_known) > POINTS:
            _known.popitem(last=False)
    return _known[key]


def _made(point, trim, dt):
    aircraft = point.record
    sketch = Plant(point, dt=dt)  # moved about to take derivatives
    level = linearize(point.level)
    stall = law_design.alpha_limit(sketch, trim if trim.level else level.trim)
    p = law_design.design(level, stall, aircraft, None if trim.level else trim)
    return np.concatenate([p.view("f8").ravel(), hinge_model.slopes(sketch, trim, aircraft.short.values()).ravel()])
