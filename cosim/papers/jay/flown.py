"""[Jay] in flight: the position sensor of the right inner segment off by 5 deg in a 3-2-1-1 of 4 deg, from 12 s on.

The scenario is `ema-position-bias`, flown by what the loop closes on: the sensor, the estimate of the filter as
published, or that of the form that knows a load.
"""

import functools
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.loop.signals import fly
from cosim.scenario import load_scenario

ONSET = 12.0  # [s]
TRUE = ("truth.aircraft.nz", "ema.right_inner.delta")


@functools.cache
def flight(reconfigure: str, *changes: str) -> Any:
    """Return the load factor [g] and elevator [rad] of the scenario; `reconfigure`: "false", "true", "published"."""
    both = 'detectors.enabled=["ema_kalman", "ema_kalman_flight"]'
    return fly(load_scenario("ema-position-bias", [both, f"elevator.reconfigure={reconfigure}", *changes]), TRUE)


def healthy() -> Any:
    """Return the same flight without the fault."""
    return flight("false", "faults=[]")


def off(reconfigure: str) -> float:
    """Return how far the elevator is from that of the healthy flight from 1 s after the onset on, rms [deg]."""
    apart = (flight(reconfigure) - healthy())[TRUE[1]][ONSET + 1.0 :]
    return float(np.sqrt((apart**2).mean()) / RAD_PER_DEG)
