"""Flights of the study of names of EMA faults: points over the envelope, and on each segment a fault of its own.

Points, gusts, noise x 1.2, tolerances of +-5 % (of every symbol of the drive; arm and lead 0.3 %), rigging, velocity
bias and faults all come from the seed of the flight.
Segments are judged one by one. What is asked of them: `cosim.papers.studies.ema_names`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.ema import jay
from actuators.ema.record import TECHNOLOGY
from cosim.errors import TrimError
from cosim.flight.gains import liquid_gain
from cosim.flight.signals import fly
from cosim.papers.studies.local_flights import AIR, FREE_S, HANDS, MOVING, NOISE_SCALE, ONSET, TOLERANCE
from cosim.scenario import parse
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.tolerance import toleranced
from cosim.training.flights import COMMAND, DT, EMA, ema_signals, envelope

EXACT = {"arm": 0.003, "lead": 0.003}  # what is machined is off by less
NOMINAL = TECHNOLOGY.design(())
# true screw [rad] and surface [rad], reference of the servo [rad] of each segment
TRUE = ("ema.{}.motor", "ema.{}.delta", "ema_servo.{}.r")
DRIVE_LEFT = 0.8  # of the drive's limit, at most, for an oscillation in it


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.uniform())


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))


def _sine(rng, kind, *, mm=(0.5, 2.0), hz=(0.5, 10.0), at="valve"):
    f, size = _log(rng, *hz), _log(rng, *mm)
    if at == "valve":
        omega = 2.0 * np.pi * f
        gain = TECHNOLOGY.solid_gain(omega, ()) if kind == "ofc_solid" else liquid_gain("ema", omega, DT, ())
        size = min(size, DRIVE_LEFT * gain * NOMINAL.drive * 1e3)
    return {"kind": kind, "at": at, "amplitude_mm": size, "frequency_hz": f}


DRAWS: dict[str, Callable[[Any], dict]] = {  # name -> fault table, of the segment or, with `part`, of a sensor of it
    "liquid": lambda r: _sine(r, "ofc_liquid"),
    "solid": lambda r: _sine(r, "ofc_solid"),
    "hardover": lambda r: {"kind": "hardover", "drive_pct": _either(r, 60.0, 100.0)},
    "runaway": lambda r: {"kind": "runaway", "rate_deg_s": _either(r, 5.0, 60.0)},
    "jam": lambda r: {"kind": "jam_solid"},
    "screw": lambda r: {"kind": "jam"},
    "resistance": lambda r: {"kind": "winding_resistance", "increase_pct": 80.0},
    "resistance_160": lambda r: {"kind": "winding_resistance", "increase_pct": 160.0},
    "magnets": lambda r: {"kind": "magnet_loss", "loss_pct": 40.0},
    "backlash": lambda r: {"kind": "backlash", "backlash_mm": float(r.uniform(0.8, 4.0))},
    "drive_loss": lambda r: {"kind": "loss_of_effectiveness", "at": "valve", "loss_pct": float(r.uniform(30.0, 100.0))},
    "command_loss": lambda r: {"kind": "loss_of_effectiveness", "at": "command",
                               "loss_pct": float(r.uniform(50.0, 100.0))},
    "free_float": lambda r: {"kind": "free_float"},
    "drift": lambda r: {"part": "position", "kind": "drift",
                        "drift_deg_s": float(r.choice([-1, 1])) * _log(r, 0.02, 0.5)},
    "velocity": lambda r: {"part": "velocity", "kind": "bias", "bias_pct": float(r.choice([-2.0, 2.0]))},
    "velocity_scale": lambda r: {"part": "velocity", "kind": "scale", "scale": 1.25},
    "scale": lambda r: {"part": "position", "kind": "scale", "scale": 1.25},
    "position": lambda r: {"part": "position", "kind": "bias", "bias_deg": _either(r, 0.3, 5.0)},
    "position_ofc": lambda r: {"part": "position", "kind": "oscillation", "amplitude_mm": _log(r, 0.8, 3.0),
                               "frequency_hz": _log(r, 0.5, 10.0)},
    "surface": lambda r: {"part": "surface", "kind": "bias", "bias_deg": _either(r, 0.3, 1.5)},
    "current": lambda r: {"part": "current", "kind": "bias", "path": "monitor", "bias_pct": _either(r, 5.0, 15.0)},
    "current_scale": lambda r: {"part": "current", "kind": "scale", "path": "monitor", "scale": 1.25},
    "current_ofc": lambda r: {"part": "current", "kind": "oscillation", "path": "monitor",
                              "amplitude_a": _log(r, 3.0, 10.0), "frequency_hz": _log(r, 0.5, 10.0)},
    "velocity_noise": lambda r: {"part": "velocity", "kind": "noise", "sigma_rad_s": _log(r, 5.0, 50.0)},
    "position_noise": lambda r: {"part": "position", "kind": "noise", "sigma_mm": _log(r, 0.5, 3.0)},
    "current_noise": lambda r: {"part": "current", "kind": "noise", "path": "monitor", "sigma_a": _log(r, 1.0, 8.0)},
    "surface_noise": lambda r: {"part": "surface", "kind": "noise", "sigma_deg": _log(r, 0.1, 0.6)},
}  # fmt: skip
WEAR = ("resistance", "magnets", "backlash", "resistance_160", "drive_loss", "free_float")
NOISE = ("velocity_noise", "position_noise", "current_noise", "surface_noise")
HEALED = ("liquid", "solid", "drive_loss", "position", "velocity", "current", "hardover", "jam", "magnets")
LOST = {"velocity": ("liquid", "position", "jam"), "position": ("liquid", "velocity", "jam"),
        "current": ("position", "velocity", "jam"), "surface": ("liquid", "position", "velocity")}  # fmt: skip


def _fault(rng, name, *, heal=None):
    fault = {"start_s": ONSET + float(rng.uniform(0.0, 1.0)), **DRAWS[name](rng)}
    if heal is not None:
        fault["end_s"] = fault["start_s"] + max(heal, 4.0 / fault.get("frequency_hz", np.inf))
    return {"name": name, "healed": heal is not None, "faults": [fault]}


def _drive(rng, k):
    """Return an oscillation of each kind, a hardover, and one of them that heals."""
    return [_fault(rng, "liquid"), _fault(rng, "solid"), _fault(rng, "hardover"),
            _fault(rng, ("liquid", "solid", "hardover")[k % 3], heal=5.0)], 30.0, HANDS


def _wear(rng, k):
    """Return what wears or breaks between demand and surface."""
    names = [WEAR[(k + i) % len(WEAR)] for i in range(4)]
    return [_fault(rng, n) for n in names], 30.0, (HANDS, MOVING)[k % 2]


def _moved(rng, k):
    """Return what the surface does not follow: at the command, and where it is held."""
    names = ("command_loss", "runaway", ("jam", "screw")[k % 2])
    heals = ("runaway", "jam", "drive_loss", "command_loss")[k % 4]
    return [*(_fault(rng, n) for n in names), _fault(rng, heals, heal=5.0)], 30.0, MOVING


def _sensor(rng, k):
    """Return faults of the sensors in the servo's loop: the incipient ones, and the position's scale."""
    names = ("drift", "velocity", "scale", ("position", "position_ofc", "velocity_scale", "surface")[k % 4])
    return [_fault(rng, n) for n in names], 60.0, HANDS


def _monitor(rng, k):
    """Return faults of the monitor's current sensor, and two that heal."""
    return [_fault(rng, ("current", "current_ofc")[k % 2]), _fault(rng, ("current_scale", "current_ofc")[k % 2]),
            _fault(rng, HEALED[k % 9], heal=5.0), _fault(rng, HEALED[(k + 4) % 9], heal=5.0)], 30.0, HANDS  # fmt: skip


def _lost(rng, k):
    """Return a lost sensor on each segment, each with a fault 7 s later."""
    out = []
    for part, then in LOST.items():
        lane = _fault(rng, then[k % len(then)])
        lane["faults"].insert(0, {"part": part, "kind": "dropout", "start_s": 5.0})
        out.append({**lane, "lost": part})
    return out, 28.0, MOVING


def _noise(rng, k):
    """Return a sensor that has become noisy, on each segment another."""
    return [_fault(rng, n) for n in NOISE], 30.0, HANDS


def _free(rng, k):
    """Return four healthy segments."""
    return [{"name": "none", "healed": False, "faults": []} for _ in SEGMENTS], FREE_S, HANDS


SIZED = {  # fault -> (key, least, largest size), for probabilities of detection
    "resistance": ("increase_pct", 20.0, 200.0), "magnets": ("loss_pct", 5.0, 60.0),
    "backlash": ("backlash_mm", 0.2, 4.0), "drive_loss": ("loss_pct", 5.0, 100.0),
    "liquid": ("amplitude_mm", 0.01, 1.0), "velocity": ("bias_pct", 0.05, 4.0), "scale": ("scale", 0.02, 0.5),
    "position": ("bias_deg", 0.02, 1.0),
}  # fmt: skip


def swept(name: str, rng: np.random.Generator, k: int) -> tuple[list[dict], float, Any]:
    """Return a fault `name` of one size on each of four segments; a scale's size is its factor less 1."""
    key, low, high = SIZED[name]
    out = []
    for _ in range(4):
        lane, size = _fault(rng, name), _log(rng, low, high)
        most = lane["faults"][0].get(key, np.inf) if name == "liquid" else np.inf  # what the drive can do
        lane["faults"][0][key] = 1.0 + size if name == "scale" else min(size, most)
        out.append({**lane, "size": min(size, most)})
    return out, 30.0, HANDS


FAMILIES = {"drive": _drive, "wear": _wear, "moved": _moved, "sensor": _sensor, "monitor": _monitor, "lost": _lost,
            "noise": _noise, "free": _free}  # fmt: skip


def drawn(family: str, k: int, seed: int) -> tuple[Any, ...]:
    """Return (scenario parts of flight `k` of a family, [segment: name, healed, faults], rng); `seed` decides all.

    A family is a word of FAMILIES, or a fault of SIZED.
    """
    rng = np.random.default_rng([seed, [*FAMILIES, *SIZED].index(family), k])
    lanes, duration, hands = FAMILIES[family](rng, k) if family in FAMILIES else swept(family, rng, k)
    lanes = [lanes[i] for i in rng.permutation(4)]
    manoeuvre = {**hands[rng.integers(len(hands))]}
    if manoeuvre["kind"] != "cruise":
        manoeuvre["start_s"] = float(rng.uniform(ONSET - 2.0, ONSET + 4.0) if family != "free" else rng.uniform(5, 30))
    off = {g: {n: float(1 + EXACT.get(n, TOLERANCE) * rng.uniform(-1, 1)) for n in toleranced(g)}
           for g in ("aero", "ema")}  # fmt: skip
    faults = [{"target": f"elevator.{lane}" + (f".{fault['part']}" if "part" in fault else ""),
               **{key: v for key, v in fault.items() if key != "part"}}
              for lane, own in zip(SEGMENTS, lanes) for fault in own["faults"]]  # fmt: skip
    no_load = jay.LIMITS["elevator"][1] / jay.values()["K_B"]
    sensors = {"velocity": {"bias_rad_s": _either(rng, 0.0, 1e-4) * no_load}, "noise_scale": NOISE_SCALE}
    flight = {"duration_s": duration, "manoeuvre": manoeuvre, "seed": seed + k, "tolerances": off, "faults": faults,
              "sensors": sensors, "flight": {**envelope(rng), "turbulence": AIR[k % 3]}}
    return flight, lanes, rng


def signals() -> list[str]:
    """Return what the detectors of four segments read, and what is true there."""
    return list(dict.fromkeys([*ema_signals(), COMMAND, *(path.format(lane) for lane in SEGMENTS for path in TRUE)]))


def flown(
    family: str, k: int, seed: int, reconfigure: bool = False, air: str | None = None
) -> tuple[Any, list[dict], str]:
    """Fly it; return (table of what the detectors read, segments, the air); points that do not trim are drawn anew."""
    flight, lanes, rng = drawn(family, k, seed)
    flight["flight"]["turbulence"] = air or flight["flight"]["turbulence"]
    elevator = {**dict.fromkeys(SEGMENTS, "ema"), "reconfigure": reconfigure}
    while True:
        made = parse({"title": family, **flight, "elevator": elevator, "detectors": {"enabled": list(EMA)}})
        try:
            return fly(made, signals()), lanes, flight["flight"]["turbulence"]
        except TrimError:
            flight["flight"] |= envelope(rng)
