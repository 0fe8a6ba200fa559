"""What the numbers of a recording prove of its units and signs: Mach, speeds and altitude together, gravity in the body
axes, a rate against the derivative of its angle, the elevator against the pitching motion that follows it."""

import itertools
from collections.abc import Mapping

import numpy as np

from actuators.constants import G0, M_PER_FT, M_S_PER_KT, RAD_PER_DEG
from cosim.replay.units import factors

SPEEDS = {"m/s": 1.0, "kt": M_S_PER_KT, "ft/s": M_PER_FT, "km/h": 1.0 / 3.6}
HEIGHTS = {"m": 1.0, "ft": M_PER_FT}
ANGLES = {"rad": 1.0, "deg": RAD_PER_DEG}
FITS = 0.04  # relative error of the air data up to which units are taken for proved: other air than standard is in it
CLEAR = 2.0  # so many times worse is the next best that says something else
LEVELS = np.arange(-500.0, 15001.0, 250.0)[:, None]  # altitudes of a file that has none [m]
SPAN_S = 0.5  # over which an angle's change is compared with its rate: a sample's noise is small beside it
MOST_G = 9.0  # of a manned or small aircraft
MOST_OFF = 0.12  # rad between attitude less angle of attack and the path: the vane's error and the wind are smaller
# g per rad of angle of attack: 1 g at stall's 0.3 rad, sixteen times as much at four times the speed
LIFT = (2.5, 80.0)
PITCHING = (0.35, 15.0)  # 1/s2, pitch acceleration per angle of the elevator: large transports to small jets
GRAVITY = {"g": 1.0, "m/s2": 1.0 / G0, "ft/s2": M_PER_FT / G0}


def air(columns: Mapping[str, np.ndarray]) -> dict[str, list[str]]:
    """Return {tas, cas or h_baro: the units that Mach number and all others allow, best first} of those of `columns`.

    One unit is proved, a unit that is not listed is refuted. Without an altitude it is what fits best at each sample.
    {} where the columns cannot be judged, or no units agree (standard atmosphere, FITS).
    """
    mach = columns.get("mach")
    speeds = [name for name in ("tas", "cas") if name in columns]
    if mach is None or not speeds:
        return {}
    n = min(len(y) for y in columns.values())
    rows = np.isfinite(np.array([y[:n] for y in columns.values()])).all(axis=0) & (mach[:n] > 0.1)
    if rows.sum() < 10:
        return {}
    data = {name: y[:n][rows][:: max(1, rows.sum() // 500)] for name, y in columns.items()}
    own = "h_baro" in data
    found = []
    for units in itertools.product(HEIGHTS if own else ("",), *(SPEEDS for _ in speeds)):
        h = data["h_baro"] * HEIGHTS[units[0]] if own else LEVELS
        found.append((_error(data, h, dict(zip(speeds, units[1:]))), units))
    error, best = min(found)
    if error >= FITS:
        return {}
    out: dict[str, list[str]] = {}
    for i, name in enumerate(("h_baro", *speeds)):
        each: dict[str, float] = {}
        for e, units in found:
            each[units[i]] = min(e, each.get(units[i], np.inf))
        if best[i]:
            out[name] = [u for u in sorted(each, key=lambda u: each[u]) if each[u] <= max(CLEAR * error, FITS)]
    return out


def _error(data, h, units):
    """Return the median relative error of the speeds that Mach number and altitude ask for: `h` [m] (samples,), or
    (levels, 1) of which the best counts at each sample."""
    if not (np.abs(h) < 25e3).all():
        return np.inf
    kelvin = _kelvin(h)
    mach, errors = data["mach"], []
    if "tas" in units:
        errors.append(data["tas"] * SPEEDS[units["tas"]] / (mach * 20.0468 * np.sqrt(kelvin)) - 1.0)
    if "cas" in units:
        impact = _static(h) * ((1.0 + 0.2 * mach * mach) ** 3.5 - 1.0)
        asked = 340.294 * np.sqrt(5.0 * ((1.0 + impact) ** (2.0 / 7.0) - 1.0))
        errors.append(data["cas"] * SPEEDS[units["cas"]] / asked - 1.0)
    worst = np.max(np.abs(errors), axis=0)
    return float(np.median(worst if worst.ndim == 1 else worst.min(axis=0)))


def airspeed(h: np.ndarray, *, cas: np.ndarray | None = None, mach: np.ndarray | None = None) -> np.ndarray:
    """Return the true airspeed [m/s] of a calibrated one [m/s] or a Mach number at the pressure altitude `h` [m] in the
    standard atmosphere."""
    if mach is None:
        impact = (1.0 + 0.2 * (np.asarray(cas) / 340.294) ** 2) ** 3.5 - 1.0
        mach = np.sqrt(5.0 * ((1.0 + impact / _static(h)) ** (2.0 / 7.0) - 1.0))
    return mach * 20.0468 * np.sqrt(_kelvin(h))


def _kelvin(h):
    return np.maximum(288.15 - 0.0065 * h, 216.65)


def _static(h):
    """Return the standard atmosphere's pressure over that at sea level."""
    return (_kelvin(h) / 288.15) ** 5.25588 * np.exp(-np.maximum(h - 11000.0, 0.0) / 6341.62)


def path_units(t: np.ndarray, theta: np.ndarray, alpha: np.ndarray, path: np.ndarray) -> list[tuple[str, str]]:
    """Return the units (of theta, of alpha) that theta - alpha = `path`, the climb angle [rad] of level wings, allows;
    all four where it says nothing."""
    both = list(itertools.product(ANGLES, ANGLES))
    theta, alpha, path = (_slow(t, y) for y in (theta, alpha, path))
    good = np.isfinite(theta) & np.isfinite(alpha) & np.isfinite(path)
    if good.sum() < 20:
        return both
    theta, alpha, path = theta[good], alpha[good], path[good]
    gap = {(a, b): theta * ANGLES[a] - alpha * ANGLES[b] - path for a, b in both}
    left = [u for u in both if float(np.sqrt(np.mean(gap[u] ** 2))) < MOST_OFF]
    same = _proved(_line(theta - alpha, path), ANGLES, 0.5, 2.0, 0.8)
    return [u for u in left if u == (same, same)] or left or both


def lift_unit(alpha: np.ndarray, n_z: np.ndarray) -> str:
    """Return the unit of an angle of attack by the lift, n_z [g], that it makes; "" where none is proved."""
    return _proved(_line(_smooth(alpha), _smooth(n_z)), ANGLES, *LIFT, 0.6)


def turn_unit(t: np.ndarray, q: np.ndarray, speed: np.ndarray, n_z: np.ndarray | None) -> str:
    """Return the unit of a pitch rate by the load V q / g that it makes at the airspeed `speed` [m/s], beside n_z [g];
    "" where none is proved."""
    per = float(np.nanmedian(speed)) / G0 if np.isfinite(speed).any() else 0.0
    if np.nanpercentile(np.abs(q), 99.0) * per > MOST_G:
        return "deg/s"
    if n_z is None or len(t) < 50 or per < 1.0:
        return ""
    return _proved(_line(_slow(t, q), _slow(t, n_z)), {"rad/s": per, "deg/s": per * RAD_PER_DEG}, 0.4, 2.5, 0.6)


def gravity(y: np.ndarray) -> tuple[str, int, float, str, bool] | None:
    """Return (unit, sign, offset, why, whether that is a proof) of a load factor along the vertical body axis by the
    gravity in it, None if none."""
    middle = float(np.nanmedian(y)) if np.isfinite(y).any() else np.nan
    for unit, factor in GRAVITY.items():
        if abs(abs(middle) * factor - 1.0) < 0.12:
            return unit, 1 if middle > 0.0 else -1, 0.0, "gravity is in it", True
    if abs(middle) < 0.12 and 0.002 < np.nanstd(y) < 1.0:
        return "g", 1, 1.0, "about 0 in level flight: without gravity's 1", False
    if MOST_G < np.nanmax(np.abs(y), initial=0.0) < MOST_G / GRAVITY["m/s2"] and abs(np.nanmean(y)) > 2.0:
        return "m/s2", 1 if np.nanmean(y) > 0.0 else -1, 0.0, "too large for g, and gravity in its mean", False
    return None


def rate(t: np.ndarray, y: np.ndarray, angle: np.ndarray) -> tuple[float, float]:
    """Return (slope, correlation) of a rate's mean over SPAN_S, five samples at least, over the change of its angle in
    it per second, 0 where one of them does not move."""
    if len(t) < 21 or not (np.diff(t) > 0.0).all():
        return 0.0, 0.0
    n = max(5, round(SPAN_S / float(np.median(np.diff(t)))))
    if n >= len(t):
        return 0.0, 0.0
    mean = np.convolve(0.5 * (y[1:] + y[:-1]), np.ones(n) / n, "valid")  # of the trapezia between the samples
    return _line((angle[n:] - angle[:-n]) / (t[n:] - t[:-n]), mean)


def rate_unit(t: np.ndarray, y: np.ndarray, angle: np.ndarray, unit: str) -> tuple[str, int]:
    """Return (unit, sign) of a rate whose angle is in `unit`; unit "" where the numbers prove none."""
    turns, good = np.array(angle, float), np.isfinite(angle)
    turns[good] = np.unwrap(turns[good], period=2.0 * np.pi if unit == "rad" else 360.0)
    slope, r = rate(t, y, turns)
    per_rad = abs(slope) / ANGLES[unit]
    units = {"rad/s": 1.0, "deg/s": 1.0 / RAD_PER_DEG}
    return _proved((per_rad, abs(r)), units, 0.75, 1.33, 0.8), -1 if slope < 0.0 else 1


def climb_unit(t: np.ndarray, y: np.ndarray, h: np.ndarray, unit: str) -> str:
    """Return the unit of a vertical speed beside an altitude in `unit`, "" where the numbers prove none."""
    slope, r = rate(t, y, h)
    units = {"m/s": 1.0, "ft/s": 1.0 / M_PER_FT, "ft/min": 60.0 / M_PER_FT, "kt": 1.0 / M_S_PER_KT}
    return _proved((slope / factors("m")[unit], r), units, 0.8, 1.25, 0.6)


def attitude_unit(t: np.ndarray, theta: np.ndarray, n_x: np.ndarray, speed: np.ndarray) -> str:
    """Return the unit of the pitch angle by n_x [g] = sin(theta) + V' / g, V = `speed` [m/s]; "" if none is proved."""
    if len(t) < 50 or not (np.diff(t) > 0.0).all():
        return ""
    left = n_x - np.gradient(_smooth(_smooth(speed)), t) / G0
    return _proved(_line(_slow(t, theta), _slow(t, left)), ANGLES, 0.5, 2.0, 0.8)


def elevator(t: np.ndarray, de: np.ndarray, q: np.ndarray) -> tuple[float, float]:
    """Return (slope, correlation) of the pitch acceleration over a deflection, without what is slow; negative where
    trailing edge down is +."""
    rate_of_q = np.gradient(q, t) if len(t) > 20 and (np.diff(t) > 0.0).all() else np.zeros(len(t))
    a, b = _smooth(rate_of_q), _smooth(de)
    a, b = (y[np.isfinite(a) & np.isfinite(b)] for y in (a, b))
    if len(a) < 20:
        return 0.0, 0.0
    slow = max(3, int(4.0 / max(float(np.median(np.diff(t))), 1e-3)))
    b = b - np.convolve(np.pad(b, slow, mode="edge"), np.ones(2 * slow + 1) / (2 * slow + 1), "valid")
    return _line(b, a)


def elevator_unit(slope: float, r: float) -> str:
    """Return the unit of a deflection by the pitch acceleration [rad/s2] that one of it makes, `slope`, and their
    correlation `r`; "" where none is proved."""
    return _proved((abs(slope), abs(r)), ANGLES, *PITCHING, 0.3)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Return the correlation of two columns where both are finite, 0 where one of them does not move."""
    return _line(a, b)[1]


def _line(a, b):
    """Return (slope, correlation) of b over a where both are finite, 0 where one of them does not move."""
    good = np.isfinite(a) & np.isfinite(b)
    if good.sum() < 20 or not np.std(a[good]) or not np.std(b[good]):
        return 0.0, 0.0
    a, b = a[good] - a[good].mean(), b[good] - b[good].mean()
    return float(a @ b / (a @ a)), float(a @ b / np.sqrt((a @ a) * (b @ b)))


def _proved(line, units, low, high, least):
    """Return the unit {name: slope} that `line`, a slope and its correlation, is near to, "" for none."""
    slope, r = line
    return next((u for u, s in units.items() if low < slope / s < high), "") if r >= least else ""


def _slow(t, y):
    """Return the mean over two seconds, without what the ends lack."""
    n = max(1, int(2.0 / max(float(np.median(np.diff(t))), 1e-3)))
    return np.convolve(y, np.ones(n) / n, "valid") if n < len(y) else np.empty(0)


def _smooth(y):
    """Return the mean of five samples."""
    return np.convolve(np.pad(np.asarray(y, float), 2, mode="edge"), np.ones(5) / 5.0, "valid")
