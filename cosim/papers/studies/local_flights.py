"""Flights of the study of names: points over the envelope, and on each hydraulic segment a fault of its own.

Points, gusts, noise x 1.2, tolerances of +-5 % and faults all come from the seed of the flight. Segments are judged one
by one: what they share is the aircraft's motion and its gusts. What is asked of them: `cosim.papers.studies.local`.
"""

import math
from typing import Any

import numpy as np

from cosim.errors import TrimError
from cosim.flight.signals import fly
from cosim.scenario import parse
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.tolerance import toleranced
from cosim.training.flights import COMMAND, HYDRAULIC, MODEL, envelope

ONSET = 12.0  # [s]
REFERENCE, ROD = "servo.{}.r", "hydraulic.{}.q_rod"  # of each segment, the servo's reference and the true rod [m]
NOISE_SCALE, TOLERANCE = 1.2, 0.05
AIR = ("none", "light", "moderate")
HANDS = (  # from calm to lively
    {"kind": "cruise"},
    {"kind": "nz_doublet", "amplitude_g": 0.15},
    {"kind": "three_two_one_one", "amplitude_deg": 1.5, "unit_s": 1.0},
    {"kind": "coordinated_turn", "duration_s": 15.0},
    {"kind": "nose_up", "amplitude_g": 0.15},
)
MOVING = HANDS[1:3]  # a jam shows only where the surface is asked to move
FREE_S = 60.0  # of a flight without faults


def _log(rng, low, high):
    return float(low * (high / low) ** rng.uniform())


def _sine(rng, kind, *, mm, hz=(0.5, 10.0), at="valve"):
    size = mm if isinstance(mm, float) else _log(rng, *mm)
    return {"kind": kind, "at": at, "amplitude_mm": size, "frequency_hz": _log(rng, *hz)}


def _either(rng, low, high):
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


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
    "runaway": lambda r: {"kind": "runaway", "rate_deg_s": _either(r, 3.0, 40.0)},
    "jam": lambda r: {"kind": "jam_solid"},
    "rod": lambda r: {"part": "rod", "kind": "bias", "bias_mm": _either(r, 0.8, 5.0)},
    "surface": lambda r: {"part": "surface", "kind": "bias", "bias_deg": _either(r, 0.15, 1.0)},
    "air": lambda r: {"kind": "air_in_oil", "loss_pct": float(r.uniform(50.0, 95.0))},
    "leakage": lambda r: {"kind": "internal_leakage", "leakage_pct": float(r.uniform(10.0, 60.0))},
    "supply": lambda r: {"kind": "supply_pressure_drop", "loss_pct": float(r.uniform(30.0, 70.0))},
    "valve_loss": lambda r: {"kind": "loss_of_effectiveness", "at": "valve", "loss_pct": float(r.uniform(30.0, 80.0))},
    "free_float": lambda r: {"kind": "free_float"},
    "backlash": lambda r: {"kind": "backlash", "backlash_mm": float(r.uniform(0.8, 4.0))},
    "rod_noise": lambda r: {"part": "rod", "kind": "noise", "sigma_mm": _log(r, 0.5, 3.0)},
    "pressure_noise": lambda r: {"part": "pressure", "kind": "noise", "sigma_pct": _log(r, 3.0, 20.0)},
}
DEGRADATIONS = ("air", "leakage", "supply", "valve_loss", "free_float", "backlash")
NOISES = ("rod_noise", "pressure_noise")
LOST = {"pressure": ("jam", "liquid", "rod"), "surface": ("jam", "liquid", "rod"), "rod": ("jam", "liquid", "surface")}
FIRST = ("rod", "surface")
SECOND = ("runaway", "jam", "liquid")


def _fault(rng, name, *, heal=None, start=ONSET):
    fault = {"start_s": start + (0.0 if start != ONSET else float(rng.uniform(0.0, 1.0))), **DRAWS[name](rng)}
    if heal is not None:
        periods = 4.0 / fault.get("frequency_hz", math.inf)
        fault["end_s"] = fault["start_s"] + max(heal, periods)
    return {"name": name, "healed": heal is not None, "faults": [fault]}


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


def _free(rng, k):
    """Return four healthy segments."""
    return [{"name": "none", "healed": False, "faults": []} for _ in SEGMENTS], FREE_S, HANDS


def _large(rng, k):
    """Return two large oscillations of each kind, over all frequencies; one of them heals."""
    return [_fault(rng, "large_liquid"), _fault(rng, "large_solid"), _fault(rng, "large_solid"),
            _fault(rng, "large_liquid", heal=5.0)], 55.0, HANDS


FAMILIES = {"mixed": _mixed, "moved": _moved, "slow": _slow, "lost": _lost, "second": _second, "free": _free,
            "large": _large}  # the order is part of the seed


def drawn(family: str, k: int, seed: int) -> tuple[Any, ...]:
    """Return (scenario parts of flight `k` of a family, [segment: name, healed, faults]); `seed` decides all."""
    rng = np.random.default_rng([seed, list(FAMILIES).index(family), k])
    lanes, duration, hands = FAMILIES[family](rng, k)
    lanes = [lanes[i] for i in rng.permutation(4)]
    manoeuvre = {**hands[rng.integers(len(hands))]}
    if manoeuvre["kind"] != "cruise":
        manoeuvre["start_s"] = float(rng.uniform(ONSET - 2.0, ONSET + 4.0) if family != "free" else rng.uniform(5, 30))
    off = {g: {n: float(1 + TOLERANCE * rng.uniform(-1, 1)) for n in names}
           for g, names in (("aero", toleranced("aero")), ("hydraulic", MODEL))}
    faults = [{"target": f"elevator.{lane}" + (f".{fault['part']}" if "part" in fault else ""),
               **{key: v for key, v in fault.items() if key != "part"}}
              for lane, own in zip(SEGMENTS, lanes) for fault in own["faults"]]
    flight = {"duration_s": duration, "manoeuvre": manoeuvre, "seed": seed + k, "tolerances": off, "faults": faults,
              "sensors": {"noise_scale": NOISE_SCALE}, "flight": {**envelope(rng), "turbulence": AIR[k % 3]}}
    return flight, lanes, rng


def flown(family: str, k: int, seed: int, feedback: str = "measured") -> tuple[Any, ...]:
    """Fly it; return (table of what the detectors read, segments, the air); points that do not trim are drawn anew."""
    flight, lanes, rng = drawn(family, k, seed)
    signals = [*(path.format(lane) for lane in SEGMENTS for path in (*HYDRAULIC, REFERENCE)), COMMAND]
    elevator = {**dict.fromkeys(SEGMENTS, "hydraulic"), "feedback": feedback}
    while True:
        made = parse({"title": family, **flight, "elevator": elevator, "detectors": {"enabled": ["iotsekf"]}})
        try:
            return fly(made, signals), lanes, flight["flight"]["turbulence"]
        except TrimError:
            flight["flight"] |= envelope(rng)
