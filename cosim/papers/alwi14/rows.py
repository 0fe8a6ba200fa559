"""[Alwi14] row by row: model and certificate, figures 1 and 2 on LPV plant and nonlinear aircraft, and in motion."""

import functools

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.papers.alwi14.flights import ESTIMATES, ONSET, POINTS, SENSIBLE, UNITS, nonlinear
from cosim.papers.alwi14.plant import Law, fly
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import synthesis as lpv_smo_design


@functools.cache
def _plant_run(point, faults):
    model, made = lpv_smo_design.load()
    p = lpv_smo.params(model=model, made=made)
    u = fly(model, np.array(POINTS[point], float), lpv_smo, faults=faults, seconds=30.0, pilot=Law(point))
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    return log[0]


def on_plant(which: int) -> float:
    """Return the worst error [%] of elevator, n_z, alpha, n_z without feedthrough (signed); 4: the largest |e_y|."""
    logs = [_plant_run(point, SENSIBLE) for point in POINTS]
    if which == 4:
        return max(log["e_norm"].max() for log in logs)
    key, true = (*ESTIMATES, "f_hat_n_z_raw")[which], (3 * RAD_PER_DEG, 0.5, 5 * RAD_PER_DEG, 0.5)[which]
    errors = [100 * (log[key][-1000:].mean() / true - 1) for log in logs]
    return max(errors) if which == 3 else max(map(abs, errors))


@functools.cache
def _worst():
    """Return the worst errors [%] of the means over the last 5 s, over the points."""
    most = np.zeros(3)
    for point in POINTS:
        flown, log = nonlinear(point, SENSIBLE)
        late = (flown.index >= ONSET + 15) & (flown.index < ONSET + 20)
        errors = [100 * abs(log[k][late].mean() / (f * u) - 1) for k, f, u in zip(ESTIMATES, SENSIBLE, UNITS)]
        most = np.maximum(most, errors)
    return most


def error(which: int) -> float:
    """Return the worst error [%] of one of ESTIMATES over the last 5 s on the nonlinear aircraft."""
    return _worst()[which]
