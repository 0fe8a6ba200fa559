"""The bound of physics: the smallest oscillation that any detector of a level can see with 90 %, flight by flight.

A level reads these: `airframe motion` every sensor of the aircraft but heading, `elevator positions` the surface
sensors beside them, `monitors` rod and surface sensors of the segment with its valve command. What disturbs them is
the sensors' noise and, for the aircraft, the flight's gusts (Dryden, all three axes; that the tail meets them later
is left out, which makes the bound lower). The aircraft and the frequency are taken as known, coefficients as
favourable as tolerances of 5 % make them, the time as all that the fault lasted, the false-alarm probability as 5 %
in it: a bound, no forecast.

`actuator filters` have none in mm of rod: differential pressure tells of an opened valve before friction lets the rod
move at all. Nor has a solid oscillation: the command that it replaces is missed whatever its amplitude.
"""

import functools
import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
from scipy import stats

from cosim.compare.rows import flown
from cosim.flight.blocks.sensors import TRANSPORT
from cosim.flight.blocks.servo_gain import liquid_gain
from cosim.flight.plant.gusts import INTENSITY, SCALE_LENGTH
from cosim.flight.plant.linearize import LinearModel, linearize
from cosim.flight.plant.point import FlightPoint
from cosim.judge.coverage import group
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES
from fdi.common import physics_bound as physics

DT = 0.005  # that the sensors' sigma belongs to [s]
FAVOURABLE = 1.05  # coefficients of the elevator's moment, at most
FALSE_ALARM = 0.05  # of a flight
GROUND = {"alpha_ground": "alpha", "v_ground": "tas"}  # sensor -> the output that it shows without the gust
UNUSED = {"psi", "h_baro"}  # heading: nothing aerodynamic; barometric altitude: the inertial one is better
AIR = {"alpha", "beta", "cas", "tas", "mach"}  # sensors that the gust itself moves
BEYOND = 1e-3  # chance of as many detections as were counted, from which on they are more than physics allows


def of(rows: pd.DataFrame, tomls: Mapping[str, str]) -> pd.DataFrame:
    """Return `rows` with columns `bound_mm`, at which 90 % can be seen, and `best`, the largest probability to see it.
    NaN where there is no bound: not a liquid oscillation of an elevator, or a group that has none."""
    swings = rows["family"].fillna("").str.startswith("liquid OFC") & (rows["amplitude_mm"] > 0.0)
    rows["bound_mm"], rows["best"] = math.nan, math.nan
    told: dict = {}
    for i, row in rows[swings].iterrows():
        key = row["run"], int(row["fault"]), group(row["id"], row["level"])
        if key not in told:
            told[key] = _of(flown(tomls[key[0]]), *key[1:])
        information, seconds = told[key]
        if information:
            rows.loc[i, "bound_mm"] = physics.least_amplitude(information, seconds, false_alarm=FALSE_ALARM)
            rows.loc[i, "best"] = physics.probability(row["amplitude_mm"], information, seconds, FALSE_ALARM)
    return rows


def beyond(rows: pd.DataFrame) -> list[str]:
    """Return the detectors that saw more oscillations than physics allows, of those below their bound.

    Such a detector reads something that it should not, or the bound is wrong. The count is held against the sum of
    independent flights with probabilities of at most `best` (normal approximation with continuity correction).
    """
    out = []
    low = rows[rows["bound_mm"].notna() & (rows["amplitude_mm"] < rows["bound_mm"]) & ~rows["not_valid"]]
    for name, own in low.groupby("id", sort=False):
        p, k = own["best"].to_numpy(), int(own["detected"].sum())
        spread = math.sqrt(float(np.sum(p * (1.0 - p))))
        if k > 0 and stats.norm.sf((k - 0.5 - p.sum()) / max(spread, 1e-9)) < BEYOND:
            out.append(str(name))
    return out


def _of(scenario: Scenario, fault: int, name: str) -> tuple[float | None, float]:
    """Return (information per mm^2 and second of group `name`, None without a bound; seconds that the fault lasted)."""
    f = scenario.faults[fault]
    seconds = min(f.end_s or math.inf, scenario.duration_s) - f.start_s
    hz, segments = (f.model_extra or {})["frequency_hz"], f.parsed.names
    technology = [scenario.elevator.technology[s] for s in segments]
    if seconds <= 0.0 or f.shape not in (None, "sine"):  # of another shape its harmonics tell, too
        return None, max(seconds, 0.0)
    own = scenario.aircraft.own(technology[0])
    mm = 1e-3 / TECHNOLOGIES[technology[0]].design(own).arm  # surface angle per mm of rod [rad]
    if name == "monitors":
        return _positions(technology[0], own, mm, hz, servo=f.at == "valve"), seconds
    if name == "airframe motion":
        return _airframe(scenario, segments, mm, hz), seconds
    if name == "elevator positions":
        told = sum(_surface(t, mm) for t in technology)
        return told + _airframe(scenario, segments, mm, hz), seconds
    return None, seconds


def _white(amplitude, sigma):
    return 0.5 * amplitude**2 / (sigma**2 * DT)


def _surface(technology, mm):
    """Return the information of the sensor that tells where the surface is, on it or on the screw."""
    own = TECHNOLOGIES[technology].sensors
    return _white(mm, own["surface"].sigma) if "surface" in own else _rod(technology)


def _rod(technology):
    return sum(_white(1e-3, s.sigma) for n, s in TECHNOLOGIES[technology].sensors.items() if n in ("rod", "position"))


def _positions(technology: str, differs, mm: float, hz: float, servo: bool) -> float:
    """Return the information of rod and surface sensor of one segment, its valve command known.

    Behind the valve the servo works against the oscillation, and its command tells how much: what the rod would have
    done without it counts.
    """
    own = TECHNOLOGIES[technology]
    told = _rod(technology) + (_surface(technology, mm) if "surface" in own.sensors else 0.0)
    if not servo or not own.servo:
        return told
    w = 2 * math.pi * hz
    return told * (own.solid_gain(w, differs) / liquid_gain(technology, w, DT, differs)) ** 2


def _airframe(scenario, segments, mm, hz):
    p = FlightPoint.of(scenario)
    nominal = (p.mass, p.cg, p.altitude, p.speed_kind, p.speed, p.aircraft)
    return mm**2 * _motion(nominal, scenario.flight.turbulence, tuple(segments), hz)


@functools.lru_cache(maxsize=4096)
def _motion(nominal: tuple, air: str, segments: tuple, hz: float) -> float:
    model, short = _model(nominal)
    w = 2 * math.pi * hz
    shows = {n: GROUND.get(n) or shown for n, (shown, *_) in TRANSPORT.items() if n not in UNUSED}
    names = [n for n, shown in shows.items() if shown in model.outputs]
    pick = [list(model.outputs).index(shows[n]) for n in names]
    moved = [list(model.inputs).index(f"de_{short[s]}") for s in segments]
    B, D = (m[:, moved].sum(axis=1) for m in (model.B, model.D))
    reach = np.linalg.inv(1j * w * np.eye(len(model.A)) - model.A)
    signal = FAVOURABLE * (model.C @ reach @ B + D)[pick]
    noise = np.diag([TRANSPORT[n][1] ** 2 * DT for n in names]).astype(complex)
    blown = np.array([n in AIR or n.startswith("n_") or n.endswith("dot") for n in names])  # by the gust itself
    for state, per_m_s, density in _gusts(model, air, w):
        k = list(model.states).index(state)
        shown = (model.C @ reach @ (per_m_s * model.A[:, k]))[pick]
        through = shown + np.where(blown, per_m_s * model.C[pick, k], 0.0)
        noise += density * np.outer(through, through.conj())
    return float(physics.information(signal[None], noise[None])[0])


def _gusts(model: LinearModel, air: str, w: float) -> list[tuple[str, float, float]]:
    """Return [(state that a gust adds to, state per m/s, two-sided spectral density [(m/s)^2/Hz]) of u, w, v]."""
    sigma, V = INTENSITY[air], float(model.x0[list(model.states).index("tas")])
    tau = SCALE_LENGTH / V
    x2 = (tau * w) ** 2
    along, across = sigma**2 * 2 * tau / (1 + x2), sigma**2 * tau * (1 + 3 * x2) / (1 + x2) ** 2
    return [("tas", 1.0, along), ("alpha", 1.0 / V, across), ("beta", 1.0 / V, across)]


@functools.lru_cache(maxsize=256)
def _model(nominal: tuple) -> tuple[LinearModel, dict]:
    mass, cg, altitude, kind, speed, aircraft = nominal
    point = FlightPoint(mass, cg, altitude, kind, speed, aircraft=aircraft)
    return linearize(point), point.record.short
