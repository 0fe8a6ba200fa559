"""One hydraulic actuator under its servo, friction, load and +-5 % of tolerance, recorded as its detectors see it."""

import math

import numpy as np
from actuator_loops import fly_hydraulic

from actuators.common import linkage
from actuators.hydraulic import actuator as hydraulic
from actuators.hydraulic.lu17 import NOMINAL

DT = 0.005
SURFACE, RIGGING, PRESSURE_BIAS = math.radians(0.02), math.radians(0.08), 0.01  # sensor set `transport`
HMD = -20e3  # one elevator segment near 290 kt [N m/rad]


def doublets(seconds, degrees=2.0, start=2.0):
    """Return a 3-2-1-1 command of `degrees`, repeated every 10 s [rad]."""
    t = np.arange(round(seconds / DT)) * DT
    out = np.zeros(len(t))
    for first in np.arange(start, seconds, 10.0):
        at = first
        for length, sign in ((3, 1), (2, -1), (1, 1), (1, -1)):
            out[(t >= at) & (t < at + length)] = sign * math.radians(degrees)
            at += length
    return out


def tolerant(seed):
    """Return hydraulic PARAMS with every parameter of (4) off by up to 5 %."""
    rng = np.random.default_rng(seed + 1000)
    return hydraulic.params(**{k: v * (1 + 0.05 * rng.uniform(-1, 1)) for k, v in NOMINAL.items()})


def fly(command, *, seed=0, hm0=-800.0, faults=None):
    """Return {name: samples} of what the detectors read; `faults(k, u, w)` writes the inputs of actuator and servo."""
    log, slog = fly_hydraulic(
        command, seed=seed, hm0=hm0, hmd=HMD, faults=faults, actuator=tolerant(seed), start=command[0]
    )
    rng = np.random.default_rng(seed + 2000)
    n = len(command)
    late = np.maximum(np.arange(n) - 1, 0)
    return {
        "command": command,
        "u": np.concatenate([[slog["u"][0]], slog["u"][:-1]]),
        "y_rod": log["q_rod"][late] + 1e-4 * rng.standard_normal(n),
        "y_surface": log["delta"][late] + SURFACE * rng.standard_normal(n) + RIGGING * rng.uniform(-1, 1),
        "y_dp": log["x3"][late] + 0.005 * rng.standard_normal(n) + PRESSURE_BIAS * rng.uniform(-1, 1),
        "hm0_model": np.full(n, 1.2 * hm0),
        "hmd_model": np.full(n, 0.8 * HMD),
        "truth": log,
    }


def run(module, flights, **params):
    """Return the log of `module` over a list of flights, one lane each, shape (lane, tick)."""
    p = np.repeat(module.params(**params), len(flights))
    u = inputs(module, flights)
    return roll(module, p, u)


def inputs(module, flights):
    """Return INPUTS of shape (lane, tick), every flag valid."""
    u = np.zeros((len(flights), len(flights[0]["u"])), module.INPUTS)
    for name in module.INPUTS.names:
        for i, f in enumerate(flights):
            if name.endswith("_valid"):
                u[name][i] = 1.0
            elif name == "surface":
                u[name][i] = f["y_surface"]
            else:
                u[name][i] = f[name]
    return u


def roll(module, p, u, dt=DT):
    """Return the log of every tick."""
    x, log = module.init(p), np.zeros(u.shape, module.STATE)
    module.rollout(x, u, p, dt, log)
    return log


def travel(degrees):
    """Return the rod travel of an angle [m]."""
    return linkage.rod(math.radians(degrees))
