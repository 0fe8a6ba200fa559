"""Flights of [Sun13] section IV, at the point of table I, and what the rows ask of them.

Fault at 20 s on the left command, both left segments, amplitudes 0.016 and 0.033 of the 40 deg of travel ("0.33" in the
text is a slip); scenarios `sun13-liquid-ofc`, `sun13-solid-ofc` and `sun13-both-sides`. f_hat/f is the complex ratio of
least-squares sines at the fault's frequency from 2 s after onset.
"""

import functools
import math
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.loop.signals import fly
from cosim.judge.fault_effect import sine
from cosim.papers.measured import at_point
from cosim.papers.measured import farthest as most_off
from cosim.scenario import load_scenario
from cosim.training.flights import AIRCRAFT, COMMAND, MANOEUVRES, estimate, fly_aircraft
from cosim.training.rfafe import FLIGHT_S

SHARE = {"ofc_liquid": 0.016, "ofc_solid": 0.033}  # of the normalised travel, section IV
SCENARIO = {"ofc_liquid": "sun13-liquid-ofc", "ofc_solid": "sun13-solid-ofc"}
TRAVEL = 40.0  # [deg]
ONSET = 20.0  # [s]
HZ = (0.5, 1.0, 2.0)
INJECTED = "faults.0_left_outer.f_inj"  # [rad]
SETTLED = 600  # ticks that an estimate of a fault-free flight needs


def estimated(r: Any, form: str, p: Any = None) -> Any:
    """Return the log of an estimator of a flown table; `p` PARAMS, by default those of the stored design."""
    return estimate(r, form, p)


@functools.cache
def faulty(
    kind: str, hz: float, turbulence: str = "none", seed: int = 1, onset: float = ONSET, point: str = "sun13"
) -> Any:
    """Return the flown table, at SIX[point], with an OFC on the left command."""
    changes = [f"seed={seed}", f"duration_s={onset + 10.5}", f"flight.turbulence={turbulence}", *at_point(point),
               f"faults.0.start_s={onset}", f"faults.0.frequency_hz={hz}"]  # fmt: skip
    return fly(load_scenario(SCENARIO[kind], changes), [*AIRCRAFT, INJECTED])


@functools.cache
def six(turbulence: str = "none", aero: tuple = ()) -> list[Any]:
    """Return the six fault-free flights of section IV; `aero` = ((coefficient, factor), ...)."""
    return [
        fly_aircraft(
            duration=FLIGHT_S, manoeuvre=kind, flight={"turbulence": turbulence}, tolerances={"aero": dict(aero)}
        )
        for kind in MANOEUVRES
    ]


def rms(flights: list[Any], form: str, p: Any) -> float:
    """Return the rms of f_hat (of the left side) over flights [deg]."""
    name = "f_hat_left" if form == "rfafe" else "f_hat"
    parts = [estimated(r, form, p)[name][SETTLED:] for r in flights]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)) / RAD_PER_DEG)


def injected(r: Any, kind: str) -> Any:
    """Return the fault f [rad], what the actuators were told beyond the command: s, or s - command of a solid one."""
    return r[INJECTED].to_numpy() - (r[COMMAND].to_numpy() if kind == "ofc_solid" else 0.0)


def ratio(r: Any, f_hat: Any, f: Any, hz: float, start: float, seconds: float) -> complex:
    """Return the complex amplitude ratio f_hat/f at `hz` on `seconds` from `start`."""
    t = r.index.to_numpy()
    on = (t >= start) & (t < start + seconds)
    w = 2.0 * math.pi * hz
    return sine(t[on], f_hat[on], w) / sine(t[on], f[on], w)


def farthest(ratios: dict) -> tuple[float, str]:
    """Return (size of the ratio that is farthest from 1, all of them) of {what: complex ratio}."""
    told = ", ".join(f"{what} {abs(x):.3f} at {math.degrees(np.angle(x)):.0f} deg" for what, x in ratios.items())
    return most_off(map(abs, ratios.values())), told
