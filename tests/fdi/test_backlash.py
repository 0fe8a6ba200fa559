"""A gap between rod and surface has two levels; a sensor that is off, swings, is noisy or out of scale has not."""

import numpy as np
import pytest

from fdi.hydraulic import iotsekf
from fdi.isolation import backlash

DT, H = 0.005, 8e-4
T = np.arange(0.0, 4.0, DT)
SIDE = np.where(np.sin(2.0 * np.pi * 0.5 * T) > 0.0, 1.0, -1.0)  # of the load
DRIVEN = 0.02 * np.tanh(3.0 * np.sin(2.0 * np.pi * 0.4 * T))  # a rod that rests at two places
ROD = 0.01 * np.sin(2.0 * np.pi * 0.31 * T)


def asked(d, rod=ROD):
    """Return the state after rod less surface was `d` behind the pair's lag, an alarm of the pair standing."""
    x = iotsekf.init(iotsekf.params())[0]
    x.sensor = x.backlash_suspected = 1.0
    for k in range(len(T)):
        x.pair_age = k * DT
        x.pair_d += (1.0 - np.exp(-DT / 0.03)) * (d[k] - x.pair_d)
        backlash.update(x, rod[k], DT)
    return x


def test_half_a_gap_to_one_side_and_to_the_other_is_a_loose_surface():
    noise = 1.5e-4 * np.random.default_rng(1).standard_normal(len(T))
    x = asked(H * SIDE + noise)
    assert x.loose == 1.0
    x.sensor = 0.0
    backlash.update(x, 0.0, DT)
    assert x.loose == 0.0 and x.gap_dd == 0.0 and not x.gap_s.any()


@pytest.mark.parametrize(
    ("d", "rod", "play"),
    [
        (H * np.ones(len(T)), ROD, 1.0),
        (H * np.sin(2.0 * np.pi * 1.3 * T), ROD, 0.0),
        (5.0 * H * np.random.default_rng(2).standard_normal(len(T)), ROD, 0.0),
        (0.04 * DRIVEN, DRIVEN, 1.0),  # a lever of wrong length
        (H * np.where(T < 3.95, 1.0, -1.0), ROD, 1.0),  # it has only just changed its side
    ],
    ids=("bias", "oscillation", "noise", "scale", "short"),
)
def test_what_a_sensor_does_is_no_gap(d, rod, play):
    """Where it takes both sides without two levels it is not even one that may be."""
    x = asked(d, rod)
    assert x.loose == 0.0 and x.backlash_suspected == play
