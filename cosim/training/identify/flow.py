"""The flow of a servo-valve into a cylinder, from the valve's command, the rod and, where it is measured, the pressure.

    q(t) = q_0 + g int w u' dt - L int x3 dt - c x3 + d t,
    w = sqrt(1 - sign(u') x3),    u' = u(t - delay) less a dead band

is equation (4) of [Lu17] divided by its stiffness and integrated: g = phi_n / A_p is the area ratio of valve and piston
times the valve's flow [m/s], L the leakage [m/s], c = 1 / stiffness the oil's give [m]; d and a share of int |u'| dt
take up a constant error of the pressure sensor. L and c are fitted but not told: the noise of the pressure, a
regressor, biases both. Without a pressure w is 1 and g that of the flow under load.
"""

import math

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
from scipy.stats import t as student

from cosim.training.identify.response import Parameter, Response, asleep, correlation, unknown

UNITS = {"flow_gain": "m/s", "dead_band": "-", "delay": "s"}
PARTS = 6
# of the gain: taking the pressure at the ends of a tick is off by so much on recordings of the testbed, whose gain is
# known; no part of a recording tells it from the gain
MODEL = 0.005
SMOOTH = 11  # samples over which the pressure is smoothed: its noise would bias c


def flow(u: np.ndarray, rod: np.ndarray, x3: np.ndarray | None, dt: float, level: float = 0.95) -> Response:
    """Return the Response of `rod` [m] to the valve command `u` [1] sent at each tick, pressure `x3` [1] or None.

    The interval of a gain is widened until PARTS of the recording, fitted apart, agree with the whole (Birge's ratio):
    the pressure's noise is in a regressor, and the oil's stiffness changes over the stroke.
    """
    whole = _fit(u, rod, x3, dt, level)
    size = len(u) // PARTS
    cuts = [slice(k * size, (k + 1) * size) for k in range(PARTS)] if size > 20 * len(UNITS) else []
    parts = [_fit(u[c], rod[c], None if x3 is None else x3[c], dt, level) for c in cuts] if whole.parameters else []
    for name, p in whole.parameters.items():
        own = [part.parameters[name] for part in parts if name in part.parameters]
        z = [(o.value - p.value) / max(0.5 * (o.high - o.low), 1e-300) for o in own]
        if len(z) > 1:
            wide = max(1.0, float(student.ppf(0.5 + level / 2.0, len(z) - 1)) * float(np.sqrt(np.mean(np.square(z)))))
            low, high = p.value - wide * (p.value - p.low), p.value + wide * (p.high - p.value)
            note = "down to none" if name in ("dead_band", "delay") and low <= 0.0 else p.note
            floor = 0.0 if name in ("dead_band", "delay") else -math.inf
            whole.parameters[name] = Parameter(p.value, max(low, floor), high, note)
    if p := whole.parameters.get("flow_gain"):
        more = MODEL * abs(p.value)
        whole.parameters["flow_gain"] = Parameter(p.value, p.low - more, p.high + more, p.note)
    return whole


def _fit(u, rod, x3, dt, level):
    if why := asleep(u, rod, "valve command", "rod")[1]:
        return unknown(why)
    n, tick = len(u), np.arange(len(u))
    z = np.zeros(n) if x3 is None else savgol_filter(x3, SMOOTH, 3)
    middle = 0.5 * (z + np.append(z[1:], z[-1:]))  # over the tick in which a command acts
    leak = np.concatenate([[0.0], np.cumsum(0.5 * (z[1:] + z[:-1]))]) * dt
    nuisance = [np.ones(n), tick * dt]
    linear = [*nuisance, *([] if x3 is None else [-leak, -z])]

    def columns(dead, late):
        whole, part = int(late), late - int(late)
        v = np.concatenate([np.full(whole + 1, u[0]), u])
        acted = (1.0 - part) * v[1 : n + 1] + part * v[:n]
        acted = acted - np.clip(acted, -dead, dead)
        drive = np.sqrt(np.clip(1.0 - np.sign(acted) * middle, 0.0, 2.0)) * acted
        driven = [drive] if x3 is None else [drive, np.abs(acted)]  # a pressure off by b: -b/2 |u'| in w u'
        own = [np.concatenate([[0.0], np.cumsum(d[:-1])]) * dt for d in driven]
        return np.column_stack([*own, *linear])

    def left(free):
        A = columns(free[0] * size[0], free[1])
        return A @ np.linalg.lstsq(A, rod, rcond=None)[0] - rod

    size = np.array([0.1 * float(np.abs(u).max()), 1.0])
    starts = [np.array([0.01, late]) for late in range(12)]
    low, high = np.zeros(2), np.array([5.0, 40.0])
    best = sorted(starts, key=lambda f: float(left(f) @ left(f)))[:2]
    found = min((least_squares(left, f, bounds=(low, high), diff_step=1e-3) for f in best), key=lambda f: f.cost)
    A = columns(found.x[0] * size[0], found.x[1])
    gains, e = np.linalg.lstsq(A, rod, rcond=None)[0], found.fun
    full = [_slope(columns, gains, found.x, size, k) for k in (0, 1)]
    J = np.column_stack([A, *full])
    far = np.linalg.norm(J, axis=0)
    far[far == 0.0] = 1.0
    spread = correlation(e)
    variance = float(e @ e) / (n - J.shape[1])
    deviation = np.sqrt(np.diag(np.linalg.pinv((J / far).T @ (J / far))) * variance * spread) / far
    half = float(student.ppf(0.5 + level / 2.0, max(n / spread - J.shape[1], 1.0))) * deviation
    out = Response(fit_pct=100.0 * (1.0 - float(np.std(e) / np.std(rod))), residual=math.sqrt(variance))
    out.correlation = spread
    g = float(gains[0])
    out.parameters["flow_gain"] = Parameter(g, g - float(half[0]), g + float(half[0]))
    for name, k, unit in (("dead_band", 0, size[0]), ("delay", 1, dt)):
        value, width = found.x[k] * unit, half[A.shape[1] + k] * unit
        note = "down to none" if value <= width else ""
        out.parameters[name] = Parameter(float(value), float(max(value - width, 0.0)), float(value + width), note)
    return out


def _slope(columns, gains, x, size, k):
    """Return the derivative of the rod over dead band or delay number k, in that unit's size."""
    h = 1e-3
    up, down = np.array(x), np.array(x)
    up[k], down[k] = x[k] + h, max(x[k] - h, 0.0)
    rise = columns(up[0] * size[0], up[1]) - columns(down[0] * size[0], down[1])
    return rise @ gains / (up[k] - down[k])
