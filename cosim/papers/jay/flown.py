"""[Jay] in flight: incipient faults, disturbances and reconfiguration with the form of the filter that knows a load.

The right inner segment is electromechanical, in a 3-2-1-1 of 4 deg and light turbulence; faults come at 12 s and are
looked at for 50 s. The scenarios are `jay-incipient-position`, `-velocity` and `-current`, `ema-winding-resistance` and
`ema-position-bias`; sizes are set from here.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.flight.loop.signals import fly
from cosim.judge.alarms import detection
from cosim.scenario import load_scenario
from fdi.ema.ema_kalman_flight import CULPRITS

ONSET, LANE = 12.0, "right_inner"
OWN = tuple(f"ema_kalman_flight.{LANE}.{n}" for n in ("alarm", "culprit", "r", "pos_hat", "reconf"))
TRUE = ("truth.aircraft.nz", f"ema.{LANE}.delta", f"ema.{LANE}.motor")
READ = tuple(f"ema_kalman_in.{LANE}.{n}" for n in ("u", "y_position", "y_velocity", "y_current"))
PUBLISHED = tuple(f"ema_kalman.{LANE}.{n}" for n in ("eta_bar", "R1"))
SIZES = {  # sensor, unit -> (scenario, key, sizes)
    ("position", "deg/s of drift"): ("jay-incipient-position", "faults.0.drift_deg_s", (0.02, 0.05, 0.1, 0.2, 0.5)),
    ("velocity", "% of no-load"): ("jay-incipient-velocity", "faults.0.bias_pct", (1.0, 2.0, 5.0)),
    ("current", "% of stall"): ("jay-incipient-current", "faults.0.bias_pct", (1.0, 2.0, 5.0)),
}


@functools.cache
def flight(name: str, *changes: Any) -> Any:
    """Return the flown table of a scenario, with both filters of the right inner segment watching."""
    both = 'detectors.enabled=["ema_kalman", "ema_kalman_flight"]'
    return fly(load_scenario(name, [both, *changes]), [*OWN, *TRUE, *READ, *PUBLISHED])


def each_size(sensor: str, unit: str, say: Callable) -> tuple[int, str]:
    """Return (how many sizes of a sensor's faults are right, each in words) by what `say(flight)` returns."""
    name, key, sizes = SIZES[sensor, unit]
    found = [say(flight(name, f"{key}={size:g}")) for size in sizes]
    told = ", ".join(f"{size:g}: {words}" for size, (_, words) in zip(sizes, found))
    return sum(right for right, _ in found), f"of {len(sizes)} {unit}; {told}"


def named(sensor: str, unit: str) -> tuple[int, str]:
    """Return (how many sizes are named after their sensor within 50 s, when each)."""

    def say(f):
        first = round(ONSET / f.attrs["dt"])
        at = detection(f[OWN[1]].to_numpy() == CULPRITS.index(sensor), first)
        if at is not None:
            return True, f"{f.index[at] - ONSET:.1f} s"
        alarm = detection(f[OWN[0]].to_numpy(), first)
        return False, "silent" if alarm is None else f"alarm without a name after {f.index[alarm] - ONSET:.1f} s"

    return each_size(sensor, unit, say)


def off() -> tuple[float, str]:
    """Return (largest error of a drifting position when it is reconfigured [deg], when each size is)."""
    (name, key, sizes), told, worst = SIZES["position", "deg/s of drift"], [], 0.0
    for size in sizes:
        f = flight(name, f"{key}={size:g}", "elevator.reconfigure=true")
        at = detection(f[OWN[4]].to_numpy(), round(ONSET / f.attrs["dt"]))
        off = np.inf if at is None else size * (f.index[at] - ONSET)
        worst = max(worst, off)
        told.append(f"{size:g}: {off:.2f}")
    return worst, "deg at deg/s of drift; " + ", ".join(told)
