"""[Alwi14] row by row: model and certificate, figures 1 and 2 on LPV plant and nonlinear aircraft, and in motion."""

import functools

import numpy as np

from actuators.constants import RAD_PER_DEG
from cosim.papers.alwi14.flights import LITERAL, NAMES, ONSET, POINTS, SENSIBLE, UNITS, fly_point, nonlinear
from cosim.papers.alwi14.plant import Law, fly
from fdi.lpv_smo import lpv_smo
from fdi.lpv_smo import synthesis as lpv_smo_design

DRAWS = 2  # sets of coefficients +-5 % per point


@functools.cache
def _plant_run(point, faults):
    model, made = lpv_smo_design.load()
    p = lpv_smo.params(model=model, made=made, bank=False)
    u = fly(model, np.array(POINTS[point], float), lpv_smo, faults=faults, seconds=30.0, pilot=Law(point))
    log = np.zeros(u.shape, lpv_smo.STATE)
    lpv_smo.rollout(lpv_smo.init(p), u, p, 0.005, log)
    return log[0]


@functools.cache
def _lpv_worst():
    """Return worst errors [%] of elevator, n_z, alpha, n_z without feedthrough (signed), and largest |e_y|."""
    keys = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha", "f_hat_n_z_raw")
    true = (3 * RAD_PER_DEG, 0.5, 5 * RAD_PER_DEG, 0.5)
    logs = [_plant_run(point, SENSIBLE) for point in POINTS]
    errors = np.array([[100 * (log[k][-1000:].mean() / t - 1) for k, t in zip(keys, true)] for log in logs])
    return *np.abs(errors[:, :3]).max(0), errors[:, 3].max(), max(log["e_norm"].max() for log in logs)


def _errors(flown, log, faults, start, end):
    """Return the errors of the means over start .. end [s] after the onset, per cent of each fault."""
    span = (flown.index >= ONSET + start) & (flown.index < ONSET + end)
    keys = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha")
    return np.array([100 * abs(log[k][span].mean() / (f * u) - 1) for k, f, u in zip(keys, faults, UNITS)])


@functools.cache
def _worst(faults, start, end, draws=0, t_learn=0.0):
    """Return the worst errors [%] of the three over the points, and over `draws` sets of coefficients at each."""
    worst = np.zeros(3)
    for point in POINTS:
        for draw in range(draws) if draws else (None,):
            flown, log = nonlinear(point, faults, draw=draw, t_learn=t_learn)
            worst = np.maximum(worst, _errors(flown, log, faults, start, end))
    return worst


def _climb(point):
    """Return the change of altitude [m] when the law flies on the faulty sensors."""
    h = fly_point(point, SENSIBLE, "all", None, 1.0)["truth.aircraft.h"].to_numpy()
    return h[-1] - h[0]


def on_plant(which: int) -> float:
    """Return a number of `_lpv_worst`: errors [%] of elevator, n_z, alpha, n_z without feedthrough, largest |e_y|."""
    return _lpv_worst()[which]


def error(which: int) -> float:
    """Return the worst error [%] of one of NAMES over the last 5 s on the nonlinear aircraft."""
    return _worst(SENSIBLE, 15, 20)[which]


def literal() -> tuple[float, str]:
    """Return the worst error [%] with the other reading of section 6.1."""
    found = _worst(LITERAL, 15, 20)
    return max(found), ", ".join(f"{n} {v:.2g}" for n, v in zip(NAMES, found))


def uncertain(learned: bool) -> tuple[float, str]:
    """Return the worst error of the elevator [%] with coefficients 5 % off; `learned`: with the offset taken out."""
    found = _worst(SENSIBLE, 15, 20, DRAWS, lpv_smo.LEARN if learned else 0.0)
    return found[0], "n_z {1:.2g}, alpha {2:.2g}".format(*found)


def through_the_law() -> tuple[float, str]:
    """Return the largest change of altitude [m] when the law flies on the faulty sensors."""
    found = [_climb(p) for p in POINTS]
    return max(found, key=abs), ", ".join(f"{p} {v:.0f}" for p, v in zip(POINTS, found))
