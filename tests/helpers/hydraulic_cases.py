"""What the hydraulic detectors see of which fault, how soon and under which name: Lu17 flights with faults.

The left inner segment is at fault from T_FAULT on, in a manoeuvre and light turbulence (a jam: still air), with
every coefficient of aircraft and actuator up to 5 % off and seeds that training never used. Amplitudes are injected at
the valve, converted with the nominal loop, and the amplitude achieved is measured against the same flight without the
fault. What is asked, and the tables, are in `test_hydraulic_in_flight`.
"""

import functools
import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from actuators.common.linkage import ARM
from cosim.judge.alarms import detection
from cosim.judge.fault_effect import amplitude
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, POINTS, draw, fly_hydraulic, watch
from fdi.common import verdict
from fdi.hydraulic import iotsekf, rtsekf_flight
from fdi.monitors import ofc_monitor, position_monitor

T_FAULT, LANE = 12.0, 1
SEGMENT = SEGMENTS[LANE]
TARGET = f"elevator.{SEGMENT}"
FREQUENCIES = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
CYCLE = ("nz_doublet", "pitch_protection", "coordinated_turn", "aoa_protection", "three_two_one_one")
MODULES = {
    "iotsekf": iotsekf,
    "rtsekf_flight": rtsekf_flight,
    "ofc_monitor": ofc_monitor,
    "position_monitor": position_monitor,
}
HANDS_OFF = {"kind": "cruise"}


@dataclass(frozen=True)
class Case:
    """A fault on the left inner segment: scenario table, how long to look on, the class and culprit that are right."""

    name: str
    group: str  # the class that it belongs to
    fault: dict | None
    seconds: float
    right: tuple
    culprit: str = ""
    hz: float = math.nan
    limit_s: float = math.nan  # an alarm is in time within this
    deviation_deg: float = math.nan  # and the surface has then moved by no more than this
    manoeuvre: dict | None = None  # fixed; else drawn
    air: str = "light"


def oscillation(hz: float, *, solid: bool, mm: float = 0.6, air: str = "light", manoeuvre: dict | None = None) -> Case:
    """Return the Case of an oscillatory failure that moves the rod by `mm`."""
    kind = "ofc_solid" if solid else "ofc_liquid"
    fault = {"target": TARGET, "kind": kind, "at": "valve", "start_s": T_FAULT, "amplitude_mm": mm, "frequency_hz": hz}
    right = ("ofc_liquid", "ofc_solid")
    where = "" if air == "light" else ", still air" + (", hands off" if manoeuvre else "")
    return Case(f"{kind} {hz:g} Hz {mm:g} mm{where}", kind, fault, max(5.0 / hz, 1.0), right, hz=hz, limit_s=3 / hz,
                manoeuvre=manoeuvre, air=air)


def oscillations(mm: float = 0.6) -> list[Case]:
    """Return the Cases of the issue: liquid in turbulence, solid in turbulence and in still air."""
    solid = ({"air": "light"}, {"air": "none"}, {"air": "none", "manoeuvre": HANDS_OFF})
    liquid = [oscillation(hz, solid=False, mm=mm) for hz in FREQUENCIES]
    return liquid + [oscillation(hz, solid=True, mm=mm, **air) for air in solid for hz in FREQUENCIES]


def _sensor(part, kind, right=("sensor",), *, limit_s=math.nan, seconds=2.0, **size):
    fault = {"target": f"{TARGET}.{part}", "kind": kind, "start_s": T_FAULT, **size}
    unit = {k: k.partition("_")[2].replace("_s", "/s") for k in size}
    name = " ".join([part, kind, *(f"{v:g} {unit[k]}".rstrip() for k, v in size.items())])
    return Case(name, part, fault, seconds, right, part, limit_s=limit_s)


def others() -> list[Case]:
    """Return the Cases that are no oscillation: runaways, jams, sensors of rod, surface and pressure, no fault."""
    out = []
    for rate, most in ((5.0, 2.0), (20.0, 4.0), (40.0, 7.0)):
        fault = {"target": TARGET, "kind": "runaway", "start_s": T_FAULT, "rate_deg_s": rate}
        name = f"runaway {rate:g} deg/s"
        out.append(Case(name, "runaway", fault, 2.0, ("runaway",), limit_s=0.2, deviation_deg=most))
    for step in (0.5, 1.0, 3.0):
        fault = {"target": TARGET, "kind": "jam_solid", "start_s": T_FAULT - 1.0}
        pulse = {"kind": "three_two_one_one", "start_s": T_FAULT, "unit_s": 1.0, "amplitude_deg": step}
        name = f"jam_solid, step {step:g} deg"
        out.append(Case(name, "jam_solid", fault, 2.0, ("jam_solid",), limit_s=0.5, manoeuvre=pulse, air="none"))
    for mm in (0.6, 1.0, 3.0):
        out.append(_sensor("rod", "bias", ("sensor", "jam_liquid"), limit_s=0.3, bias_mm=mm))
    for mm in (0.6, 1.0, 3.0):
        out.append(_sensor("surface", "bias", limit_s=0.3, bias_deg=round(math.degrees(mm * 1e-3 / ARM), 4)))
    out += [_sensor("rod", "drift", ("sensor", "ambiguous"), seconds=4.0, drift_mm_s=v) for v in (0.3, 1.0, 3.0)]
    out += [_sensor("rod", "freeze", seconds=5.0), _sensor("surface", "freeze", seconds=5.0)]
    out += [_sensor("pressure", "bias", bias_pct=5.0), _sensor("pressure", "bias", bias_pct=20.0),
            _sensor("pressure", "drift", seconds=5.0, drift_pct_s=5.0),
            *(_sensor("pressure", "scale", seconds=5.0, scale=v) for v in (1.5, 0.5)),
            _sensor("pressure", "freeze", seconds=5.0)]
    lost = {"target": f"{TARGET}.pressure", "kind": "dropout", "start_s": T_FAULT}
    out.append(Case("pressure dropout", "pressure lost", lost, 6.0, ("none",)))  # its flag says so: nothing to find
    return [*out, Case("no fault", "none", None, 5.0, ("none",))]


def arguments(case: Any, seed: int, noise: Any = 1.0) -> Any:
    """Return the arguments of `scenario` for one seed of a case; a manoeuvre starts 2 to 4 s before the fault."""
    start = T_FAULT - float(np.random.default_rng([seed, 1]).uniform(2.0, 4.0))
    drawn = {"kind": CYCLE[seed % len(CYCLE)], "start_s": start}
    more = {"sensors": {"noise_scale": noise}} if noise != 1.0 else {}
    return draw(seed, point=POINTS[seed % len(POINTS)], manoeuvre=case.manoeuvre or drawn, turbulence=case.air,
                duration=T_FAULT + case.seconds, faults=[case.fault] if case.fault else [], **more)


@dataclass(frozen=True)
class Outcome:
    """One run of one detector: delay of the alarm [s], inf for none; names of first and final class, and culprit."""

    early: bool  # an alarm before the fault, or on a healthy segment
    delay: float
    first: str
    last: str
    culprit: str
    hz: float  # named frequency at four periods, or at the end [Hz]
    deviation: float  # how far the surface has gone from onset to alarm [rad]
    off: float = math.nan  # how far it is then from where it would be without the fault [rad]


def judge(case: Any, recorded: Any, module: Any, p: Any, twin: Any = None) -> Any:
    """Run a detector over a recorded flight and return its Outcome; `twin`: the same flight without the fault."""
    k = round(T_FAULT / DT)
    fields = ("alarm", "verdict", "culprit", *(("ofc_hz",) if "ofc_hz" in module.STATE.names else ()))
    log = watch(recorded, module, p, fields)
    alarm = log["alarm"] > 0.5
    others = np.delete(alarm, LANE, axis=0)
    at = detection(alarm[LANE], k)
    before = round(case.fault["start_s"] / DT) if case.fault else k
    end = min(k + round(4.0 / case.hz / DT), alarm.shape[1] - 1) if case.hz > 0 else alarm.shape[1] - 1
    last = log[LANE, end]
    surface = f"hydraulic.{SEGMENT}.delta"
    own = recorded[surface].to_numpy()
    moved = abs(own[at] - own[k]) if at is not None else math.nan
    away = abs(own[at] - twin[surface].to_numpy()[at]) if at is not None and twin is not None else math.nan
    return Outcome(
        early=bool(alarm[LANE, :before].any() or others.any()),
        delay=(at - k) * DT if at is not None else math.inf,
        first=verdict.class_name(log["verdict"][LANE, at]) if at is not None else "none",
        last=verdict.class_name(last["verdict"]),
        culprit=module.CULPRITS[int(last["culprit"])],
        hz=float(last["ofc_hz"]) if "ofc_hz" in fields else math.nan,
        deviation=float(moved),
        off=float(away),
    )


@functools.cache
def detectors() -> Any:
    """Return {name: (module, PARAMS)} as they fly, and the two other load forms of iotsekf."""
    out = {name: (module, module.params()) for name, module in MODULES.items()}
    return out | {f"iotsekf load {k}": (iotsekf, iotsekf.params(load=k)) for k in (1, 0)}


def fly_case(case: Any, seed: int, noise: Any = 1.0) -> dict[str, dict[str, bool | float | str]]:
    """Return {detector: Outcome as a dict} of one seed of a case, given as a dict."""
    made = Case(**case)
    flight = arguments(made, seed, noise)
    recorded = fly_hydraulic(**flight)
    twin = fly_hydraulic(**{**flight, "faults": []}) if made.deviation_deg > 0 else None
    return {name: asdict(judge(made, recorded, module, p, twin)) for name, (module, p) in detectors().items()}


def achieved(case: Any, seed: int) -> list[float | None]:
    """Return [u injected, rod amplitude [m] that an oscillation achieves against the same flight without the fault]."""
    made = Case(**case)
    flight = arguments(made, seed)
    faulty, twin = fly_hydraulic(**flight), fly_hydraulic(**{**flight, "faults": []})
    q = (faulty[f"hydraulic.{SEGMENT}.q_rod"] - twin[f"hydraulic.{SEGMENT}.q_rod"]).to_numpy()
    size = amplitude(q, 2 * math.pi * made.hz, T_FAULT, math.inf, DT)
    return [float(faulty[f"hydraulic_in.{SEGMENT}.f_u"].abs().max()), size]


def summary(case: Any, found: Any) -> Any:
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
        "off_max_deg": max((math.degrees(o.off) for o in found if math.isfinite(o.off)), default=math.nan),
    }
    if case.deviation_deg > 0:
        row["deviated"] = sum(math.degrees(o.deviation) > case.deviation_deg for o in found)
    if case.hz > 0:
        row["frequency_right"] = sum(
            o.last in case.right and abs(o.hz / case.hz - 1.0) <= 0.25 for o in found
        )
    return row

