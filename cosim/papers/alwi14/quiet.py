"""[Alwi14] figure 1 row by row: the fault-free doublet on the nonlinear aircraft, and why the elevator leaves zero."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from scipy.signal import lfilter

from actuators.constants import RAD_PER_DEG
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.detection.detector_context import SERVO, site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect
from cosim.flight.plant.linearize import linearize
from cosim.flight.plant.point import SIX, FlightPoint
from cosim.papers.alwi14.flights import DEFLECTIONS, ESTIMATES, MACH, POINTS, SENSIBLE, UNITS, fly_point, nonlinear
from cosim.papers.alwi14.plant import Law, fly
from cosim.papers.measured import farthest, worst
from cosim.training import lpv as design_lpv
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import model as lpv_model
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


@functools.cache
def _quiet(noise):
    """Return the largest fault-free estimates [deg, g, deg] by point (5, 3); with noise of their mean over 5 s."""
    found = []
    for point in POINTS:
        flown, log = nonlinear(point, NONE, noise=noise)
        late = log[flown.index > (3.0 if noise == 0 else flown.index[-1] - 5)]
        got = [np.abs(late[k]).max() if noise == 0 else abs(late[k].mean()) for k in ESTIMATES]
        found.append(np.array(got) / UNITS)
    return np.array(found)


def _ranges(name, unit):
    """Return the range of a signal in the fault-free doublet at each point, without noise."""
    return [float(np.ptp(_quiet_flight(point)[name].to_numpy()[400:])) / unit for point in POINTS]


def _quiet_flight(point):
    return fly_point(point, NONE, "observers", None, 0.0)


def _lift(flown, point):
    """Return D51 times the elevator's change: the command behind sensor delay and servo."""
    late = round(TRANSPORT["n_z"][2] / flown.attrs["dt"])
    command = flown["law.law.de_cmd"].to_numpy() / RAD_PER_DEG
    command = np.r_[np.full(late, command[0]), command[: len(command) - late]]
    share = 1.0 - math.exp(-flown.attrs["dt"] / SERVO)
    return _own_model(point)[0].D[0, 4, 0] * lfilter([share], [1.0, share - 1.0], command - command[0])


def shown() -> tuple[float, str]:
    """Return (largest change of the pitch rate by the faults over its range without, least of A to E; each point's)."""
    name, found = sources("lpv_smo")["q"], []
    for point in POINTS:
        with_, without = (fly_point(point, f, "observers", None, 0.0)[name].to_numpy()[400:] for f in (SENSIBLE, NONE))
        found.append(float(np.abs(with_ - without).max() / np.ptp(without)))
    return min(found), _each(found)[1]


def tracking() -> tuple[float, str]:
    """Return the range of the load factor over the doublet's 0.3 g, farthest from 1.

    In the note each point's, the mean of the last second of each half over 0.15 g, and the range without the
    elevator's own lift.
    """
    peaks, settled, without = [], 0.0, 0.0
    for point in POINTS:
        flown = _quiet_flight(point)
        n_z = flown[sources("lpv_smo")["n_z"]].to_numpy()
        peaks.append(float(np.ptp(n_z[400:])) / 0.3)
        rest = n_z[(flown.index >= 5.0) & (flown.index < 12.0)].mean()
        ends = [n_z[(flown.index >= end - 1.0) & (flown.index < end)].mean() - rest for end in (15.0, 18.0)]
        settled = max(settled, float(np.abs(ends).max()) / 0.15)
        without = max(without, float(np.ptp((n_z - _lift(flown, point))[400:])) / 0.3)
    note = f"{_each(peaks)[1]}; last second of each half {settled:.2f}; less the elevator's own lift {without:.2f}"
    return farthest(peaks), note


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


@functools.cache
def _own_model(point, only=None):
    """Return the linear model of a point in the form of the stored affine one, and the stored design upon it.

    `only`: the entry (row, column) of A that is the point's own, all else stays affine.
    """
    model, made = lpv_smo_design.load()
    A, B, C, D, trim = design_lpv.in_paper_units(linearize(FlightPoint.at(**SIX[point])))
    C[:4], D[:4] = np.round(C[:4], 9), 0.0  # these outputs are states
    if only is not None:
        rho: Any = np.array(POINTS[point], float)
        own = A[only]
        A, B, C, D = (lpv_model.at(S, rho) for S in (model.A, model.B, model.C, model.D))
        A[only] = own
        trim = np.concatenate(lpv_model.trim_at(model, rho))
    A, B, C, D = (np.concatenate([S[None], np.zeros((4, *S.shape))]) for S in (A, B, C, D))
    trims = np.zeros_like(model.trim)
    trims[:, 0] = trim
    form = lpv_smo_design.canonical(A, B, C, D, F=np.eye(5)[4])
    own = {key: form[key] for key in ("A", "B", "E", "D2")}
    return dataclasses.replace(model, A=A, B=B, C=C, D=D, trim=trims), dataclasses.replace(made, **own)


def _own_worst(point, only=None, lag=True):
    """Return the largest fault-free elevator estimate [deg] with the point's own linear model in the observer.

    `lag`: its elevator is the lag of its command, otherwise where the segments are.
    """
    flown = _quiet_flight(point)
    p = lpv_smo.fitted(site(flown.attrs["dt"]), paper=True)
    model, made = _own_model(point, only)
    own = lpv_smo.params(model=model, made=made)
    for key in ("A", "B", "E", "D51", "eq"):
        p[key] = own[key]
    p["t_learn"], p["omega_a"] = 0.0, lag * p["omega_a"]
    log = detect(flown, lpv_smo, sources("lpv_smo") | ({} if lag else DEFLECTIONS), p)
    return float(np.abs(log["f_hat_elevator"][flown.index > 3.0]).max() / RAD_PER_DEG)


def _stiffness(point):
    """Return how far A51 of the affine model is from that of the point's own, over the latter."""
    own = _own_model(point)[0].A[0, 4, 0]
    return abs(lpv_model.at(lpv_smo_design.load()[0].A, POINTS[point])[4, 0] / own - 1.0)


def trimmed() -> tuple[float, str]:
    """Return the range of the stabiliser over that of the elevator, largest of A to E."""
    return _each([s / e for s, e in zip(_ranges("law.law.stab_cmd", 1.0), _ranges("law.law.de_cmd", 1.0))])


def e_norm(faults: tuple, noise: float) -> tuple[float, str]:
    """Return the largest |e_y| over A to E."""
    return _each([float(nonlinear(point, faults, noise=noise)[1]["e_norm"].max()) for point in POINTS])


def fault_free(which: int, noise: float = 0.0) -> tuple[float, str]:
    """Return the largest fault-free estimate of one of NAMES; with noise, of its mean over the last 5 s."""
    return _each(_quiet(noise)[:, which], 2)


def mach() -> tuple[float, str]:
    """Return how far the Mach number, flown at table 4's airspeed and altitude, is from print; farthest of A to E."""
    found = {point: float(_quiet_flight(point)[sources("lpv_smo")["mach"]].iloc[0]) for point in POINTS}
    return max(abs(found[point] - MACH[point]) for point in found), worst(found, "{} {:.4f}")[1]
