"""What the hydraulic detectors see of which fault, how soon and under which name: Lu17 flights with faults.

The left inner segment is at fault from T_FAULT on, in a manoeuvre and light turbulence (a jam: still air), with
every coefficient of aircraft and actuator up to 5 % off and seeds that training never used. `outcomes` flies a
case over seeds; `table` prints what came of all. Amplitudes are injected at the valve, converted with the nominal
loop, and the amplitude achieved is measured against the same flight without the fault.
"""

import math
from dataclasses import dataclass

import numpy as np

from cosim.design_rfafe import DT
from cosim.lu17_flights import POINTS, draw, estimate, flights, record
from cosim.train_lu17 import EVALUATION
from fdi import iotsekf, ofc_monitor, position_monitor, rtsekf_flight, verdict

T_FAULT, LANE, TARGET = 12.0, 1, "elevator.left_inner"
FREQUENCIES = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
CYCLE = ("nz_doublet", "pitch_protection", "coordinated_turn", "aoa_protection", "three_two_one_one")
MODULES = {
    "iotsekf": iotsekf,
    "rtsekf_flight": rtsekf_flight,
    "ofc_monitor": ofc_monitor,
    "position_monitor": position_monitor,
}
AMPLITUDES = (0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 2.0, 3.0, 5.0)  # [mm]


@dataclass(frozen=True)
class Case:
    """A fault on the left inner segment: scenario table, how long to look on, the class and culprit that are right."""

    name: str
    fault: dict
    seconds: float
    right: tuple
    culprit: str = ""
    hz: float = math.nan
    limit_s: float = math.nan  # an alarm is in time within this
    manoeuvre: dict | None = None  # fixed, with still air; else drawn, with light turbulence


def oscillation(hz, *, solid, mm=0.6):
    """Return the Case of an oscillatory failure that moves the rod by `mm`."""
    kind = "ofc_solid" if solid else "ofc_liquid"
    fault = {"target": TARGET, "kind": kind, "at": "valve", "start_s": T_FAULT, "amplitude_mm": mm, "frequency_hz": hz}
    right = ("ofc_liquid", "ofc_solid")
    return Case(f"{kind} {hz:g} Hz {mm:g} mm", fault, max(5.0 / hz, 1.0), right, hz=hz, limit_s=3 / hz)


def cases():
    """Return the Cases of issue and notes: oscillations, runaways, jams, rod-sensor faults."""
    out = [oscillation(hz, solid=solid) for solid in (False, True) for hz in FREQUENCIES]
    for rate in (5.0, 20.0, 40.0):
        fault = {"target": TARGET, "kind": "runaway", "start_s": T_FAULT, "rate_deg_s": rate}
        out.append(Case(f"runaway {rate:g} deg/s", fault, 2.0, ("runaway",), limit_s=0.2))
    for step in (0.5, 1.0, 3.0):
        fault = {"target": TARGET, "kind": "jam_solid", "start_s": T_FAULT - 1.0}
        pulse = {"kind": "three_two_one_one", "start_s": T_FAULT, "unit_s": 1.0, "amplitude_deg": step}
        out.append(Case(f"jam_solid, step {step:g} deg", fault, 2.0, ("jam_solid",), limit_s=0.5, manoeuvre=pulse))
    for bias in (0.6, 1.0, 3.0):
        fault = {"target": f"{TARGET}.rod", "kind": "bias", "start_s": T_FAULT, "bias_mm": bias}
        out.append(Case(f"rod bias {bias:g} mm", fault, 2.0, ("sensor", "jam_liquid"), "rod", limit_s=0.3))
    fault = {"target": f"{TARGET}.surface", "kind": "bias", "start_s": T_FAULT, "bias_deg": 0.2}
    out.append(Case("surface bias 0.2 deg", fault, 2.0, ("sensor",), "surface", limit_s=0.3))
    fault = {"target": f"{TARGET}.rod", "kind": "drift", "start_s": T_FAULT, "drift_mm_s": 1.0}
    out.append(Case("rod drift 1 mm/s", fault, 3.0, ("sensor", "ambiguous"), "rod"))
    fault = {"target": f"{TARGET}.rod", "kind": "freeze", "start_s": T_FAULT}
    out.append(Case("rod frozen", fault, 5.0, ("sensor",), "rod"))
    return out


def arguments(case, seed):
    """Return the arguments of `record` for one seed of a case."""
    if case.manoeuvre:
        manoeuvre, turbulence = case.manoeuvre, "none"
    else:
        manoeuvre, turbulence = {"kind": CYCLE[seed % len(CYCLE)], "start_s": T_FAULT - 3.0}, "light"
    return draw(seed, point=POINTS[seed % len(POINTS)], manoeuvre=manoeuvre, turbulence=turbulence,
                duration=T_FAULT + case.seconds, faults=[case.fault])


@dataclass(frozen=True)
class Outcome:
    """One run of one detector: delay of the alarm [s], inf for none; names of first and final class, and culprit."""

    early: bool  # an alarm before the fault, or on a healthy segment
    delay: float
    first: str
    last: str
    culprit: str
    hz: float  # named frequency at four periods, or at the end [Hz]
    deviation: float  # of the surface at the alarm [rad]


def judge(case, recorded, module, p):
    """Run a detector over a recorded flight and return its Outcome."""
    k = round(T_FAULT / DT)
    fields = ("alarm", "verdict", "culprit", *(("ofc_hz",) if "ofc_hz" in module.STATE.names else ()))
    log = estimate(module, recorded, p, fields)
    alarm = log["alarm"] > 0.5
    others = np.delete(alarm, LANE, axis=0)
    hit = np.flatnonzero(alarm[LANE, k:])
    at = k + hit[0] if len(hit) else None
    end = min(k + round(4.0 / case.hz / DT), alarm.shape[1] - 1) if case.hz > 0 else alarm.shape[1] - 1
    last = log[LANE, end]
    moved = abs(recorded["delta"][LANE, at] - recorded["delta"][LANE, k]) if at is not None else math.nan
    return Outcome(
        early=bool(alarm[LANE, :k].any() or others.any()),
        delay=(at - k) * DT if at is not None else math.inf,
        first=verdict.name(log["verdict"][LANE, at]) if at is not None else "none",
        last=verdict.name(last["verdict"]),
        culprit=module.CULPRITS[int(last["culprit"])],
        hz=float(last["ofc_hz"]) if "ofc_hz" in fields else math.nan,
        deviation=float(moved),
    )


def outcomes(case, detectors, *, seeds=60, first_seed=EVALUATION + 5000):
    """Fly `seeds` flights of a case; return {detector: [Outcome]}; `detectors`: {name: (module, PARAMS)}."""
    out = {name: [] for name in detectors}
    for seed in range(first_seed, first_seed + seeds):
        recorded = record(**arguments(case, seed))
        for name, (module, p) in detectors.items():
            out[name].append(judge(case, recorded, module, p))
    return out


def achieved(case, seed):
    """Return the rod amplitude [m] that an oscillation achieves: least squares against the flight without the fault."""
    flight = arguments(case, seed)
    q = record(**flight)["rod"][LANE] - record(**{**flight, "faults": []})["rod"][LANE]
    first = round((T_FAULT + 2 / case.hz) / DT)
    t = np.arange(first, len(q)) * DT
    w = 2 * math.pi * case.hz
    fit = np.linalg.lstsq(np.stack([np.cos(w * t), np.sin(w * t), t**0, t, t * t], axis=1), q[first:], rcond=None)[0]
    return math.hypot(fit[0], fit[1])


def summary(case, found):
    """Return one row of the table: counts over the seeds of a case."""
    delay = np.array([o.delay for o in found])
    n = len(found)
    row = {
        "case": case.name,
        "runs": n,
        "early": sum(o.early for o in found),
        "detected": int(np.isfinite(delay).sum()),
        "in_time": int((delay <= case.limit_s + DT / 2).sum()) if case.limit_s > 0 else None,
        "delay_median_s": float(np.median(delay)),
        "delay_95_s": float(np.sort(delay)[math.ceil(0.95 * n) - 1]),
        "right": sum(o.last in case.right and o.culprit == case.culprit for o in found),
        "named": {c: sum(o.last == c for o in found) for c in dict.fromkeys(o.last for o in found)},
        "deviation_max_deg": max((math.degrees(o.deviation) for o in found if math.isfinite(o.deviation)), default=0.0),
    }
    if case.hz > 0:
        row["frequency_right"] = sum(
            o.last in case.right and abs(o.hz / case.hz - 1.0) <= 0.25 for o in found
        )
    return row


def default_detectors():
    """Return {name: (module, PARAMS)} as they fly, and the two other load forms of iotsekf."""
    out = {name: (module, module.params()) for name, module in MODULES.items()}
    return out | {f"iotsekf load {k}": (iotsekf, iotsekf.params(load=k)) for k in (1, 0)}



def quiet(detectors, *, draws=3, first_seed=EVALUATION, progress=None):
    """Fly 108 fault-free flights per draw; return {detector: (flights, alarms, five largest maxima of r)}."""
    most = {name: [] for name in detectors}
    alarms = dict.fromkeys(detectors, 0)
    settled = round(2.0 / DT)
    for count, flight in enumerate(flights(first_seed, draws), start=1):
        recorded = record(**flight)
        for name, (module, p) in detectors.items():
            log = estimate(module, recorded, p, ("r", "alarm"))
            alarms[name] += bool((log["alarm"] > 0.5).any())
            label = f"{flight['manoeuvre']['kind']}, {flight['flight']['turbulence']}, seed {flight['seed']}"
            most[name].append((float(np.abs(log["r"][:, settled:]).max()), label))
        if progress:
            progress(f"{count} flights")
    return {name: (len(most[name]), alarms[name], sorted(most[name], reverse=True)[:5]) for name in detectors}


def smallest(hz, detectors, *, solid, seeds=20, share=0.95):
    """Return {detector: least of AMPLITUDES [mm] that is found in time in `share` of the seeds}, inf where none is."""
    out = dict.fromkeys(detectors, math.inf)
    for mm in AMPLITUDES[::-1]:
        case = oscillation(hz, solid=solid, mm=mm)
        found = outcomes(case, detectors, seeds=seeds, first_seed=EVALUATION + 8000)
        missed = 0
        for name, runs in found.items():
            in_time = sum(o.delay <= 3.0 / hz + DT / 2 and not o.early for o in runs)
            if in_time >= share * seeds:
                out[name] = min(out[name], mm)
            else:
                missed += 1
        if missed == len(found):
            break
    return out
