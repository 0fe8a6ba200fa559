"""The actuator technologies as the loop sees them: which blocks, with which parameters, in which equilibrium."""

import functools
import math

import numpy as np

from actuators import hydraulic, servo, simple
from cosim.inject import Nominal
from cosim.wiring import SEGMENTS


def stack(records):
    """Return one array of lanes from records of shape (1,)."""
    return np.concatenate(list(records)) if records else None


def hydraulic_blocks(names, scenario, loads, dt):
    """Return [(section, module, p, x0)] of servo and actuator for the hydraulic lanes `names`.

    `loads` maps lane -> (delta, hm0, hmd) at trim. What flies is multiplied by scenario.tolerances.hydraulic; the servo's model stays
    nominal, as a real servo's does.
    """
    off = {k: hydraulic.NOMINAL[k] * v for k, v in scenario.tolerances.hydraulic.items()}
    p_act = stack([hydraulic.params(**off) for _ in names])
    p_servo = stack([servo.params(dt=dt) for _ in names])
    delta, hm0, hmd = (np.array([loads[n][i] for n in names]) for i in range(3))
    x_act = hydraulic.init_at(p_act, delta, hm0, hmd)
    x_servo = servo.init_at(p_servo, delta, x_act["F_d"])
    return [("servo", servo, p_servo, x_servo), ("hydraulic", hydraulic, p_act, x_act)]


@functools.cache
def _hydraulic_liquid_gain(omega, dt):
    """Return rod amplitude per valve amplitude with the servo closed, no load and no friction, by flying 6 s of it."""
    p, ps = hydraulic.params(F_c=0.0, F_s=0.0), servo.params(dt=dt)
    x, xs = hydraulic.init(p), servo.init(ps)
    u, us = np.zeros((1, 1), hydraulic.INPUTS), np.zeros((1, 1), servo.INPUTS)
    log, logs = np.zeros((1, 1), hydraulic.STATE), np.zeros((1, 1), servo.STATE)
    amplitude = 0.002  # of u: small against the valve's 0.236
    periods = max(6, math.ceil(2.0 * omega / (2 * math.pi)))
    n = round((periods * 2 * math.pi / omega + 2.0) / dt)
    t, q = np.arange(n) * dt, np.zeros(n)
    us["q_valid"] = us["x3_valid"] = 1.0
    before = (0.0, 0.0)
    for k in range(n):
        us["q_meas"], us["x3_meas"] = before
        before = (x["q_rod"][0], x["x3"][0])
        servo.rollout(xs, us, ps, dt, logs)
        u["u"], u["f_u"] = xs["u"][0], amplitude * math.sin(omega * t[k])
        hydraulic.rollout(x, u, p, dt, log)
        q[k] = x["q_rod"][0]
    late = t > 2.0
    basis = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones(n)])[late]
    c, s, _ = np.linalg.lstsq(basis, q[late], rcond=None)[0]
    return math.hypot(c, s) / amplitude


def _hydraulic_solid_gain(omega):
    """Return |q / u| of the actuator alone, linearised at rest. [Lu17] (4)"""
    if omega == 0.0:  # steady rod speed per valve opening [m/s]
        return float(hydraulic.NOMINAL["phi_n"] / hydraulic.NOMINAL["A_p"])
    A, B, C, _ = hydraulic.linearised(hydraulic.params())
    q = C @ np.linalg.solve(1j * omega * np.eye(3) - A, B)
    return abs(complex(q[0, 0])) * hydraulic.NOMINAL["arm"]


def valve_gain(technology, solid, omega, dt):
    """Return the rod amplitude [m] (at omega 0: speed [m/s]) that a unit at the valve gives, nominal and unloaded."""
    if technology != "hydraulic":
        raise ValueError(f"no valve gain for {technology}")
    return _hydraulic_liquid_gain(omega, dt) if solid is False else _hydraulic_solid_gain(omega)


def nominal(dt):
    """Return the values that relative units of a fault refer to."""
    return Nominal(
        supply=hydraulic.NOMINAL["P_s"], motor_speed=math.nan, stall_current=math.nan,
        arm={"hydraulic": hydraulic.NOMINAL["arm"], "simple": hydraulic.NOMINAL["arm"]},
        valve_gain=lambda technology, solid, omega: valve_gain(technology, solid, omega, dt),
    )


def blocks(scenario, loads, others, dt):
    """Return [(section, module, p, x0, lane names)] of all actuators: servos first. `others` maps the other surfaces to their trim."""
    technology = scenario.elevator.technology
    out = []
    for name, make in {"hydraulic": hydraulic_blocks}.items():
        lanes = tuple(s for s in SEGMENTS if technology[s] == name)
        if lanes:
            out += [(*b, lanes) for b in make(lanes, scenario, loads, dt)]
    lanes = tuple(s for s in SEGMENTS if technology[s] == "simple") + tuple(others)
    trim = np.array([loads[s][0] if s in loads else others[s] for s in lanes])
    p = stack([simple.params(s if s in others else "elevator") for s in lanes])
    out.append(("simple", simple, p, simple.init_at(p, trim), lanes))
    return out
