"""Units of recordings: what one of each is in SI, and the ways in which people write them."""

import re
from collections.abc import Mapping

from actuators.constants import G0, M_PER_FT, M_S_PER_KT, N_M_PER_LBF_FT, N_PER_LBF, PA_PER_PSF, RAD_PER_DEG

UNITS = {  # unit -> {SI unit of the signal: factor}
    "deg": {"rad": RAD_PER_DEG},
    "deg/s": {"rad/s": RAD_PER_DEG},
    "deg/s2": {"rad/s2": RAD_PER_DEG},
    "mrad": {"rad": 1e-3},
    "mrad/s": {"rad/s": 1e-3},
    "rpm": {"rad/s": 3.141592653589793 / 30.0},
    "ft": {"m": M_PER_FT},
    "mm": {"m": 1e-3},
    "cm": {"m": 1e-2},
    "km": {"m": 1e3},
    "in": {"m": 0.0254},
    "ft/s": {"m/s": M_PER_FT},
    "ft/min": {"m/s": M_PER_FT / 60.0},
    "kt": {"m/s": M_S_PER_KT},
    "km/h": {"m/s": 1.0 / 3.6},
    "m/s2": {"g": 1.0 / G0},
    "ft/s2": {"g": M_PER_FT / G0},
    "t": {"kg": 1e3},
    "lb": {"kg": 0.45359237},
    "slug": {"kg": 14.593903},
    "%": {"-": 0.01},
    "mA": {"A": 1e-3},
    "lbf ft": {"N m": N_M_PER_LBF_FT, "N m/rad": N_M_PER_LBF_FT},
    "hPa": {"Pa": 1e2},
    "kPa": {"Pa": 1e3},
    "bar": {"Pa": 1e5},
    "MPa": {"Pa": 1e6},
    "psi": {"Pa": 144.0 * PA_PER_PSF},
    "kN": {"N": 1e3},
    "lbf": {"N": N_PER_LBF},
}
SI = ("rad", "rad/s", "rad/s2", "m", "m/s", "g", "kg", "-", "A", "N m", "N m/rad", "Pa", "N")
PER = ("/V", "/mA")  # behind a unit: the channel is in volt or milliampere, `scale` says how much one of them is
# other writings, in small letters and without spaces, as `_folded` leaves them
OTHER = {
    "°": "deg", "º": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "°/s": "deg/s", "º/s": "deg/s",
    "degs": "deg/s", "dps": "deg/s", "deg/sec": "deg/s", "grad/s": "deg/s", "°/s2": "deg/s2", "deg/sec2": "deg/s2",
    "rads": "rad/s", "rad/sec": "rad/s", "rad/sec2": "rad/s2", "radian": "rad", "radians": "rad", "mrads": "mrad/s",
    "mps": "m/s", "m/sec": "m/s", "ms-1": "m/s", "m/sec2": "m/s2", "ms-2": "m/s2", "mps2": "m/s2", "fps": "ft/s",
    "ft/sec": "ft/s", "fps2": "ft/s2", "fpm": "ft/min", "ft/minute": "ft/min", "feet": "ft", "foot": "ft", "fuß": "ft",
    "fuss": "ft", "inch": "in", "inches": "in", "zoll": "in", '"': "in", "meter": "m", "metres": "m", "metre": "m",
    "meters": "m", "kts": "kt", "knot": "kt", "knots": "kt", "knoten": "kt", "kn": "kt", "kmh": "km/h", "kph": "km/h",
    "g's": "g", "pct": "%", "percent": "%", "prozent": "%", "ma": "mA", "amp": "A", "amps": "A", "ampere": "A",
    "a": "A", "lbfft": "lbf ft", "ft-lbf": "lbf ft", "ftlbf": "lbf ft", "ft·lbf": "lbf ft", "nm": "N m", "n·m": "N m",
    "n*m": "N m", "n": "N", "pa": "Pa", "mbar": "hPa", "hpa": "hPa", "kpa": "kPa", "mpa": "MPa", "psig": "psi",
    "lbs": "lb", "kilogram": "kg", "tonne": "t", "tonnes": "t", "--": "-", "1": "-", "u/min": "rpm", "1/min": "rpm",
    "nm/rad": "N m/rad", "rev/min": "rpm", "degps": "deg/s", "radps": "rad/s",
}  # fmt: skip


def known(text: str) -> str:
    """Return the unit that a text means, or "": `deg`, `[deg]`, `(inch)`, `°/s`, `M/S**2`, `N·m`."""
    text = text.strip().strip("[](){}<>").strip()
    if text in UNITS or text in SI:
        return text
    folded = text.lower()
    for old, new in (("**", ""), ("^", ""), ("²", "2"), ("⁻¹", "-1"), (" ", ""), ("_", "/"), ("/sec", "/s")):
        folded = folded.replace(old, new)
    folded = re.sub(r"(?<=[a-z°])/s/s$", "/s2", folded)
    return OTHER.get(folded) or next((u for u in (*UNITS, *SI) if u.lower().replace(" ", "") == folded), "")


def is_unit(text: str) -> bool:
    """Tell whether a text is a unit, one of time or temperature among them, or stands for none."""
    return bool(known(text)) or text.strip().strip("[]()").lower() in (
        *("s", "sec", "ms", "us", "min", "h", "hz", "k", "°k", "c", "°c", "�k", "degc", "kg/m3", "kg/h", "lbs/hr", ""),
    )


def factors(si: str, shares: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return {unit: factor} of a signal of SI unit `si`; `shares`: what one SI unit of something else is of it."""
    out = {si: 1.0} | {name: to[si] for name, to in UNITS.items() if si in to}
    for other, share in (shares or {}).items():
        out |= {name: share * factor for name, factor in factors(other).items()}
    return out


def bare(unit: str) -> str:
    """Return a unit in our writing, without what it is given per: mm of mm/V; a text that is no unit as it is."""
    text = next((unit.removesuffix(end) for end in PER if unit.endswith(end)), unit)
    return known(text) or text
