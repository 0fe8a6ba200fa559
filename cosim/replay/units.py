"""Units of a map, by pint: what one of each is in the SI unit of a signal."""

import functools
import re
from collections.abc import Mapping
from typing import Any

_SHORT = ("kts = knot", "dps = degree / second", "fps = foot / second", "fpm = foot / minute")
_WORD = r"[A-Za-zµ°%]+(?:\*\*|\^)?-?[1-4]?"
_UNIT = re.compile(rf"{_WORD}(?:[ */]{{1,3}}{_WORD}){{0,4}}")


@functools.cache
def _registry() -> Any:
    import pint

    out: Any = pint.UnitRegistry()
    for line in _SHORT:
        out.define(line)
    return out


@functools.cache
def _base(text: str) -> Any:
    """Return (factor, base units) of a unit as people write it, None for what is none: deg/s2, lbf ft, % and -; g is
    that of a load factor. Radians are a base unit here: neither 1/s nor % is an angle's."""
    import pint

    if text == "-":
        return 1.0, _registry().Unit("")
    if len(text) > 40 or not _UNIT.fullmatch(text):
        return None
    text = text.replace("%", "percent")
    text = re.sub(r"([a-zA-Z])\^?([1-4])", r"\1**\2", re.sub(r"\bg\b", "g_0", text))
    try:
        return _registry().get_base_units(text)
    except (pint.PintError, ValueError, TypeError, ArithmeticError, AssertionError):
        return None


def factor(unit: str, si: str, shares: Mapping[str, float] | None = None) -> float | None:
    """Return what one `unit` is of a signal of SI unit `si`, None where it measures something else.

    `shares` says what one SI unit of something else is of the signal: {"Pa": 1 / supply pressure}. A slope in N m/rad
    may be given in a unit of N m.
    """
    if unit == si:
        return 1.0
    found = _base(unit)
    for target, share in {si: 1.0, si.removesuffix("/rad"): 1.0, **(shares or {})}.items():
        own = _base(target)
        if found is not None and own is not None and found[1] == own[1]:
            return share * float(found[0] / own[0])
    return None
