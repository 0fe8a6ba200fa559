"""Flights of [Sun13] section IV, at the point of table I, and what the rows ask of them.

Fault at 20 s on the left command, both left segments, amplitudes 0.016 and 0.033 of the 40 deg of travel ("0.33" in the
text is a slip); scenarios `sun13-liquid-ofc` and `sun13-solid-ofc`. f_hat/f is the complex ratio of least-squares sines
at the fault's frequency from 2 s after onset. Of the form on airframe outputs only f is what (1) and (39) have there:
the mean elevator less what the actuator's model makes of the command.
"""

import functools
import math
from typing import Any

import numpy as np
from scipy.signal import cont2discrete, lfilter

from actuators.constants import RAD_PER_DEG
from cosim.flight.loop.signals import fly
from cosim.judge.fault_effect import sine
from cosim.papers.measured import at_point
from cosim.scenario import load_scenario
from cosim.training.flights import AIRCRAFT, COMMAND, DT, MANOEUVRES, estimate, fly_aircraft, side
from cosim.training.rfafe import FLIGHT_S
from fdi.rfafe import rfafe, rfafe_airframe
from fdi.rfafe.store import read

SHARE = {"ofc_liquid": 0.016, "ofc_solid": 0.033}  # of the normalised travel, section IV
SCENARIO = {"ofc_liquid": "sun13-liquid-ofc", "ofc_solid": "sun13-solid-ofc"}
TRAVEL = 40.0  # [deg]
ONSET = 20.0  # [s]
HZ = (0.5, 1.0, 2.0)
INJECTED = "faults.0_left_outer.f_inj"  # [rad]
SETTLED = 600  # ticks that an estimate of a fault-free flight needs
WRONG = (("Cm_alpha", 1.05), ("Cm_de", 0.95))  # coefficients of the uncertain flights


@functools.cache
def faulty(kind: str, hz: float, turbulence: str = "none", seed: int = 1, onset: float = ONSET) -> Any:
    """Return the flown table with an OFC on the left command."""
    changes = [f"seed={seed}", f"duration_s={onset + 10.5}", f"flight.turbulence={turbulence}", *at_point("sun13"),
               f"faults.0.start_s={onset}", f"faults.0.frequency_hz={hz}"]  # fmt: skip
    return fly(load_scenario(SCENARIO[kind], changes), [*AIRCRAFT, INJECTED])


@functools.cache
def six(turbulence: str = "none", aero: tuple = ()) -> list[Any]:
    """Return the six fault-free flights of section IV; `aero` = ((coefficient, factor), ...)."""
    own: dict = {"flight": {"turbulence": turbulence}, "tolerances": {"aero": dict(aero)}}
    return [fly_aircraft(duration=FLIGHT_S, manoeuvre=kind, **own) for kind in MANOEUVRES]


def f_hat(r: Any, stored: dict | None = None) -> np.ndarray:
    """Return the left elevator's fault by the published form [rad], (ticks,); `stored`: another design."""
    return estimate(r, "rfafe", None if stored is None else rfafe.params(stored=stored))["f_hat_left"]


def f_hat_airframe(r: Any) -> np.ndarray:
    """Return the mean elevator's fault by the form on airframe outputs [rad], (ticks,)."""
    return estimate(r, "rfafe_airframe", rfafe_airframe.params())["f_hat"]


def rms(flights: list[Any], stored: dict | None = None) -> float:
    """Return the rms of f_hat over flights [deg]."""
    return float(np.sqrt(np.mean(np.concatenate([f_hat(r, stored)[SETTLED:] for r in flights]) ** 2)) / RAD_PER_DEG)


def injected(r: Any, kind: str) -> Any:
    """Return the fault f [rad], what the actuators were told beyond the command: s, or s - command of a solid one."""
    return r[INJECTED].to_numpy() - (r[COMMAND].to_numpy() if kind == "ofc_solid" else 0.0)


def beyond_command(r: Any) -> Any:
    """Return f of the airframe form [rad], (ticks,): the mean elevator less the actuator's answer by its model."""
    made = read("rfafe_airframe")["designs"]["hydraulic"]["actuator"]
    a, gain, late = made["a_rad_s"], made["gain"], round(made["tau_s"] / DT)
    b, c, _ = cont2discrete(([gain * a], [1.0, a]), DT)
    command = r[COMMAND].to_numpy()
    moved = lfilter(np.ravel(b), c, command - command[0])
    return 0.5 * (side(r, "left") + side(r, "right")) - np.concatenate([np.zeros(late), moved])[: len(moved)]


def ratio(r: Any, estimate_: Any, f: Any, hz: float, start: float, seconds: float) -> complex:
    """Return the complex amplitude ratio f_hat/f at `hz` on `seconds` from `start`."""
    t = r.index.to_numpy()
    on = (t >= start) & (t < start + seconds)
    w = 2.0 * math.pi * hz
    return sine(t[on], estimate_[on], w) / sine(t[on], f[on], w)


def followed(kind: str, hz: float, stored: dict | None = None) -> complex:
    """Return f_hat/f of the published form in still air, an OFC at `hz`; `stored`: another design."""
    r = faulty(kind, hz)
    return ratio(r, f_hat(r, stored), injected(r, kind), hz, ONSET + 2.0, 3.0 / hz)


def airframe_in_gusts(kind: str, hz: float = 1.0, seeds: int = 5) -> tuple[float, float]:
    """Return the least and largest |f_hat / f| of the form on airframe outputs in moderate turbulence, over `seeds`."""
    flights = [faulty(kind, hz, "moderate", seed) for seed in range(1, seeds + 1)]
    found = [abs(ratio(r, f_hat_airframe(r), beyond_command(r), hz, ONSET + 2.0, 8.0)) for r in flights]
    return min(found), max(found)
