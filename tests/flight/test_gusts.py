"""Turbulence: the specification's rms per axis at every rate and speed, and a tail that meets it later."""

import numpy as np
import pytest

from cosim.flight.loop.tape import Tape
from cosim.flight.plant import gusts

AIRCRAFT = {"span": 59.6, "tail_arm": 32.1, "downwash": 0.4}
RMS = {"light": 1.524, "moderate": 3.048, "severe": 6.401}  # 5, 10, 21 ft/s


def air(kind, seed, *, seconds, dt=0.005, tas=200.0, weather=None, **angles):
    """Return (ticks, 6): gusts to north, east, down [m/s] and p, q, r [rad/s]."""
    made = gusts.Gusts(gusts.params(kind, dt, **AIRCRAFT, **(weather or {})), dt, seed)
    tape, out = Tape(np.zeros(1), dt), np.zeros((round(seconds / dt), 6))
    made.schedule(tape)
    made.met[:] = [tas, *({"phi": 0.0, "theta": 0.0, "psi": 0.0, "h": 0.0} | angles).values()]
    for k, row in enumerate(out):
        tape.run(k)
        row[:] = made.moved
    return out


@pytest.mark.parametrize(
    ("kind", "dt", "tas"), [("light", 0.005, 130.0), ("moderate", 0.02, 200.0), ("severe", 0.01, 270.0)]
)
def test_each_axis_has_the_rms_of_the_specification(kind, dt, tas):
    """The intensity scales the same filtered noise: each of its words once, each rate and speed once."""
    n = 60 if dt < 0.01 else 120
    squares = [(air(kind, s, seconds=n, dt=dt, tas=tas)[:, :3] ** 2).mean(axis=0) for s in range(15)]
    rms = np.sqrt(np.mean(squares, axis=0))
    assert rms == pytest.approx(RMS[kind], rel=0.1)


@pytest.mark.parametrize("dt", (1 / 50, 1 / 2000))
def test_the_way_to_the_tail_fits_its_line_at_every_rate(dt):
    g = air("severe", 2, seconds=3.0, dt=dt, tas=70.0)
    late = g[:, 2] - g[:, 4] * AIRCRAFT["tail_arm"] / (1.0 - AIRCRAFT["downwash"])
    first = round(1.0 / dt)
    ticks = round(AIRCRAFT["tail_arm"] / 70.0 / dt)
    error = late[first:] - g[first - ticks : len(g) - ticks, 2]
    assert np.sqrt((error**2).mean()) < 0.1 * 6.4


def test_axes_turn_with_the_aircraft():
    level, turned = (air("light", 3, seconds=2.0, psi=psi) for psi in (0.0, np.pi / 2))
    assert turned[:, 1] == pytest.approx(level[:, 0]) and turned[:, 0] == pytest.approx(-level[:, 1])
    banked = air("light", 3, seconds=2.0, phi=np.pi / 2)
    assert banked[:, 2] == pytest.approx(level[:, 1]) and banked[:, 1] == pytest.approx(-level[:, 2])
