"""Flights of [Alwi14] section 6: points of table 4, a doublet, three faults at once."""

import functools
from typing import Any

from actuators.constants import RAD_PER_DEG
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.flight.plant.point import SIX
from cosim.papers.measured import at_point
from cosim.scenario.load import load_scenario
from fdi.lpv_smo import lpv_smo

MACH = {"A": 0.40, "B": 0.51, "C": 0.54, "D": 0.68, "E": 0.53}  # Table 4
POINTS = {p: (*(SIX[p][k] for k in ("mass_t", "cg_pct", "cas_kt")), m) for p, m in MACH.items()}  # t, %, kt, Mach
SENSIBLE = (3.0, 0.5, 5.0)  # elevator [deg], n_z [g], alpha [deg]: of "3 deg, 5 and 0.5 deg" what is physical
ESTIMATES = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha")
UNITS = (RAD_PER_DEG, 1.0, RAD_PER_DEG)
ONSET = 10.0  # [s]


@functools.cache
def fly_point(point: str, faults: Any, noise: float) -> Any:
    """Fly a Table 4 point with a doublet of 0.15 g at 12 s; return what the observer reads, and more."""
    changes = [*at_point(point), "detectors.enabled=[]", f"sensors.noise_scale={noise}"]
    if any(faults):
        keys = ("faults.0.bias_deg", "faults.1.bias_g", "faults.2.bias_deg")
        changes += [f"{key}={value}" for key, value in zip(keys, faults)]
        changes += ["faults.1.path=observers", "faults.2.path=observers"]
    else:
        changes.append("faults=[]")
    names = [*sources("lpv_smo").values(), "truth.aircraft.h", "law.law.stab_cmd", "law.law.de_cmd"]
    return fly(load_scenario("alwi14-simultaneous", changes), names)


def observed(flown: Any, own: Any = None) -> Any:
    """Return the log of the observer as published on a flight, without learned offset; `own` replaces its model."""
    p = lpv_smo.fitted(site(flown.attrs["dt"]), paper=True)
    for name in () if own is None else ("A", "B", "eq"):
        p[name] = own[name]
    p["t_learn"] = 0.0
    return detect(flown, lpv_smo, sources("lpv_smo"), p)


def nonlinear(point: str, faults: Any, noise: float = 1.0) -> tuple[Any, ...]:
    """Return (flight, the observer's log) of a Table 4 point."""
    flown = fly_point(point, faults, noise)
    return flown, observed(flown)
