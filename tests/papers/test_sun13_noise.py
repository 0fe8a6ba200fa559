"""Noise of the Sun13 estimate: what is predicted from the sensors through the loop is what flies."""

import numpy as np
import pytest

from actuators.constants import RAD_PER_DEG
from cosim.papers.sun13.predicted import predicted, total
from cosim.training.flights import estimate, fly_aircraft
from fdi.rfafe.store import read

LEFT = tuple(f"left_{place}_{part}" for place in ("outer", "inner") for part in ("surface", "rod", "pressure"))
SENSORS = (*LEFT, "q", "n_z", "hdot", "alpha")  # the others together leave less than 1 %


@pytest.fixture(scope="module")
def parts():
    return predicted(SENSORS)


def test_the_estimators_own_sensors_give_the_designs_noise(parts):
    """The part that needs no loop is the one that every design stores."""
    own = {k: v for k, v in parts.items() if k.endswith("surface")}
    assert total(own) == pytest.approx(read("rfafe")["designs"]["hydraulic"]["noise_deg"][0], rel=1e-3)


def test_the_law_and_the_servos_add_to_it(parts):
    """q and n_z move the command, rods the surface: the estimator takes for a fault what its actuator's model leaves of
    the one, and all of the other."""
    assert 0.01 < parts["n_z"] / parts["left_inner_surface"] < 0.3
    assert parts["left_inner_rod"] > 10 * parts["alpha"]


def test_a_fault_free_flight_in_still_air_is_as_noisy_as_predicted(parts):
    """At most 1.2 times the prediction, with friction, which the prediction leaves out; and no less than 0.9."""
    flown = fly_aircraft(duration=40.0)
    got = np.std(estimate(flown, "rfafe")["f_hat_left"][flown.index > 3.0]) / RAD_PER_DEG
    assert 0.9 < got / total(parts) < 1.2
