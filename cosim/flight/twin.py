"""How far a fault moves its elevator: the flight against its twin, the same flight without the faults.

Same flight point, seed, noise and manoeuvre: what differs is the fault and what the law and the servos do about it. The
twin flies without detectors (but those that a servo closes on), which costs a bit less than the flight; the last twins
are kept, so that runs that differ in their fault only share one.

    d(t)        rod [m] or surface [rad] of a segment, less its twin's, while a fault on the segment is active and 1 s
                afterwards
    peak        max |d|
    amplitude   for an oscillation: of the least-squares sine at the fault's frequency over the settled whole periods;
                slow drifts between the two flights do not count
"""

import functools
import math
import tomllib

import numpy as np

from cosim.flight.build import build
from cosim.flight.fly import fly
from cosim.scenario import parse

TRAVEL = math.radians(40.0)  # of an elevator segment, -23 to +17 deg
SETTLE_PERIODS = 2.0


def achieved(scenario):
    """Fly `scenario` and its twin; return what its faults did to the segments that they act on.

    {segment: {rod_mm, surface_deg, travel_pct, amplitude_mm, amplitude_deg}}: the first three are peaks. Costs a flight
    and the twin. Raises TrimError.
    """
    setup = build(scenario)
    rows, *_ = fly(setup)
    return moved(scenario, setup.history, rows)


def faulted(scenario):
    """Return {segment: its injections} of the segments that a fault acts on, directly or by a sensor of the loop."""
    out: dict[str, list] = {}
    for j in scenario.injections():
        if j.place in ("elevator", "actuator_sensor") and j.path != "monitor":
            out.setdefault(j.name, []).append(j)
    return out


def moved(scenario, history, rows):
    """Return what `achieved` returns, from the rows of a flight flown; {} when no fault acts on an elevator segment."""
    segments = faulted(scenario)
    if not segments:
        return {}
    twin = positions(_without_faults(scenario))
    here = _positions(history, rows)
    n = min(len(here), len(twin))
    names = list(history.surface)
    difference = here[:n].astype(float) - twin[:n]
    pair = {seg: difference[:, 2 * names.index(seg) :][:, :2] for seg in segments}
    return {seg: _segment(pair[seg], faults, scenario.dt) for seg, faults in segments.items()}


@functools.lru_cache(maxsize=16)
def positions(scenario_toml):
    """Return (ticks, 8) float32 of a flight: per segment rod [m], NaN where it has none, and surface [rad]."""
    setup = build(parse(tomllib.loads(scenario_toml)))
    rows, *_ = fly(setup)
    return _positions(setup.history, rows)


def _without_faults(scenario):
    """Return the TOML of the twin: no fault, no detector but those in the loop."""
    quiet = scenario.detectors.model_copy(update={"enabled": ()})
    return scenario.model_copy(update={"title": "", "faults": (), "detectors": quiet}).expanded_toml()


def _positions(history, rows):
    out = np.full((len(rows), 2 * len(history.surface)), np.nan, np.float32)
    for i, seg in enumerate(history.surface):
        if seg in history.rod:
            column, gain = history.rod[seg]
            out[:, 2 * i] = gain * rows[:, column]
        out[:, 2 * i + 1] = rows[:, history.surface[seg]]
    return out


def _segment(difference, faults, dt):
    """Return the entry of one segment from its (ticks, 2) rod and surface differences."""
    start = min(j.start for j in faults)
    end = max(j.end for j in faults) + 1.0
    last = len(difference) if math.isinf(end) else min(len(difference), round(end / dt))
    peak = [_largest(d) for d in difference[round(start / dt) : last].T]
    sine = next((j for j in faults if math.isfinite(j.omega)), None)
    amplitude = [_amplitude(d, sine, dt) if sine else None for d in difference.T]
    return {
        "rod_mm": _scaled(peak[0], 1e3),
        "surface_deg": _scaled(peak[1], 180 / math.pi),
        "travel_pct": _scaled(peak[1], 100 / TRAVEL),
        "amplitude_mm": _scaled(amplitude[0], 1e3),
        "amplitude_deg": _scaled(amplitude[1], 180 / math.pi),
    }


def _scaled(x, factor):
    return None if x is None else x * factor


def _largest(d):
    return float(np.max(np.abs(d))) if len(d) and np.isfinite(d).all() else None


def _amplitude(d, j, dt):
    """Return the amplitude of the sine of fault `j` in `d` over its settled whole periods; None when no period is left.

    A constant and a slope stand beside the sine, so that a slow difference between the flights does not count.
    """
    period = 2 * math.pi / j.omega
    first = round((j.start + j.ramp + SETTLE_PERIODS * period) / dt)
    last = min(len(d), round(min(j.end, len(d) * dt) / dt))
    whole = math.floor((last - first) * dt / period + 1e-9)
    if whole < 1:
        return None
    cut = d[last - round(whole * period / dt) : last]
    if not np.isfinite(cut).all():
        return None
    t = np.arange(len(cut)) * dt
    basis = np.column_stack([np.cos(j.omega * t), np.sin(j.omega * t), np.ones(len(t)), t])
    c, s, *_ = np.linalg.lstsq(basis, cut, rcond=None)[0]
    return math.hypot(c, s)
