"""The response of an actuator to its command, by output error: parameters, intervals, goodness of fit.

The model is the block of actuators/simple/identified.py, which flies as it was fitted. Its output, less a constant
error of the sensor, is held against the measured position; `scipy.optimize.least_squares` finds the parameters, and
the position from which the motion begins: within a dead band it stands wherever it was. An interval is that of the
profile likelihood (Bates and Watts, Nonlinear Regression Analysis, 6.1): the values v of a parameter for which

    S(v) - S_min <= s^2 t^2,    S(v) the least sum of squares with it at v, all others fitted anew

t of Student's law, s^2 widened by the correlation time of what is left where the model does not make it white.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from actuators.common import linkage
from actuators.simple import identified

NAMES = ("omega", "zeta", "rate", "dead_band", "delay", "bias")
NONNEGATIVE = ("dead_band", "delay")
DELAY, RATE = NAMES.index("delay"), NAMES.index("rate")
DELTA, NONE = np.array([identified.STATE.names.index("delta")]), np.zeros(0, int)
UNITS = {"omega": "rad/s", "zeta": "-", "rate": "rad/s", "dead_band": "rad", "delay": "s", "bias": "rad"}
MEANINGS = {
    "omega": "bandwidth (natural frequency)", "zeta": "damping", "rate": "rate limit",
    "dead_band": "dead band, to either side", "delay": "dead time from command to reading",
    "bias": "constant error of the reading",
}  # fmt: skip
SURE = 0.999  # of the test whether a rate limit was reached
ROUNDS = 5  # of profiles at most, each from the best fit that the one before came upon
TICKS = 6  # of dead time to either side of a fit that are searched
FIRST = 9  # readings of which the mean says where the motion begins
SETTLE_S = 0.5  # at the start, where the motion before it is not known


@dataclass(frozen=True)
class Parameter:
    """A parameter with its interval; `low` alone is known where `value` is NaN. Units are those of UNITS."""

    value: float
    low: float
    high: float
    note: str = ""


@dataclass
class Response:
    """What a command and a position say of the actuator between them."""

    parameters: dict[str, Parameter] = field(default_factory=dict)
    fit_pct: float = math.nan  # 100 (1 - |residual| / |position less its mean|)
    residual: float = math.nan  # standard deviation [rad]
    correlation: float = math.nan  # samples over which the residual is correlated: 1 for white
    note: str = ""

    def values(self) -> dict[str, float]:
        """Return the numbers with which the actuator flies; a rate limit that was not reached is the nominal one, or
        what was seen where that is more."""
        known = {n: p.value for n, p in self.parameters.items() if n != "bias"}
        if "rate" in known and not math.isfinite(known["rate"]):
            known["rate"] = max(linkage.RATE, self.parameters["rate"].low)
        return known


def unknown(why: str) -> Response:
    """Return the Response of which nothing is known."""
    return Response(note=f"not identifiable: {why}")


def asleep(command: np.ndarray, moved: np.ndarray, sent: str, read: str) -> tuple[float, str]:
    """Return (noise of the reading `moved`, by its third differences, "" or why nothing can be told of it)."""
    noise = float(np.std(np.diff(moved, 3)) / math.sqrt(20.0))
    if float(np.std(command)) == 0.0:
        return noise, f"the {sent} is constant"
    still = float(np.std(moved)) <= 3.0 * noise
    return noise, f"the {read} moves by less than three times its noise" if still else ""


def simulate(command: np.ndarray, start: float, dt: float, stops: tuple[float, float], **values: float) -> np.ndarray:
    """Return the surface (ticks,) [rad] that follows `command` (ticks,) from rest at `start`, each before its tick."""
    p = identified.params(lo=stops[0], hi=stops[1], **values)
    u = np.zeros((1, len(command)), identified.INPUTS)
    u["command"] = command
    moved, _ = identified.rollout.sweep(identified.init_at(p, start), u, p, dt, DELTA, NONE, NONE)
    return np.concatenate([[start], moved[:-1, 0]])


def respond(command: np.ndarray, surface: np.ndarray, dt: float, level: float = 0.95) -> Response:
    """Return the Response of `surface` to `command` ((ticks,), finite [rad], every `dt` seconds)."""
    skip, moves = round(SETTLE_S / dt), float(np.std(surface))
    if len(surface) < 4 * skip:
        return unknown(f"{len(surface) * dt:.3g} s are too short")
    noise, why = asleep(command, surface, "command", "position")
    if why:
        return unknown(why)
    reach = 0.1 + max(np.abs(command).max(), np.abs(surface).max())
    stops = (-reach, reach)
    smooth = np.convolve(surface, np.ones(9) / 9.0, "valid")
    fastest = float(np.abs(smooth[8:] - smooth[:-8]).max() / (8.0 * dt))
    most_delay = (identified.PAST - 4) * dt
    # the motion begins where the first readings say, within their noise and spread
    first, about = float(np.mean(surface[:FIRST])), 6.0 * noise + float(np.ptp(surface[:FIRST])) + 1e-6 * moves
    low = np.array([0.5, 0.2, 0.02 * fastest, 0.0, 0.0, -1.0, -about])
    high = np.array([1.0 / dt, 4.0, 20.0 * fastest, 0.2 * np.ptp(surface), most_delay, 1.0, about])
    size = np.array([20.0, 1.0, fastest, 0.02 * np.ptp(surface), 4.0 * dt, 0.1 * moves, about])

    def left(z):
        values = dict(zip(NAMES, z * size))
        bias, start = values.pop("bias"), first + float(z[-1] * size[-1])
        return (simulate(command, start - bias, dt, stops, **values) + bias - surface)[skip:]

    bounds = low / size, high / size
    offset = float(np.mean(surface - command))
    begin = [(w, d * dt) for w in (8.0, 25.0, 60.0) for d in (1.0, 6.0, 20.0)]
    starts = [np.array([w, 0.9, 1.2 * fastest, 0.5 * size[3], late, offset, 0.0]) for w, late in begin]
    starts = sorted((np.clip(s, low * 1.001, high * 0.999) / size for s in starts), key=lambda z: left(z) @ left(z))
    found = min((_fit(left, z, bounds) for z in starts[:3]), key=lambda f: f.cost)
    free = _fixed(left, found.x, RATE, bounds[1][RATE], bounds, 50)  # as if it had no limit
    both = found, _fit(left, np.insert(free.x, RATE, 1.5), bounds)
    found = min((_within_ticks(left, f, bounds, dt / size[DELAY]) for f in both), key=lambda f: f.cost)
    return _told(found, left, size, bounds, moves, level)


def _fit(left, x, bounds, **how):
    """Return the fit of all parameters within bounds, from x."""
    start = np.clip(x, bounds[0] + 1e-12, bounds[1] - 1e-12)
    return least_squares(left, start, bounds=bounds, diff_step=1e-4, x_scale="jac", **how)


def _within_ticks(left, found, bounds, tick):
    """Return the best fit whose dead time is held within one tick, of those up to TICKS from that of `found`: the sum
    of squares bends where the dead time is a whole number of ticks, and a descent stops at a bend. Each begins at its
    neighbour's."""
    best, here = found, int(found.x[DELAY] / tick)
    for side in (1, -1):
        x = found.x
        for k in range(here, here + side * (TICKS + 1), side):
            low, high = bounds[0].copy(), bounds[1].copy()
            low[DELAY], high[DELAY] = max(low[DELAY], k * tick), min(high[DELAY], (k + 1) * tick)
            if low[DELAY] >= high[DELAY]:
                break
            middle = 0.5 * (low[DELAY] + high[DELAY])
            start = np.insert(_fixed(left, x, DELAY, middle, bounds, 25).x, DELAY, middle)
            fit = _fit(left, start, (low, high))
            best, x = min(best, fit, key=lambda f: f.cost), fit.x
    return best


def _fixed(left, x, i, value, bounds, most):
    """Return the fit of all parameters but number i, which has `value`, from x."""
    within = np.delete(bounds[0], i), np.delete(bounds[1], i)
    return _fit(lambda z: left(np.insert(z, i, value)), np.delete(x, i), within, max_nfev=most)


def _told(found, left, size, bounds, moves, level):
    for _ in range(ROUNDS):
        e = found.fun
        lower: list[np.ndarray] = []
        variance, spread = float(e @ e) / (len(e) - len(size)), correlation(e)
        most = float(student.ppf(0.5 + level / 2.0, max(len(e) / spread - len(size), 1.0)))
        how = (left, found, bounds, variance * spread, most, lower)
        ends = [(_end(i, -1, *how), _end(i, 1, *how)) for i in range(len(NAMES))]
        if not lower:
            break
        best = min(lower, key=lambda z: left(z) @ left(z))  # a profile found its way past a bend
        found = _fit(left, best, bounds)
    out = Response(fit_pct=100.0 * (1.0 - float(np.std(e)) / moves), residual=math.sqrt(variance), correlation=spread)
    without = _fixed(left, found.x, RATE, bounds[1][RATE], bounds, 50)  # as if it had no limit
    reached = 2.0 * (without.cost - found.cost) > variance * spread * float(chi2.ppf(SURE, 1))
    for i, (name, (a, b)) in enumerate(zip(NAMES, ends)):
        value, unit, note = float(found.x[i]), float(size[i]), ""
        if name == "rate" and not reached:
            value, b, note = math.nan, math.inf, "never reached: at least this"
        elif name in NONNEGATIVE and a <= 0.0:
            note = "down to none"
        out.parameters[name] = Parameter(value * unit, a * unit, b * unit, note)
    return out


def _end(i, side, left, found, bounds, variance, most, lower):
    """Return the lower (`side` -1) or upper end (1) of the profile interval of parameter i: where the root of the rise
    of the least sum of squares over `variance` is `most`, all others fitted anew; the bound where it never is.
    `lower` takes the parameters of what is a better fit than `found`."""
    edge, x = float(bounds[max(side, 0)][i]), found.x

    def over(v):
        fit = _fixed(left, x, i, v, bounds, 20)
        if 2.0 * (found.cost - fit.cost) > 0.05 * variance:
            lower.append(np.insert(fit.x, i, v))
        return math.sqrt(max(2.0 * (fit.cost - found.cost), 0.0) / variance) - most

    near, step = float(x[i]), max(1e-4, 0.005 * float(x[i]))
    while near != edge and not lower:
        far = max(near - step, edge) if side < 0 else min(near + step, edge)
        if over(far) > 0.0:
            return float(brentq(over, near, far, xtol=0.01 * abs(far - x[i]), maxiter=20, disp=False))
        near, step = far, 2.0 * step
    return edge


def correlation(e: np.ndarray) -> float:
    """Return the integrated correlation time of residuals e (n,) in samples, 1 at least: up to its first zero."""
    spectrum = np.abs(np.fft.rfft(e - e.mean(), 2 * len(e))) ** 2
    rho = np.fft.irfft(spectrum)[: len(e) // 2]
    rho = rho / rho[0] if rho[0] > 0.0 else rho
    below = np.flatnonzero(rho < 2.0 / math.sqrt(len(e)))
    end = int(below[0]) if len(below) else len(rho)
    return max(1.0, 1.0 + 2.0 * float(rho[1:end].sum()))
