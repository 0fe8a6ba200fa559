"""Flights of [Alwi14] section 6: points of table 4, a doublet, faults in two readings of the text."""

import functools
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.flight.plant.point import SIX
from cosim.papers.measured import at_point
from cosim.scenario.load import load_scenario
from cosim.scenario.tolerance import toleranced
from fdi.lpv_smo import lpv_smo

MACH = {"A": 0.40, "B": 0.51, "C": 0.54, "D": 0.68, "E": 0.53}  # Table 4
POINTS = {p: (*(SIX[p][k] for k in ("mass_t", "cg_pct", "cas_kt")), m) for p, m in MACH.items()}  # t, %, kt, Mach
SENSIBLE, LITERAL = (3.0, 0.5, 5.0), (3.0, 5.0, 0.5)  # elevator [deg], n_z [g], alpha [deg]: two readings of section 6
ESTIMATES = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha")
UNITS = (RAD_PER_DEG, 1.0, RAD_PER_DEG)
ONSET = 10.0  # [s]
DEFLECTIONS = {n: f"truth.aircraft.{n}" for n in ("de_lo", "de_li", "de_ri", "de_ro")}  # of the segments


@functools.cache
def fly_point(point: str, faults: Any, path: Any, draw: Any, noise: Any) -> Any:
    """Fly a Table 4 point with a doublet of 0.15 g at 12 s; return what the observer reads, and more."""
    changes = [*at_point(point), "detectors.enabled=[]", f"sensors.noise_scale={noise}"]
    if any(faults):
        keys = ("faults.0.bias_deg", "faults.1.bias_g", "faults.2.bias_deg")
        changes += [f"{key}={value}" for key, value in zip(keys, faults)]
        changes += [f"faults.{i}.path={path}" for i in (1, 2)]
    else:
        changes.append("faults=[]")
    if draw is not None:
        rng = np.random.default_rng([ord(point), draw])
        changes += [f"tolerances.aero.{n}={1 + 0.05 * rng.choice((-1, 1))}" for n in toleranced("aero")]
    names = [*sources("lpv_smo").values(), "truth.aircraft.h", "law.law.stab_cmd", *DEFLECTIONS.values()]
    return fly(load_scenario("alwi14-simultaneous", changes), names)


def observed(flown: Any, t_learn: float = 0.0, paper: bool = True) -> Any:
    """Return the observer's log of a flight, without learned offset unless `t_learn` says so; `paper`: as published."""
    p = lpv_smo.fitted(site(flown.attrs["dt"]), paper=paper)
    p["t_learn"] = t_learn
    return detect(flown, lpv_smo, sources("lpv_smo"), p)


def nonlinear(
    point: str, faults: Any, path: str = "observers", draw: Any = None, noise: float = 1.0, t_learn: float = 0.0
) -> tuple[Any, ...]:
    """Return (flight, the observer's log) of a Table 4 point."""
    flown = fly_point(point, faults, path, draw, noise)
    return flown, observed(flown, t_learn)
