"""Flights of the study of names: on each hydraulic segment a fault of its own.

How a flight is drawn: `cosim.papers.studies.naming`; what is asked of it: `cosim.papers.studies.local`.
"""

import functools
from typing import Any

from cosim.papers.studies import naming
from cosim.papers.studies.naming import HANDS, MOVING, faulty, free, log_uniform, signed
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.tolerance import toleranced
from cosim.training.flights import COMMAND, HYDRAULIC, MODEL

REFERENCE, ROD = "servo.{}.r", "hydraulic.{}.q_rod"  # of each segment, the servo's reference and the true rod [m]


def _sine(rng, kind, *, mm, hz=(0.5, 10.0), at="valve"):
    size = mm if isinstance(mm, float) else log_uniform(rng, *mm)
    return {"kind": kind, "at": at, "amplitude_mm": size, "frequency_hz": log_uniform(rng, *hz)}


SIZED = (0.5, 2.0)  # [mm]
LARGE = (2.0, 10.0)
SLOW_HZ = (0.1, 0.45)
DRAWS = {  # name -> (rng) -> fault table, of the segment or, with `part`, of a sensor of it
    "liquid": lambda r: _sine(r, "ofc_liquid", mm=SIZED),
    "solid": lambda r: _sine(r, "ofc_solid", mm=SIZED),
    "sensor_ofc": lambda r: _sine(r, "ofc_liquid", mm=SIZED, at="sensor"),
    "liquid_0.3": lambda r: _sine(r, "ofc_liquid", mm=0.3),
    "liquid_0.2": lambda r: _sine(r, "ofc_liquid", mm=0.2),
    "slow_liquid": lambda r: _sine(r, "ofc_liquid", mm=(2.0, 6.0), hz=SLOW_HZ),
    "slow_solid": lambda r: _sine(r, "ofc_solid", mm=(2.0, 6.0), hz=SLOW_HZ),
    "large_liquid": lambda r: _sine(r, "ofc_liquid", mm=LARGE, hz=(0.1, 10.0)),
    "large_solid": lambda r: _sine(r, "ofc_solid", mm=LARGE, hz=(0.1, 10.0)),
    "runaway": lambda r: {"kind": "runaway", "rate_deg_s": signed(r, 3.0, 40.0)},
    "jam": lambda r: {"kind": "jam_solid"},
    "rod": lambda r: {"part": "rod", "kind": "bias", "bias_mm": signed(r, 0.8, 5.0)},
    "surface": lambda r: {"part": "surface", "kind": "bias", "bias_deg": signed(r, 0.15, 1.0)},
    "air": lambda r: {"kind": "air_in_oil", "loss_pct": float(r.uniform(50.0, 95.0))},
    "leakage": lambda r: {"kind": "internal_leakage", "leakage_pct": float(r.uniform(10.0, 60.0))},
    "supply": lambda r: {"kind": "supply_pressure_drop", "loss_pct": float(r.uniform(30.0, 70.0))},
    "valve_loss": lambda r: {"kind": "loss_of_effectiveness", "at": "valve", "loss_pct": float(r.uniform(30.0, 80.0))},
    "free_float": lambda r: {"kind": "free_float"},
    "backlash": lambda r: {"kind": "backlash", "backlash_mm": float(r.uniform(0.8, 4.0))},
    "rod_noise": lambda r: {"part": "rod", "kind": "noise", "sigma_mm": log_uniform(r, 0.5, 3.0)},
    "pressure_noise": lambda r: {"part": "pressure", "kind": "noise", "sigma_pct": log_uniform(r, 3.0, 20.0)},
}
DEGRADATIONS = ("air", "leakage", "supply", "valve_loss", "free_float", "backlash")
NOISES = ("rod_noise", "pressure_noise")
LOST = {"pressure": ("jam", "liquid", "rod"), "surface": ("jam", "liquid", "rod"), "rod": ("jam", "liquid", "surface")}
FIRST = ("rod", "surface")
SECOND = ("runaway", "jam", "liquid")


_fault = functools.partial(faulty, DRAWS)


def _mixed(rng, k):
    """Return four segments: an oscillation, one that heals, a degradation or a noise, a small oscillation."""
    rest = (*DEGRADATIONS, *NOISES)
    return [_fault(rng, ("liquid", "solid", "sensor_ofc")[k % 3]),
            _fault(rng, ("solid", "liquid")[k % 2], heal=5.0),
            _fault(rng, rest[k % len(rest)]),
            _fault(rng, ("liquid_0.3", "liquid_0.2")[k // 3 % 2])], 30.0, HANDS


def _moved(rng, k):
    """Return a runaway, a jam, and one of each that heals."""
    return [_fault(rng, "runaway"), _fault(rng, "jam"), _fault(rng, "runaway", heal=2.0),
            _fault(rng, "jam", heal=5.0)], 30.0, MOVING


def _slow(rng, k):
    """Return slow oscillations, one of them healed, and one at the edge of the bank."""
    return [_fault(rng, "slow_liquid"), _fault(rng, "slow_solid"), _fault(rng, ("slow_solid", "slow_liquid")[k % 2],
            heal=5.0), _fault(rng, ("liquid_0.2", "liquid_0.3")[k % 2])], 60.0, HANDS


def _lost(rng, k):
    """Return a lost sensor on each of three segments, each with a fault 7 s later; a rod bias on the fourth."""
    out = []
    for i, (part, then) in enumerate(LOST.items()):
        lane = _fault(rng, then[(k + i) % len(then)])
        lane["faults"].insert(0, {"part": part, "kind": "dropout", "start_s": 5.0})
        out.append({**lane, "lost": part})
    return [*out, _fault(rng, ("rod", "surface")[k % 2])], 28.0, MOVING


def _second(rng, k):
    """Return a sensor's bias at 5 s and a fault of the actuator later, on three segments; a sensor oscillation."""
    out = []
    for i, then in enumerate(SECOND):
        lane = _fault(rng, then)
        lane["faults"].insert(0, {**DRAWS[FIRST[(k + i) % 2]](rng), "start_s": 5.0})
        out.append({**lane, "first": FIRST[(k + i) % 2]})
    return [*out, _fault(rng, "sensor_ofc")], 26.0, MOVING


def _large(rng, k):
    """Return two large oscillations of each kind, over all frequencies; one of them heals."""
    return [_fault(rng, "large_liquid"), _fault(rng, "large_solid"), _fault(rng, "large_solid"),
            _fault(rng, "large_liquid", heal=5.0)], 55.0, HANDS


FAMILIES = {"mixed": _mixed, "moved": _moved, "slow": _slow, "lost": _lost, "second": _second, "free": free,
            "large": _large}  # the order is part of the seed
OFF = {"aero": toleranced("aero"), "hydraulic": MODEL}
SIGNALS = [*(path.format(lane) for lane in SEGMENTS for path in (*HYDRAULIC, REFERENCE)), COMMAND]


def flown(family: str, k: int, seed: int, feedback: str = "measured") -> tuple[Any, list[dict], str]:
    """Fly flight `k` of a family; return (table of what the detectors read, segments, the air)."""
    flight, lanes, rng = naming.drawn(FAMILIES, family, k, seed, OFF)
    flight["elevator"] = {**dict.fromkeys(SEGMENTS, "hydraulic"), "feedback": feedback}
    flight["detectors"] = {"enabled": ["iotsekf"]}
    return naming.flown(flight, rng, SIGNALS), lanes, flight["flight"]["turbulence"]
