"""The form of [Sun13] on airframe outputs only: its tracking, and its design scheduled over flight points.

f is what (1) and (39) have there: the mean elevator less what the actuator's model makes of the command. Against what
the fault alone did, half the difference of the sides, which share one command, f_hat is up to 1.13 and down to 0.95: at
the small amplitudes of what the law answers a real actuator, with friction, is not the first-order lag (37). The note
has that ratio.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.signal import cont2discrete, lfilter

from cosim.papers.sun13 import flown
from cosim.papers.sun13.flown import ONSET, ratio
from cosim.training.flights import COMMAND, DT, side
from fdi.rfafe import rfafe_airframe
from fdi.rfafe.store import read

SECONDS = 8.0


def beyond_command(r: Any) -> Any:
    """Return f [rad], (ticks,): the mean elevator less the stored design's model of the actuator under the command."""
    made = read("rfafe_airframe")["designs"]["hydraulic"]["actuator"]
    a, gain, late = made["a_rad_s"], made["gain"], round(made["tau_s"] / DT)
    (b, c, _) = cont2discrete(([gain * a], [1.0, a]), DT)
    command = r[COMMAND].to_numpy()
    moved = lfilter(np.ravel(b), c, command - command[0])
    return 0.5 * (side(r, "left") + side(r, "right")) - np.concatenate([np.zeros(late), moved])[: len(moved)]


@functools.cache
def tracking(kind: str, hz: float, point: str = "sun13", designed: Callable | None = None) -> tuple[complex, complex]:
    """Return f_hat over f, and over half the difference of the sides; `designed(point)` is the stored design."""
    r = flown.faulty(kind, hz, point=point)
    p = rfafe_airframe.params("design_point", stored=None if designed is None else designed(point))
    f_hat = flown.estimated(r, "rfafe_airframe", p)["f_hat"]
    apart = 0.5 * (side(r, "left") - side(r, "right"))
    own, half = (ratio(r, f_hat, f, hz, ONSET + 2.0, SECONDS) for f in (beyond_command(r), apart))
    return own, half
