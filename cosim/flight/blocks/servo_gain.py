"""Gain of the closed servo loop, flown: from millimetres of rod to the valve's or drive's unit."""

import functools
import math

import numpy as np

from actuators.common import linkage
from actuators.deterministic_linalg import rounded
from actuators.kernels import cached_array
from actuators.technology import Own
from cosim.scenario.catalog import TECHNOLOGIES

SENSOR_DELAY = 0.005  # of an actuator's sensors [s]


def sensor_age(dt: float) -> float:
    """Return the whole ticks by which an actuator's sensors lag: 0 below 100 Hz and at it, 1 at 200 Hz."""
    return float(round(SENSOR_DELAY / dt))


@functools.cache
def liquid_gain(technology: str, omega: float, dt: float, own: Own = ()) -> float:
    """Return position amplitude [m] per unit added at the valve [1] or drive [A], servo closed, no load, no friction:
    by flying it at `omega` [rad/s]. `own` is what an aircraft's actuators differ in."""
    given = technology, float(omega), float(dt), tuple(own)
    return float(cached_array(given, float, lambda: np.array([_flown(*given)]), __file__)[0])


def _flown(technology, omega, dt, own):
    record = TECHNOLOGIES[technology]
    design, (live, smooth), rest = record.design(own), record.smooth, np.zeros((3, 1))
    # sensor -> state that it reads, reading per unit, the servo's inputs for value and flag
    measured = {n: (s.state, design.gains.get(n, 1.0), *s.servo) for n, s in record.sensors.items() if s.servo}
    age = int(sensor_age(dt))
    (_, outer, ps, xs), (_, inner, p, x) = record.build(own, [smooth], [{}], rest, linkage.TRAVEL, dt, float(age))
    for name, value in live.items():
        ps[name] = value
    u, us = np.zeros((1, 1), inner.INPUTS), np.zeros((1, 1), outer.INPUTS)
    control, move = outer.rollout.bound(xs, us, ps, dt), inner.rollout.bound(x, u, p, dt)
    amplitude = 0.01 * design.probe
    settle = 2.0
    n = round((max(6, math.ceil(omega / math.pi)) * 2 * math.pi / omega + settle) / dt)
    t, position = np.arange(n) * dt, np.zeros(n)
    for *_, flag in measured.values():
        us[flag] = 1.0
    past = []
    for k in range(n):
        now = {name: factor * x[state][0] for name, (state, factor, *_) in measured.items()}
        position[k] = now[record.loop_sensor]
        past.append(now)
        for name, value in past[max(k - age, 0)].items():
            us[measured[name][2]] = value
        control()
        u["u"], u["f_u"] = xs["u"][0], amplitude * math.sin(omega * t[k])
        move()
    late = t > settle
    basis = np.column_stack([np.cos(omega * t), np.sin(omega * t), np.ones(n)])[late]
    c, s, _ = np.linalg.lstsq(basis, position[late], rcond=None)[0]
    return float(rounded(np.array(math.hypot(c, s) / amplitude), 9))
