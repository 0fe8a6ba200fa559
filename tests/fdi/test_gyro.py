"""The pitch rate against the attitude: an error is found in size, a manoeuvre in a bank is none, a gap starts anew."""

import numpy as np
import pytest

from actuators.block import dtype
from actuators.constants import RAD_PER_DEG
from fdi.common import gyro

NAMES = ("theta", "phi", "q", "r")
INPUTS = dtype([(n + tail, "f8", "-") for n in NAMES for tail in ("", "_valid")])
STATE = dtype([*gyro.STATE])


def flown(dt=0.005, error=0.0, lost=()):
    """Return x.gyro_error, x.gyro_off over ticks of a pitching flight in a bank, q off by `error` from 5 s on."""
    t = np.arange(0.0, 10.0, dt)
    phi = 0.5 * np.sin(0.4 * t)
    theta = 0.1 * np.sin(2.0 * t)
    r = 0.05 * np.sin(t)
    q = (0.2 * np.cos(2.0 * t) + r * np.sin(phi)) / np.cos(phi) + error * (t >= 5.0)
    x, u, out = np.zeros(1, STATE)[0], np.zeros(1, INPUTS)[0], []
    for k in range(len(t)):
        for name, values in zip(NAMES, (theta, phi, q, r)):
            u[name], u[name + "_valid"] = values[k], float(not (name in lost and 4.0 <= t[k] < 6.0))
        gyro.compare(x.view(np.recarray), u.view(np.recarray), dt)
        out.append((x["gyro_error"], x["gyro_off"]))
    return t, np.array(out).T


@pytest.mark.parametrize("dt", [0.02, 0.005])
def test_flight_without_an_error_shows_none(dt):
    _, (error, off) = flown(dt)
    assert np.abs(error).max() < 0.3 * gyro.OFF and not off.any()


def test_an_error_is_found_in_size_within_a_third_of_a_second():
    t, (error, off) = flown(error=RAD_PER_DEG)
    assert not off[t < 5.0].any() and off[(t > 5.3) & (t < 5.35)].all()
    assert error[-1] == pytest.approx(RAD_PER_DEG, rel=0.1)  # times cos phi


def test_after_a_gap_it_starts_anew():
    _, (error, off) = flown(lost=("phi",))
    assert np.abs(error).max() < 0.3 * gyro.OFF and not off.any()
