"""[Sun13] row by row: fault-free flight, liquid and solid OFC of the left elevator, what E and the learning rate do.

E comes from six fault-free flights. With the block-diagonal P that our solver returns no gain of the published form
stands on an airframe output; with a P that couples q and the actuator states one does, and E acts.
"""

import functools
import math

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.judge.fault_effect import sine
from cosim.papers.measured import farthest
from cosim.papers.sun13 import designs, flown
from cosim.papers.sun13.flown import HZ, ONSET, SHARE, TRAVEL, WRONG, followed, rms, six
from cosim.papers.sun13.predicted import predicted, total
from cosim.training.flights import DT, fly_aircraft, side
from fdi.rfafe.store import from_plain, read

WINDOW = slice(round((ONSET + 2.0) / DT), round((ONSET + 10.0) / DT))  # of a fault at 1 Hz, whole periods
BANDWIDTH = (10.0, 40.0, 160.0)  # of the loop, proportional to the learning rate: a quarter, ours, four times [rad/s]


@functools.cache
def _still():
    """Return (times [s], f_hat [deg]) of a fault-free flight in still air."""
    r = fly_aircraft(duration=40.0)
    return r.index.to_numpy(), flown.f_hat(r) / RAD_PER_DEG


@functools.cache
def _moved(kind):
    """Return (complex amplitude of the left elevator, rms of what is no sine) [deg]."""
    r = flown.faulty(kind, 1.0)
    t, y = r.index.to_numpy()[WINDOW], side(r, "left")[WINDOW] / RAD_PER_DEG
    a = sine(t, y, 2 * math.pi)
    return a, float(np.std(y - (a * np.exp(2j * math.pi * t)).real))


def surface(kind: str) -> tuple[float, str]:
    """Return the amplitude of the left elevator at 1 Hz over the fault's."""
    lag = float(read("rfafe")["designs"]["hydraulic"]["actuator"]["a_rad_s"])
    return abs(_moved(kind)[0]) / (SHARE[kind] * TRAVEL), f"(37) lets {lag / math.hypot(lag, 2 * math.pi):.3f} through"


def rest() -> float:
    """Return what of the left elevator is no sine in a solid OFC, over the fault's amplitude."""
    return _moved("ofc_solid")[1] / (SHARE["ofc_solid"] * TRAVEL)


def noise() -> float:
    """Return the deviation of f_hat over the predicted one, without a fault, in still air."""
    t, f = _still()
    return np.std(f[t > 3.0]) / total(predicted())


def stands_out() -> float:
    """Return the largest amplitude at HZ over three periods without a fault, from 3 s on, over the fault of 0.016."""
    (t, f), most = _still(), 0.0
    for hz in HZ:
        n = round(3.0 / hz / DT)
        most = max(most, *(abs(sine(t[k : k + n], f[k : k + n], 2 * math.pi * hz)) for k in range(600, len(f) - n, n)))
    return most / (SHARE["ofc_liquid"] * TRAVEL)


def tracks(kind: str) -> tuple[float, str]:
    """Return |f_hat / f| farthest from 1 over the three frequencies, still air; all of them."""
    ratios = {hz: followed(kind, hz) for hz in HZ}
    words = ", ".join(f"{hz} {abs(x):.3f} at {math.degrees(np.angle(x)):.0f} deg" for hz, x in ratios.items())
    return farthest(map(abs, ratios.values())), words


def frequency(kind: str) -> float:
    """Return the frequency [Hz] at which f_hat of a 1 Hz fault has its largest sine over 8 s."""
    r, tried = flown.faulty(kind, 1.0), np.linspace(0.5, 2.0, 301)
    t, f = r.index.to_numpy()[WINDOW], flown.f_hat(r)[WINDOW]
    return tried[np.argmax([abs(sine(t, f, 2 * math.pi * hz)) for hz in tried])]


def uncertain() -> float:
    """Return rms of f_hat with two coefficients 5 % off over that with nominal ones, six fault-free flights."""
    return rms(six("none", WRONG)) / rms(six())


def decoupled(coupled: bool) -> tuple[float, str]:
    """Return rms of f_hat with coefficients 5 % off over six flights, with E over without; the same in gusts.

    `coupled`: with the P of `designs.coupled`, whose |f_hat/f| at 1 Hz and rest of (15) are in the note.
    """
    make = designs.coupled if coupled else designs.published
    (off, off_without), (gusts, gusts_without) = (
        [rms(flights, make(with_E)) for with_E in (True, False)] for flights in (six("none", WRONG), six("moderate"))
    )
    note = f"{off:.3f} of {off_without:.3f} deg; in moderate turbulence {gusts:.3f} of {gusts_without:.3f}"
    if coupled:
        left = designs.left_sides(from_plain(make()["designs"]["hydraulic"]["design"]))["(15)"]
        note += f"; |f_hat/f| at 1 Hz {abs(followed('ofc_liquid', 1.0, make())):.3f}; (15) {left:.2g} of its size"
    return off / off_without, note


def slow() -> float:
    """Return |f_hat / f| at 2 Hz with a quarter of our learning rate."""
    return abs(followed("ofc_liquid", 2.0, designs.published(bandwidth=BANDWIDTH[0])))


def noisy() -> float:
    """Return the noise of f_hat with four times our learning rate, over ours."""
    ours, fast = (designs.published(bandwidth=w)["designs"]["hydraulic"]["noise_deg"][0] for w in BANDWIDTH[1:])
    return fast / ours
