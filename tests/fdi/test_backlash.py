"""A gap between rod and surface has two levels, no sensor's error has; a jump of the last sensor stands."""

import numpy as np
import pytest

from fdi.common import decision
from fdi.hydraulic import iotsekf, plain_tests
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


def listen(innovations, rod=1.0, surface=0.0, **at):
    """Return the record after these innovations of the one position that is left [m]."""
    x = np.zeros(1, iotsekf.STATE)[0]
    x["pair_time"] = 1.0
    for name, value in at.items():
        x[name] = value
    for e in innovations:
        x["gamma_rod"] = e
        plain_tests.jumped(x, rod, surface, 0.005)
    return x


@pytest.mark.parametrize(("rod", "surface", "which"), [(1.0, 0.0, 1.0), (0.0, 1.0, 2.0)])
def test_a_jump_that_stays_for_three_samples_is_the_sensors(rod, surface, which):
    x = listen([0.0, 1e-3, 1e-3, 1e-3], rod, surface)
    assert x["jump_of"] == which and x["t_settling"] >= decision.T_DISTURBED
    plain_tests.jumped(x, 1.0, 1.0, 0.005)
    assert x["jump_of"] == 0.0


@pytest.mark.parametrize(
    "innovations",
    [[0.0, 5e-4, 5e-4, 5e-4], [0.0, 1e-3, 1e-3], [5e-4, 1e-3, 1e-3, 1e-3], [0.0, 1e-3, 1e-3, -1e-3, 1e-3]],
    ids=["small", "two samples", "rises", "changes sign"],
)
def test_noise_an_outlier_and_an_oscillation_are_no_jump(innovations):
    assert listen(innovations)["jump_of"] == 0.0


@pytest.mark.parametrize("at", [{"sensor": 1.0}, {"age": 0.1}, {"pair_time": 0.0}, {"alarm": 1.0}])
def test_where_a_name_stands_or_two_never_agreed_nothing_is_said(at):
    assert listen([0.0, 1e-3, 1e-3, 1e-3], **at)["jump_of"] == 0.0
