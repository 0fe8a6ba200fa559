"""The linkage between rod and surface: an arm of constant effective length, as on a quadrant.

q = r delta and F = HM / r, so that 0.30 m makes 5.24 mm of rod per degree everywhere. A plain lever would be 2.6 %
short at 23 degrees; the detectors' models would have to know its geometry, and nothing published fixes it.
"""

import math
from typing import Any

ARM = 0.30  # [m]; 35 kN of stall make 10.5 kN m
TRAVEL = (math.radians(-23.0), math.radians(17.0))  # surface stops, trailing edge down + [rad]
RATE = math.radians(45.0)  # surface rate at no load [rad/s]


def rod(delta: Any, arm: Any = ARM) -> Any:
    """Return the rod position of a surface angle, q = r delta [m]; arrays broadcast."""
    return arm * delta
