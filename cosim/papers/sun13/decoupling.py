"""The central claim of [Sun13]: decoupling E makes the estimate robust; and what the learning rate trades.

E comes from six fault-free flights, from six in moderate gusts, or from six with coefficients 5 % off. With the
block-diagonal P that our solver returns no gain of the published form stands on an airframe output; with a P that
couples q and the actuator states one does, and E acts. The airframe form has no other outputs.
"""

import functools
from typing import Any

from cosim.papers.sun13 import designs, rows, variants
from cosim.papers.sun13.flown import rms, six
from fdi.rfafe import rfafe, rfafe_airframe
from fdi.rfafe.store import from_plain

BANDWIDTH = (10.0, 40.0, 160.0)  # of the loop, proportional to the learning rate: a quarter, ours, four times [rad/s]
FORMS: dict[str, Any] = {"rfafe": (rfafe, variants.published), "rfafe_airframe": (rfafe_airframe, variants.airframe)}


def _size(form: str, flights: list[Any], source: str) -> float:
    """Return the rms of f_hat [deg] over flights, E of one of SOURCES."""
    module, made = FORMS[form]
    return rms(flights, form, module.params(stored=made(source=source)))


def decoupled(form: str, source: str) -> tuple[float, str]:
    """Return rms of f_hat with coefficients 5 % off over six flights, E from `source` over no E; the same in gusts."""
    off, gusts = six("none", variants.WRONG), six("moderate")
    without = _size(form, off, "no E")
    ratio, gusty = _size(form, off, source) / without, _size(form, gusts, source) / _size(form, gusts, "no E")
    return ratio, f"of {without:.3f} deg; {gusty:.3f} in moderate turbulence"


def uncertain() -> float:
    """Return rms of f_hat with two coefficients 5 % off over that with nominal ones, six fault-free flights."""
    return rms(six("none", variants.WRONG), "rfafe", None) / rms(six(), "rfafe", None)


@functools.cache
def _rate(bandwidth):
    stored = variants.published("six flights", bandwidth)
    return abs(rows.published("ofc_liquid", 2.0, stored=stored)), stored["designs"]["hydraulic"]["noise_deg"][0]


def slow() -> float:
    """Return |f_hat / f| at 2 Hz with a quarter of our learning rate."""
    return _rate(BANDWIDTH[0])[0]


def noisy() -> float:
    """Return the noise of f_hat with four times our learning rate, over ours."""
    return _rate(BANDWIDTH[2])[1] / _rate(BANDWIDTH[1])[1]


def coupled() -> tuple[float, str]:
    """Return rms of f_hat with E over that without, coefficients 5 % off, with the coupled P of `variants.coupled`.

    In the note the same in moderate turbulence, |f_hat/f| at 1 Hz, what of (15) is left and the rms with our P.
    """
    off, gusts = six("none", variants.WRONG), six("moderate")
    own = {source: rfafe.params(stored=variants.coupled(source)) for source in ("no E", "six flights")}
    without, with_ = (rms(off, "rfafe", p) for p in own.values())
    gusty = [rms(gusts, "rfafe", p) for p in own.values()]
    seen = abs(rows.published("ofc_liquid", 1.0, stored=variants.coupled()))
    left = designs.left_sides(from_plain(variants.coupled()["designs"]["hydraulic"]["design"]))["(15)"]
    ours = [rms(flights, "rfafe", None) for flights in (off, gusts)]
    told = f"{with_:.3f} of {without:.3f} deg, with our P {ours[0]:.3f}; in moderate turbulence {gusty[1]:.3f} of "
    told += f"{gusty[0]:.3f}, with our P {ours[1]:.3f}"
    return with_ / without, f"{told}; |f_hat/f| at 1 Hz {seen:.3f}; (15) {left:.2g} of its size"
