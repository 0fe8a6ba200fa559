"""What aircraft-level detectors take the elevator servos for is what the servos do."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from cosim.flight.detection.detector_context import RATE, SERVO
from cosim.flight.loop.signals import fly
from cosim.training.flights import COMMAND, DT, SURFACES, scenario


def followed(command, lag):
    """Return `command` (ticks,) [rad] followed at RATE at most, through `lag` [s]."""
    limited, most = np.empty_like(command), RATE * DT
    now = command[0]
    for k, asked in enumerate(command):
        now = min(max(asked, now - most), now + most)
        limited[k] = now
    keep = math.exp(-DT / lag)
    return lfilter([1.0 - keep], [1.0, -keep], limited, zi=[keep * limited[0]])[0]


@pytest.mark.parametrize("technology", ["hydraulic", "ema"])
def test_the_lag_of_a_healthy_servo_is_that_of_the_detectors(technology):
    manoeuvre, air = {"kind": "three_two_one_one", "start_s": 8.0}, {"turbulence": "moderate"}
    given = scenario(duration=30.0, manoeuvre=manoeuvre, seed=63_000_100, flight=air, technology=(technology,) * 4)
    flown = fly(given, [COMMAND, *SURFACES])
    command, surface = flown[COMMAND].to_numpy(), np.asarray(flown[list(SURFACES)]).mean(axis=1)

    def error(lag):
        return float(np.var((surface - followed(command, lag))[400:]))

    assert minimize_scalar(error, bounds=(0.02, 0.2), method="bounded").x == pytest.approx(SERVO, abs=0.01)
