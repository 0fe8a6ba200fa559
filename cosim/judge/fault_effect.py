"""Effect of a fault, in numbers.

On its elevator, as the difference of a flight and its reference without the fault:

    peak        largest |d| while a fault on the segment is active and 1 s afterwards
    amplitude   of an oscillation: of the least-squares sine at the fault's frequency over the settled whole periods

On the aircraft (load factor, altitude, bank, speed, hinge load, time out of bounds), from the onset of the first fault
to the end of the flight, altitude, bank and speed against their values at the onset. The flight itself is measured, not
its difference from one without the fault: gusts and manoeuvres count.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from actuators.common.linkage import ARM
from actuators.constants import DEG_PER_RAD, M_S_PER_KT

SETTLE_PERIODS = 2.0
MOST = 1 << 18  # ticks of a fit: it takes 150 bytes of memory each
MOVED = 1e-3  # of rod from where it would be, from when on a fault can be seen at all [m]
NAMES = ("rod_mm", "surface_deg", "travel_pct", "amplitude_mm", "amplitude_deg")
MOTION = ("nz", "h", "phi", "cas", "alpha")  # fields of the truth that `consequences` takes
LOAD_FACTOR = (-1.0, 2.5)  # limit manoeuvring load factors of a transport, clean (CS 25.337) [g]
BANK = math.radians(67.0)  # full stick holds this bank in the laws of today's transports [rad]
ALPHA = math.radians(-10.0), math.radians(20.0)  # beyond it nothing is tested [rad]
CONSEQUENCES = (
    *("nz_min_g", "nz_max_g", "altitude_lost_m", "bank_deg"),
    *("speed_lost_kt", "speed_gained_kt", "hinge_max_nm", "outside_s"),
)


def sine(t: NDArray, y: NDArray, w: float) -> complex:
    """Return the complex amplitude c of Re(c exp(i w t)) in y (n,) at times t (n,) [s], by least squares. A constant
    and a slope are fitted beside the sine of `w` [rad/s], so that a slow change of y does not count."""
    basis = np.stack([np.cos(w * t), np.sin(w * t), np.ones_like(t), t - t[0]], 1)
    c = np.linalg.lstsq(basis, y, rcond=None)[0]
    return c[0] - 1j * c[1]


def amplitude(d: NDArray, w: float, start: float, end: float, dt: float) -> float | None:
    """Return the amplitude of the sine of `w` [rad/s] in d (ticks,), in its unit; None when no whole period is left.
    Taken over the last whole periods, MOST ticks of them, of [start + SETTLE_PERIODS periods, end] [s]."""
    period = 2 * math.pi / w
    first = round((start + SETTLE_PERIODS * period) / dt)
    longest = math.floor(MOST * dt / period) or 1
    last = min(len(d), round(min(end, len(d) * dt) / dt))
    whole = min(longest, math.floor((last - first) * dt / period + 1e-9))
    if whole < 1:
        return None
    cut = d[last - round(whole * period / dt) : last]
    return float(abs(sine(np.arange(len(cut)) * dt, cut, w))) if np.isfinite(cut).all() else None


def moved(difference: NDArray, faults: Sequence, dt: float, travel: float) -> dict[str, float | None]:
    """Return {name of NAMES: value or None} of one segment, and `moved_at_s`, when it was first MOVED of rod away [s].

    `difference` (ticks, 2) is rod [m], NaN where there is none, and surface [rad], each less that of the flight without
    the faults; `faults` are the injections on the segment (cosim/flight/faults/inject.py), `travel` is the elevator's
    [rad].
    """
    start, end = min(j.start for j in faults), max(j.end for j in faults) + 1.0
    first, last = round(start / dt), len(difference) if math.isinf(end) else round(end / dt)
    rod, surface = (_largest(d) for d in difference[first:last].T)
    s = next((j for j in faults if math.isfinite(j.omega) and j.shape != "chirp"), None)
    swing = [amplitude(d, s.omega, s.start + s.ramp, s.end, dt) if s else None for d in difference.T]
    deg = DEG_PER_RAD
    values = (rod, surface, surface, *swing)
    sizes = {n: None if v is None else v * k for n, v, k in zip(NAMES, values, (1e3, deg, 100 / travel, 1e3, deg))}
    known = np.isfinite(difference[:, 0]).all()  # else by the surface's share of the rod
    away = np.flatnonzero(np.abs(difference[first:, 0] if known else ARM * difference[first:, 1]) >= MOVED)
    return sizes | {"moved_at_s": float((first + away[0]) * dt) if len(away) else None}


def largest(segments: dict[str, dict] | None) -> dict[str, float | None]:
    """Return {name of NAMES: largest over the segments of `moved`}, None where no segment has a value."""
    given = {name: [s[name] for s in (segments or {}).values() if s[name] is not None] for name in NAMES}
    return {name: max(values, default=None) for name, values in given.items()}


def _largest(d):
    """Return the largest magnitude, None where there is none or one is not finite."""
    return float(np.max(np.abs(d))) if len(d) and np.isfinite(d).all() else None


def consequences(
    motion: Mapping[str, NDArray], hinge: Iterable[NDArray], dt: float, cas: tuple[float, float]
) -> dict[str, float] | None:
    """Return {name of CONSEQUENCES: value} of a flight from its first onset on; None where it ends before.

    `motion` are the fields of MOTION (ticks,), SI, n_z in g; `hinge` the moments of each elevator segment (ticks,)
    [N m]. `cas` is the lowest and the highest speed of the envelope [m/s]; `dt` [s]. altitude_lost_m, bank_deg,
    speed_lost_kt and speed_gained_kt are largest excursions from the onset, not below zero.
    """
    if not len(motion["nz"]):
        return None
    largest_moment = max(float(np.abs(moment).max()) for moment in hinge)
    bounds = {"nz": LOAD_FACTOR, "phi": (-BANK, BANK), "alpha": ALPHA, "cas": cas}
    outside = [(motion[n] < np.float64(low)) | (motion[n] > np.float64(high)) for n, (low, high) in bounds.items()]
    low, high, begin = ({n: float(of(motion[n])) for n in MOTION} for of in (np.min, np.max, lambda v: v[0]))
    values = (
        *(low["nz"], high["nz"], begin["h"] - low["h"]),
        math.degrees(max(high["phi"] - begin["phi"], begin["phi"] - low["phi"])),
        *((begin["cas"] - low["cas"]) / M_S_PER_KT, (high["cas"] - begin["cas"]) / M_S_PER_KT),
        *(largest_moment, np.any(outside, axis=0).sum() * dt),
    )
    return {name: float(value) for name, value in zip(CONSEQUENCES, values)}
