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
from cosim.flight.loop.signals import fly
from cosim.judge.alarms import detection
from cosim.judge.fault_effect import sine
from cosim.papers.sun13 import flown
from cosim.papers.sun13.flown import HZ, INJECTED, ONSET, SHARE, TRAVEL, farthest, ratio
from cosim.scenario import load_scenario
from cosim.scenario.catalog import SEGMENTS as NAMES
from cosim.training import rfafe_noise
from cosim.training.flights import AIRCRAFT, DT, MODULES, fly_aircraft, side
from fdi.rfafe import rfafe
from fdi.rfafe.store import read

LAG = float(read("rfafe")["designs"]["hydraulic"]["actuator"]["a_rad_s"])  # of (37) [rad/s]


def published(kind: str, hz: float, turbulence: str = "none", stored: dict | None = None) -> complex:
    """Return f_hat/f of the published form, an OFC at `hz`; `stored`: another design than the stored one."""
    r = flown.faulty(kind, hz, turbulence)
    f_hat = flown.estimated(r, "rfafe", None if stored is None else rfafe.params(stored=stored))["f_hat_left"]
    return ratio(r, f_hat, flown.injected(r, kind), hz, ONSET + 2.0, 3.0 / hz)


def _quiet_law():
    """Return {estimator: fault-free flight} with noise for the estimator only: the law flies on clean sensors."""
    r, rng = fly_aircraft(duration=40.0, sensors={"noise_scale": 0.0}), np.random.default_rng(7)
    out = {}
    for form in MODULES:
        out[form] = r.copy()
        for name in ("tas", "alpha", "q", "theta"):
            out[form][f"sensors.{name}.y_obs"] += rng.normal(size=len(r)) * TRANSPORT[name][1]
    positions = [f"sensors.{s}_surface.y_obs" for s in NAMES]
    out["rfafe"][positions] += rng.normal(size=(len(r), 4)) * HYDRAULIC.sensors["surface"].sigma
    return out


@functools.cache
def _noise_level():
    """Return (deviation of f_hat over that predicted through the loop, with clean sensors in the law over that of the
    estimator's own sensors), published form."""
    f, clean = (flown.estimated(r, "rfafe")["f_hat_left"] / RAD_PER_DEG for r in (_still(), _quiet_law()["rfafe"]))
    late = _still().index > 3.0
    own = read("rfafe")["designs"]["hydraulic"]["noise_deg"][0]
    return np.std(f[late]) / rfafe_noise.total(rfafe_noise.predicted()["rfafe"]), np.std(clean[late]) / own


@functools.cache
def _still():
    return fly_aircraft(duration=40.0)


def _amplitude(r):
    """Return the largest amplitude of f_hat at HZ in windows of three periods, from 3 s on [deg]."""
    t, f = r.index.to_numpy(), flown.estimated(r, "rfafe")["f_hat_left"] / RAD_PER_DEG
    return max(
        abs(sine(t[k : k + n], f[k : k + n], 2 * math.pi * hz))
        for hz in HZ
        for n in (round(3.0 / hz / DT),)
        for k in range(600, len(f) - n, n)
    )


@functools.cache
def _moved(kind):
    """Return (complex amplitude of the left elevator, rms of what is no sine) [deg]."""
    r = flown.faulty(kind, 1.0)
    t = r.index.to_numpy()
    on = (t >= ONSET + 2.0) & (t < ONSET + 10.0)
    t, y = t[on], side(r, "left")[on] / RAD_PER_DEG
    a = sine(t, y, 2 * math.pi)
    return a, float(np.std(y - (a * np.exp(2j * math.pi * t)).real))


def frequency(kind: str) -> float:
    """Return the frequency [Hz] at which f_hat of a 1 Hz fault has its largest sine over 8 s."""
    r = flown.faulty(kind, 1.0)
    t = r.index.to_numpy()
    on = (t >= ONSET + 2.0) & (t < ONSET + 10.0)
    f = flown.estimated(r, "rfafe")["f_hat_left"][on]
    tried = np.linspace(0.5, 2.0, 301)
    return tried[np.argmax([abs(sine(t[on], f, 2 * math.pi * hz)) for hz in tried])]


def periods(kind: str) -> float:
    """Return after how many periods of a 1 Hz fault the alarm comes, nan if it does not."""
    at = detection(flown.estimated(flown.faulty(kind, 1.0), "rfafe")["alarm"], 0)
    return at * DT - ONSET if at is not None else math.nan


@functools.cache
def _both():
    """Return |f_hat/f| of each side, 1 Hz on the left and 2 Hz on the right at once, and the leak between them."""
    right = INJECTED.replace("0_left", "1_right")
    r = fly(load_scenario("sun13-both-sides"), [*AIRCRAFT, INJECTED, right])
    log = flown.estimated(r, "rfafe")
    own = [
        abs(ratio(r, log[f"f_hat_{s}"], r[name].to_numpy(), hz, ONSET + 2.0, 8.0))
        for s, name, hz in (("left", INJECTED, 1.0), ("right", right, 2.0))
    ]
    leak = [
        abs(ratio(r, log[f"f_hat_{s}"], r[name].to_numpy(), hz, ONSET + 2.0, 8.0))
        for s, name, hz in (("left", right, 2.0), ("right", INJECTED, 1.0))
    ]
    return own, leak


def noise() -> tuple[float, str]:
    """Return the deviation of f_hat over the predicted one, without a fault, in still air."""
    return _noise_level()[0], f"with noise in the estimator's sensors only {_noise_level()[1]:.2f}"


def stands_out() -> float:
    """Return the largest amplitude over three periods without a fault, over the fault of 0.016."""
    return _amplitude(_still()) / (SHARE["ofc_liquid"] * TRAVEL)


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


def in_gusts(kind: str) -> float:
    """Return |f_hat / f| at 1 Hz in light turbulence."""
    return abs(published(kind, 1.0, "light"))


def both_sides() -> tuple[float, str]:
    """Return |f_hat / f| farthest from 1 of two sides that oscillate at once."""
    return max(_both()[0], key=lambda x: abs(x - 1.0)), "left {:.3f}, right {:.3f}".format(*_both()[0])


def leak() -> float:
    """Return the largest share of one side's fault in the other's estimate."""
    return max(_both()[1])
