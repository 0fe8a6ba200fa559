"""The clock of a recording: one field, its unit and zero, times that rise. Nothing is taken for a time in silence."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import LogError

UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}  # [s]
NAMES = ("t", "time", "timestamp", "clock")
UNSAID = "time = 'NAME [us]' in the map says the unit: ns, us, ms, s, min, h"
SLOWEST = 1.0  # [s] between two samples: whatever takes longer is no recording of a flight, or not in seconds


def of_table(header: Sequence[str], time: str | None, place: Any) -> tuple[str, str]:
    """Return (column, its unit or "") of the clock: `time`, else the only column that is called so by NAMES.

    Raises LogError where no column or several may be meant.
    """
    if time:
        return (time, "") if time in header else _apart(time)
    found = [n for n in header if re.sub(r"[\W_]+[a-z]*\W?$", "", n.lower()) in NAMES]
    if len(found) != 1:
        said = f"{len(found) or 'no'} column{'s' * (len(found) > 1)} may be its clock"
        how = {"allowed": ", ".join((found or list(header))[:20]), "remedy": "time = 'NAME' in the map names it"}
        raise LogError(said, place=str(place), **how)
    return found[0], ""


def of_messages(time: str | None) -> tuple[str, str]:
    """Return (field, its unit or "") of the clock of messages."""
    return _apart(time or "log_time")


def _apart(time):
    said = re.fullmatch(r"(.+?)\s*\[(\w+)\]", time)
    return (said[1], said[2]) if said and not said[2].isdigit() else (time, "")


def unit_of(name: str) -> str:
    """Return the unit of time in which a name ends: of clock_ms, "t [us]"; "" for none."""
    ending = re.search(r"[\W_]([a-z]+)[)\]]?$", name.lower())
    return ending[1] if ending and ending[1] in UNITS else ""


def stamps(column: Any, name: str, unit: str, place: Any) -> tuple[NDArray, str]:
    """Return (times (rows,), which clock they are) of a pandas Series: float64 [s], or datetime64[ns] of dates.

    The unit of numbers is `unit`, else the ending of their name, else seconds. Raises LogError with the first row that
    holds no time.
    """
    import pandas as pd

    unit = unit or unit_of(name) or "s"
    if unit not in UNITS:
        raise LogError(f"{unit!r} is no unit of time", place=str(place), remedy=UNSAID)
    if column.dtype.kind in "iuf":
        t, label = column.to_numpy(np.float64) * UNITS[unit], f"{name} in {unit}"
    elif column.dtype.kind == "m":
        t, label = column.dt.total_seconds().to_numpy(), name
    else:
        label = name if column.dtype.kind == "M" else f"{name}, ISO 8601"
        dates = pd.to_datetime(column, format="ISO8601", utc=True, errors="coerce")
        t = dates.dt.tz_localize(None).to_numpy("datetime64[ns]")
        numbers = t if column.dtype.kind == "M" else pd.to_numeric(column, errors="coerce").to_numpy(np.float64)
        if np.isfinite(numbers).sum() > np.isfinite(t).sum():  # numbers, but for some rows
            t, label = numbers * UNITS[unit], f"{name} in {unit}"
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        more = f" ({len(bad)} such rows)" if len(bad) > 1 else ""
        what = f"{name} holds no time{more}: {str(column.iloc[bad[0]])[:40]!r}"
        remedy = "Every row needs a number or ISO 8601, as in 2026-11-24T10:00:00.005Z"
        raise LogError(what, place=f"{place}, row {bad[0] + 1}", remedy=remedy)
    return t, label


def check(t: NDArray, place: Any) -> None:
    """Raise LogError for times that do not rise, with the row and its value, and for a clock that is not in its
    unit."""
    if len(t) < 2 or t[0] == t[-1]:
        said = "the clock holds a single time" if len(t) else "holds no row"
        raise LogError(said, place=str(place), remedy="time = 'NAME' in the map names another clock")
    bad = np.flatnonzero(t[1:] <= t[:-1])
    if len(bad):
        k = int(bad[0]) + 1
        a, b = (v if t.dtype.kind == "M" else f"{v:.9g} s" for v in (t[k - 1], t[k]))
        what, remedy = f"the clock goes back from {a} to {b}", "Sort the rows by time, or cut the file there"
        if t[k] == t[k - 1]:
            what, remedy = f"the time {b} stands twice", "One row per time: keep one source, or name another clock"
        raise LogError(what, place=f"{place}, row {k + 1}", allowed="times that rise", remedy=remedy)
    step = interval(since(t, t[0]))
    if step >= SLOWEST:
        raise LogError(f"its samples are {step:.6g} s apart", place=str(place), allowed=f"below {SLOWEST:g} s",
                       remedy=f"Is time in seconds? {UNSAID}")  # fmt: skip


def since(t: NDArray, zero: Any) -> NDArray:
    """Return times [s]: dates since `zero`, numbers as they are."""
    return (t - zero) / np.timedelta64(1, "s") if t.dtype.kind == "M" else t


def interval(t: NDArray) -> float:
    """Return the median distance of two samples [s], 0 without two of them."""
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0


def lost(t: NDArray) -> int:
    """Return how many samples are missing in `t` (rows,) [s] against its median step; a late one is none."""
    return max(0, int((np.round(np.diff(t) / interval(t)) - 1.0).sum())) if len(t) > 2 else 0


def sentence(label: str, zero: Any, times: Mapping[str, NDArray]) -> str:
    """Return which clock it is, from when to when it runs, and of each table or topic how regularly it was sampled."""
    out = [label if zero is None else f"{label}, zero at {zero}Z"]
    for name, t in times.items():
        step = np.diff(t)
        told = f"{len(t):,} samples from {t[0]:.9g} to {t[-1]:.9g} s, step {1e3 * interval(t):.4g} ms"
        scatter = 1e3 * float(np.std(step[step < 1.5 * interval(t)]))
        out.append(f"{name}{': ' * bool(name)}{told} ± {round(scatter, 6):g} ms, {lost(t)} missing")
    return "; ".join(out)
