"""The clock of a recording: finite and rising, or told where it is not; what else is odd about it, in sentences."""

import itertools

import numpy as np
from numpy.typing import NDArray

from cosim.errors import LogError

LATEST = 1e12  # [s]: 30,000 years
IN_SECONDS = "Is time in seconds? time = 'NAME [us]' in the map, or --time, says the unit: ns, us, ms, s, min, h"
MOST = 3  # oddities of a kind that are told one by one


def finite(t: NDArray, name: str, path: object) -> None:
    """Raise LogError that names the first row of `t` (rows,) [s] which holds no time."""
    bad = np.flatnonzero(~(np.abs(t) < LATEST))
    if len(bad):
        more = f" ({len(bad)} such rows)" if len(bad) > 1 else ""
        place, value = f"{path}, row {bad[0] + 1}", t[bad[0]]
        if np.isfinite(value):
            raise LogError(f"{name} holds {value:.6g} s{more}", place=place, allowed=f"{LATEST:g} s", remedy=IN_SECONDS)
        raise LogError(f"{name} holds no time{more}", place=place, remedy="Every row needs a finite time")


def stretches(t: NDArray) -> list[slice]:
    """Return the stretches of `t` (rows,) in which the clock does not go back."""
    edges = [0, *(np.flatnonzero(np.diff(t) < 0.0) + 1).tolist(), len(t)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def rising(t: NDArray, path: object, on_reset: str | None, part: int = 0) -> tuple[NDArray, slice, list[str]]:
    """Return (times that rise, rows that they are of, sentences about it): all with "offset", stretch number `part`
    with "split".

    Raises LogError where the clock goes back and `on_reset` is None, with the row and both values; IndexError when
    there is no such stretch.
    """
    found = stretches(t)
    if len(found) == 1 and part == 0:
        return t, slice(0, len(t)), []
    back = [f"the clock goes back from {t[k - 1]:.9g} to {t[k]:.9g} s" for k in (rows.start for rows in found[1:])]
    if on_reset is None:
        remedy = f"--on-reset split: each of the {len(found)} stretches apart; offset: each follows the one before"
        remedy = "Sort the rows by time" if len(found) > len(t) / 2 else remedy
        place = f"{path}, row {found[1].start + 1}"
        raise LogError(back[0], place=place, allowed="times that rise", remedy=remedy)
    if on_reset == "split":
        here = found[part]
        return t[here], here, [f"stretch {part + 1} of {len(found)}, rows {here.start + 1} to {here.stop}"]
    out = t.copy()
    for before, here in itertools.pairwise(found):
        out[here] += out[before][-1] + interval(t) - t[here.start]
    told = [f"row {rows.start + 1}: {text}, it is carried on" for rows, text in zip(found[1:], back[:MOST])]
    return out, slice(0, len(t)), told + [f"so it does {len(back) - MOST} times more"] * (len(back) > MOST)


def interval(t: NDArray) -> float:
    """Return the median distance of two samples [s], 0 without two of them."""
    forward = np.diff(t)
    forward = forward[forward > 0.0]
    return float(np.median(forward)) if len(forward) else 0.0


def oddities(t: NDArray, name: str) -> list[str]:
    """Return sentences about gaps, doubled times and changes of rate in the rising times `t` [s] of channel `name`."""
    if len(t) < 3:
        return []
    out, step = [], np.diff(t)
    usual = interval(t)
    doubled = np.flatnonzero(step == 0.0)
    if len(doubled):
        out.append(f"{name}: {len(doubled)} times stand twice, first {t[doubled[0]]:.6g} s: the last sample counts")
    gaps = np.flatnonzero(step > 5.0 * usual)
    out += [f"{name}: no sample from {t[k]:.6g} to {t[k + 1]:.6g} s" for k in gaps[:MOST]]
    if len(gaps) > MOST:
        out.append(f"{name}: {len(gaps) - MOST} further gaps")
    blocks = [step[a : a + 200] for a in range(0, len(step) - 199, 200)]
    rates = [float(np.median(b)) for b in blocks]
    for a, b, k in zip(rates[:-1], rates[1:], range(1, len(rates))):
        if a > 0.0 and b > 0.0 and not 0.8 < a / b < 1.25:
            out.append(f"{name}: its rate changes from {1 / a:.4g} to {1 / b:.4g} Hz near {t[200 * k]:.6g} s")
            break
    return out
