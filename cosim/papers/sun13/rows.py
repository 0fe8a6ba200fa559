"""[Sun13] row by row: designs, fault-free flight, liquid and solid OFC of the left elevator, and both sides.

Flights are in `flown`; what the decoupling and the learning rate do is in `decoupling`, the form on airframe outputs
and its schedule in `airframe`.
"""

import functools
import math

import numpy as np

from actuators.constants import RAD_PER_DEG
from actuators.registry import HYDRAULIC
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.judge.fault_effect import sine
from cosim.papers.sun13 import flown
from cosim.papers.sun13.flown import HZ, ONSET, SHARE, TRAVEL, farthest, ratio
from cosim.scenario.catalog import SEGMENTS as NAMES
from cosim.training import rfafe_noise
from cosim.training.flights import DT, fly_aircraft, side
from fdi.rfafe import rfafe
from fdi.rfafe.store import read

WINDOW = slice(round((ONSET + 2.0) / DT), round((ONSET + 10.0) / DT))  # of a fault at 1 Hz, whole periods
LAG = float(read("rfafe")["designs"]["hydraulic"]["actuator"]["a_rad_s"])  # of (37) [rad/s]


def published(kind: str, hz: float, turbulence: str = "none", stored: dict | None = None) -> complex:
    """Return f_hat/f of the published form, an OFC at `hz`; `stored`: another design than the stored one."""
    r = flown.faulty(kind, hz, turbulence)
    f_hat = flown.estimated(r, "rfafe", None if stored is None else rfafe.params(stored=stored))["f_hat_left"]
    return ratio(r, f_hat, flown.injected(r, kind), hz, ONSET + 2.0, 3.0 / hz)


def _quiet_law():
    """Return a fault-free flight with noise for the published estimator only: the law flies on clean sensors."""
    r, rng = fly_aircraft(duration=40.0, sensors={"noise_scale": 0.0}), np.random.default_rng(7)
    for name in ("tas", "alpha", "q", "theta"):
        r[f"sensors.{name}.y_obs"] += rng.normal(size=len(r)) * TRANSPORT[name][1]
    positions = [f"sensors.{s}_surface.y_obs" for s in NAMES]
    r[positions] += rng.normal(size=(len(r), 4)) * HYDRAULIC.sensors["surface"].sigma
    return r


@functools.cache
def _still():
    return fly_aircraft(duration=40.0)


def _still_f(r):
    """Return f_hat of the published form [deg]."""
    return flown.estimated(r, "rfafe")["f_hat_left"] / RAD_PER_DEG


@functools.cache
def _moved(kind):
    """Return (complex amplitude of the left elevator, rms of what is no sine) [deg]."""
    r, on = flown.faulty(kind, 1.0), WINDOW
    t, y = r.index.to_numpy()[on], side(r, "left")[on] / RAD_PER_DEG
    a = sine(t, y, 2 * math.pi)
    return a, float(np.std(y - (a * np.exp(2j * math.pi * t)).real))


def frequency(kind: str) -> float:
    """Return the frequency [Hz] at which f_hat of a 1 Hz fault has its largest sine over 8 s."""
    r, tried = flown.faulty(kind, 1.0), np.linspace(0.5, 2.0, 301)
    t, f = r.index.to_numpy()[WINDOW], flown.estimated(r, "rfafe")["f_hat_left"][WINDOW]
    return tried[np.argmax([abs(sine(t, f, 2 * math.pi * hz)) for hz in tried])]


def noise() -> tuple[float, str]:
    """Return the deviation of f_hat over the predicted one, without a fault, in still air.

    In the note: with clean sensors in the law, over that of the estimator's own sensors.
    """
    f, clean = (np.std(_still_f(r)[_still().index > 3.0]) for r in (_still(), _quiet_law()))
    own = clean / read("rfafe")["designs"]["hydraulic"]["noise_deg"][0]
    return f / rfafe_noise.total(
        rfafe_noise.predicted()["rfafe"]
    ), f"with noise in the estimator's sensors only {own:.2f}"


def stands_out() -> float:
    """Return the largest amplitude at HZ over three periods without a fault, from 3 s on, over the fault of 0.016."""
    t, f = _still().index.to_numpy(), _still_f(_still())
    found = [
        abs(sine(t[k : k + n], f[k : k + n], 2 * math.pi * hz))
        for hz in HZ
        for n in (round(3.0 / hz / DT),)
        for k in range(600, len(f) - n, n)
    ]
    return max(found) / (SHARE["ofc_liquid"] * TRAVEL)


def surface(kind: str) -> tuple[float, str]:
    """Return the amplitude of the left elevator at 1 Hz over the fault's."""
    through = "" if kind == "ofc_liquid" else f"(37) lets {LAG / math.hypot(LAG, 2 * math.pi):.3f} through"
    return abs(_moved(kind)[0]) / (SHARE[kind] * TRAVEL), through


def rest() -> float:
    """Return what of the left elevator is no sine in a solid OFC, over the fault's amplitude."""
    return _moved("ofc_solid")[1] / (SHARE["ofc_solid"] * TRAVEL)


def tracks(kind: str) -> tuple[float, str]:
    """Return |f_hat / f| farthest from 1 over the three frequencies, still air."""
    return farthest({hz: published(kind, hz) for hz in HZ})
