"""[Alwi14] figure 1 row by row: the fault-free doublet on the nonlinear aircraft, and why the elevator leaves zero."""

import dataclasses
import functools
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.flight.detection.detectors import sources
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import SIX, FlightPoint
from cosim.papers.alwi14.flights import ESTIMATES, MACH, POINTS, SENSIBLE, UNITS, fly_point, nonlinear, observed
from cosim.papers.alwi14.plant import Law, fly
from cosim.papers.measured import farthest, worst
from cosim.training import lpv as design_lpv
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import synthesis as lpv_smo_design

SHOWN = (
    ("alpha", "angle of attack", "deg", RAD_PER_DEG),
    ("q", "pitch rate", "deg/s", RAD_PER_DEG),
    ("theta", "pitch", "deg", RAD_PER_DEG),
    ("V", "airspeed", "m/s", 1.0),
    ("h", "altitude", "m", 1.0),
    ("n_z", "load factor", "g", 1.0),
)
NONE = (0.0, 0.0, 0.0)
PLANT_S = 22.0  # flights of the LPV plant: the doublet ends at 18 s


def _each(values, digits=3):
    """Return (largest, all of them by point)."""
    return worst(dict(zip(POINTS, values)), f"{{}} {{:.{digits}g}}")


def _flight(point, faults=NONE):
    """Return the table of the doublet at a point without noise."""
    return fly_point(point, faults, 0.0)


def _range(point, name):
    """Return the range of a signal in the fault-free doublet at a point, without noise."""
    return float(np.ptp(_flight(point)[name].to_numpy()[400:]))


def shown() -> tuple[float, str]:
    """Return (largest change of the pitch rate by the faults over its range without, least of A to E; each point's)."""
    name, found = sources("lpv_smo")["q"], []
    for point in POINTS:
        with_, without = (_flight(point, f)[name].to_numpy()[400:] for f in (SENSIBLE, NONE))
        found.append(float(np.abs(with_ - without).max() / np.ptp(without)))
    return min(found), _each(found)[1]


def tracking() -> tuple[float, str]:
    """Return the range of the load factor over the doublet's 0.3 g, farthest from 1; each point's."""
    found = [_range(point, sources("lpv_smo")["n_z"]) / 0.3 for point in POINTS]
    return farthest(found), _each(found)[1]


def on_plant(lift: bool = True, direct: bool = True) -> tuple[float, str]:
    """Return (range of the load factor over 0.3 g on the LPV plant under the law, farthest from 1; each point's).

    `lift`: the elevator's own lift is there (D51); `direct`: the law's direct share b_n of the demand is.
    """
    model, _ = lpv_smo_design.load()
    D = model.D.copy()
    D[:, 4, 0] *= lift
    found = []
    for point, rho in POINTS.items():
        pilot = Law(point)
        pilot.p["b_n"] *= direct
        own, at = dataclasses.replace(model, D=D), np.array(rho, float)
        flown = fly(own, at, lpv_smo, faults=NONE, seconds=PLANT_S, pilot=pilot)
        found.append(float(np.ptp(flown["n_z"][0, 400:])) / 0.3)
    return farthest(found), _each(found)[1]


def _own_model(point):
    """Return PARAMS with the linear model of a point in the form of the stored affine one."""
    model, made = lpv_smo_design.load()
    A, B, C, D, trim = design_lpv.in_paper_units(linearize(FlightPoint.at(**SIX[point])))
    C[:4], D[:4] = np.round(C[:4], 9), 0.0  # these outputs are states
    A, B, C, D = (np.concatenate([S[None], np.zeros((4, *S.shape))]) for S in (A, B, C, D))
    trims = np.zeros_like(model.trim)
    trims[:, 0] = trim
    form = lpv_smo_design.canonical(A, B, C, D, F=np.eye(5)[4])
    own = dataclasses.replace(made, A=form["A"], B=form["B"])
    return lpv_smo.params(model=dataclasses.replace(model, A=A, B=B, C=C, D=D, trim=trims), made=own)


@functools.cache
def _quiet(own: bool) -> np.ndarray:
    """Return the largest fault-free estimates [deg, g, deg] from 3 s on by point (5, 3), without noise; `own`: with the
    point's own linear model in the observer."""
    found = []
    for point in POINTS:
        flown = _flight(point)
        late = observed(flown, _own_model(point) if own else None)[flown.index > 3.0]
        found.append([np.abs(late[k]).max() / unit for k, unit in zip(ESTIMATES, UNITS)])
    return np.array(found)


def fault_free(which: int, own: bool = False) -> tuple[float, str]:
    """Return the largest fault-free estimate of one of ESTIMATES."""
    return _each(_quiet(own)[:, which], 2)


def trimmed() -> tuple[float, str]:
    """Return the range of the stabiliser over that of the elevator, largest of A to E."""
    return _each([_range(p, "law.law.stab_cmd") / _range(p, "law.law.de_cmd") for p in POINTS])


def e_norm(faults: Any, noise: float) -> tuple[float, str]:
    """Return the largest |e_y| over A to E."""
    return _each([float(nonlinear(point, tuple(faults), noise)[1]["e_norm"].max()) for point in POINTS])


def mach() -> tuple[float, str]:
    """Return how far the Mach number, flown at table 4's airspeed and altitude, is from print; farthest of A to E."""
    found = {point: float(_flight(point)[sources("lpv_smo")["mach"]].iloc[0]) for point in POINTS}
    return max(abs(found[point] - MACH[point]) for point in found), worst(found, "{} {:.4f}")[1]
