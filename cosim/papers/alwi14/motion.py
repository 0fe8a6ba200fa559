"""[Alwi14] in motion: the scheduling parameters change while the faults are on, and one box follows the other.

Scenario `alwi14-deceleration`: the aircraft of point E with 90 % of the thrust gone from 4 s on slows down while the
law holds the load factor. Scenario `alwi14-descent`: it sinks at 2,500 ft/min for four minutes and gathers speed. The
three faults come at 10 s. Nothing of it is in the paper, whose five flights are at constant parameters.
"""

import functools
from typing import Any

import numpy as np

from actuators.constants import M_S_PER_KT
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import fly
from cosim.judge.alarms import detection
from cosim.papers.alwi14.flights import ESTIMATES, NAMES, ONSET, POINTS, SENSIBLE, UNITS, observed
from cosim.papers.measured import at_point, worst
from cosim.scenario import load_scenario

SPEED, MACH = "sensors.cas.y_obs", "sensors.mach.y_obs"


@functools.cache
def moving(kind: str) -> tuple[Any, ...]:
    """Return (table, log) of the "deceleration" or the "descent" with its faults."""
    flown = fly(load_scenario(f"alwi14-{kind}"), [*sources("lpv_smo").values(), SPEED, "truth.aircraft.h"])
    return flown, observed(flown, paper=False)


def error(kind: str, i: int) -> tuple[float, str]:
    """Return (largest error of the estimate's mean over 2 s [%] from 5 s after the onset on, what it went through)."""
    flown, log = moving(kind)
    n = round(2.0 / flown.attrs["dt"])
    mean = np.convolve(log[ESTIMATES[i]], np.full(n, 1.0 / n), "valid")
    late = mean[round((ONSET + 5.0) / flown.attrs["dt"]) :]
    cas, h = flown[SPEED].to_numpy() / M_S_PER_KT, flown["truth.aircraft.h"].to_numpy()
    boxes = 1 + np.count_nonzero(np.diff(log["box"]))
    through = f"{cas[0]:.0f} to {cas[-1]:.0f} kt, {h[-1] - h[0]:+.0f} m, {boxes} boxes"
    return 100.0 * np.abs(late / (SENSIBLE[i] * UNITS[i]) - 1.0).max(), through


def reconstructed() -> tuple[float, str]:
    """Return the largest change of altitude [m] when the law flies on y - f_hat, of A to E, and each."""
    found = {}
    for p in POINTS:
        h = fly(load_scenario("alwi14-reconstructed", at_point(p)), ["truth.aircraft.h"])["truth.aircraft.h"].to_numpy()
        found[p] = float(np.abs(h - h[0]).max())
    return worst(found, "{} {:.0f}")


def declared() -> tuple[float, str]:
    """Return (points at which all three faults are declared within 10 s and not before, the delays at each [s])."""
    own = [f"lpv_smo.aircraft.alarm_{name}" for name in NAMES]
    count, told = 0, []
    for point in POINTS:
        f = fly(load_scenario("alwi14-simultaneous", at_point(point)), own)
        first = round(ONSET / f.attrs["dt"])
        late = [detection(f[name], first, first + 2000) for name in own]
        early = any((f[name].to_numpy()[:first] > 0.5).any() for name in own)
        count += not early and all(k is not None for k in late)
        told.append(f"{point} " + "/".join("-" if k is None else f"{f.index[k] - ONSET:.1f}" for k in late))
    return count, "; ".join(told)
