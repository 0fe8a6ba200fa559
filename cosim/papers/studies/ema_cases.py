"""Flights of the study of names of EMA faults: on each segment a fault of its own, rigging and velocity bias.

How a flight is drawn: `cosim.papers.studies.naming`; what is asked of it: `cosim.papers.studies.ema_names`.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from actuators.ema import jay
from actuators.ema.record import TECHNOLOGY
from cosim.flight.gains import liquid_gain
from cosim.papers.studies import naming
from cosim.papers.studies.naming import HANDS, MOVING, faulty, free, log_uniform, signed
from cosim.scenario.catalog import SEGMENTS
from cosim.scenario.tolerance import toleranced
from cosim.training.flights import COMMAND, DT, EMA, ema_signals

NOMINAL = TECHNOLOGY.design(())
NO_LOAD = jay.LIMITS["elevator"][1] / jay.values()["K_B"]  # [rad/s]
# true screw [rad] and surface [rad], reference of the servo [rad] of each segment
TRUE = ("ema.{}.motor", "ema.{}.delta", "ema_servo.{}.r")
DRIVE_LEFT = 0.8  # of the drive's limit, at most, for an oscillation in it


def _sine(rng, kind, *, mm=(0.5, 2.0), hz=(0.5, 10.0), at="valve"):
    f, size = log_uniform(rng, *hz), log_uniform(rng, *mm)
    if at == "valve":
        omega = 2.0 * np.pi * f
        gain = TECHNOLOGY.solid_gain(omega, ()) if kind == "ofc_solid" else liquid_gain("ema", omega, DT, ())
        size = min(size, DRIVE_LEFT * gain * NOMINAL.drive * 1e3)
    return {"kind": kind, "at": at, "amplitude_mm": size, "frequency_hz": f}


DRAWS: dict[str, Callable[[Any], dict]] = {  # name -> fault table, of the segment or, with `part`, of a sensor of it
    "liquid": lambda r: _sine(r, "ofc_liquid"),
    "solid": lambda r: _sine(r, "ofc_solid"),
    "hardover": lambda r: {"kind": "hardover", "drive_pct": signed(r, 60.0, 100.0)},
    "runaway": lambda r: {"kind": "runaway", "rate_deg_s": signed(r, 5.0, 60.0)},
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
                        "drift_deg_s": float(r.choice([-1, 1])) * log_uniform(r, 0.02, 0.5)},
    "velocity": lambda r: {"part": "velocity", "kind": "bias", "bias_pct": float(r.choice([-2.0, 2.0]))},
    "velocity_scale": lambda r: {"part": "velocity", "kind": "scale", "scale": 1.25},
    "scale": lambda r: {"part": "position", "kind": "scale", "scale": 1.25},
    "position": lambda r: {"part": "position", "kind": "bias", "bias_deg": signed(r, 0.3, 5.0)},
    "position_ofc": lambda r: {"part": "position", "kind": "oscillation", "amplitude_mm": log_uniform(r, 0.8, 3.0),
                               "frequency_hz": log_uniform(r, 0.5, 10.0)},
    "surface": lambda r: {"part": "surface", "kind": "bias", "bias_deg": signed(r, 0.3, 1.5)},
    "current": lambda r: {"part": "current", "kind": "bias", "path": "monitor", "bias_pct": signed(r, 5.0, 15.0)},
    "current_scale": lambda r: {"part": "current", "kind": "scale", "path": "monitor", "scale": 1.25},
    "current_ofc": lambda r: {"part": "current", "kind": "oscillation", "path": "monitor",
                              "amplitude_a": log_uniform(r, 3.0, 10.0), "frequency_hz": log_uniform(r, 0.5, 10.0)},
    "velocity_noise": lambda r: {"part": "velocity", "kind": "noise", "sigma_rad_s": log_uniform(r, 5.0, 50.0)},
    "position_noise": lambda r: {"part": "position", "kind": "noise", "sigma_mm": log_uniform(r, 0.5, 3.0)},
    "current_noise": lambda r: {"part": "current", "kind": "noise", "path": "monitor",
                                "sigma_a": log_uniform(r, 1.0, 8.0)},
    "surface_noise": lambda r: {"part": "surface", "kind": "noise", "sigma_deg": log_uniform(r, 0.1, 0.6)},
}  # fmt: skip
WEAR = ("resistance", "magnets", "backlash", "resistance_160", "drive_loss", "free_float")
NOISE = ("velocity_noise", "position_noise", "current_noise", "surface_noise")
HEALED = ("liquid", "solid", "drive_loss", "position", "velocity", "current", "hardover", "jam", "magnets")
LOST = {"velocity": ("liquid", "position", "jam"), "position": ("liquid", "velocity", "jam"),
        "current": ("position", "velocity", "jam"), "surface": ("liquid", "position", "velocity")}  # fmt: skip


_fault = functools.partial(faulty, DRAWS)


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
        lane, size = _fault(rng, name), log_uniform(rng, low, high)
        most = lane["faults"][0].get(key, np.inf) if name == "liquid" else np.inf  # what the drive can do
        lane["faults"][0][key] = 1.0 + size if name == "scale" else min(size, most)
        out.append({**lane, "size": min(size, most)})
    return out, 30.0, HANDS


FAMILIES: dict[str, naming.Family] = {
    "drive": _drive, "wear": _wear, "moved": _moved, "sensor": _sensor, "monitor": _monitor, "lost": _lost,
    "noise": _noise, "free": free,
}  # fmt: skip
SWEPT = {name: functools.partial(swept, name) for name in SIZED}
OFF = {group: toleranced(group) for group in ("aero", "ema")}
SIGNALS = [*dict.fromkeys([*ema_signals(), COMMAND, *(path.format(lane) for lane in SEGMENTS for path in TRUE)])]


def flown(
    family: str, k: int, seed: int, reconfigure: bool = False, air: str | None = None
) -> tuple[Any, list[dict], str]:
    """Fly flight `k` of a family, a word of FAMILIES or of SIZED, in its own `air` where none is given; return (table
    of what the detectors read, segments, the air).
    """
    bias = lambda rng: {"velocity": {"bias_rad_s": signed(rng, 0.0, 1e-4) * NO_LOAD}}  # noqa: E731
    flight, lanes, rng = naming.drawn({**FAMILIES, **SWEPT}, family, k, seed, OFF, bias)
    flight["flight"]["turbulence"] = air or flight["flight"]["turbulence"]
    flight["elevator"] = {**dict.fromkeys(SEGMENTS, "ema"), "reconfigure": reconfigure}
    flight["detectors"] = {"enabled": list(EMA)}
    return naming.flown(flight, rng, SIGNALS), lanes, flight["flight"]["turbulence"]
