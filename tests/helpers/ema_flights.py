"""EMA sensor faults in flight: reconfigured, not reconfigured, and against the same flight without the fault.

The left inner segment is faulty in a 3-2-1-1 of 4 deg and light turbulence, two of the four segments are
electromechanical, all coefficients of aircraft and actuator are up to 5 % off. The sensor set has no bias of motor
velocity and no rigging of the position sensor: here they have 1e-4 of no-load, and what the set gives a surface sensor.
"""

from pathlib import Path
from typing import Any

import numpy as np

from actuators.constants import RAD_PER_DEG
from actuators.ema import jay
from cosim.flight.loop.signals import fly
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import DT, POINT, TOLERANCE, draw, scenario
from fdi.common import verdict
from fdi.ema.ema_kalman_flight import CULPRITS

ARM, LEAD = jay.values()["arm"], jay.values()["lead"]
NO_LOAD = jay.LIMITS["elevator"][1] / jay.values()["K_B"]  # [rad/s]
SYMBOLS = ("K_T", "K_B", "R", "J_M", "J_N", "B_M")
ONSET, NZ_S, LOOK_S = 12.0, 30.0, 60.0  # [s]
SETTLE_S = 2.0
PULSES = {"kind": "three_two_one_one", "start_s": 10.0, "unit_s": 1.5, "amplitude_deg": 4.0}
POSITION: dict[str, dict] = {
    "position + 5 deg": {"kind": "bias", "bias_deg": 5.0},
    "position + 15 deg": {"kind": "bias", "bias_deg": 15.0},
    "position frozen": {"kind": "freeze"},
}
CURRENT: dict[str, dict] = {
    "current + 10 % of stall": {"kind": "bias", "bias_pct": 10.0},
    "current - 10 % of stall": {"kind": "bias", "bias_pct": -10.0},
    "current x1.25": {"kind": "scale", "scale": 1.25},
    "current frozen": {"kind": "freeze"},
}
FILTER = ("pos_hat", "reconf", "verdict", "culprit", "valid")
SIGNALS = ("truth.aircraft.nz", "ema.left_inner.delta", "ema.left_inner.motor",
           *(f"ema_kalman_flight.left_inner.{name}" for name in FILTER))


def flown(
    seed: int,
    fault: Any = None,
    *,
    reconfigure: Any = True,
    bias: float = 1e-4,
    noise: float = 1.0,
    duration: Any = ONSET + NZ_S,
) -> dict[str, Any]:
    """Return {signal: (ticks,)} of one flight; `bias` of the motor velocity over no-load."""
    rng = np.random.default_rng(seed)
    arguments = draw(seed, point=POINT, manoeuvre=PULSES, turbulence="light", duration=duration)
    aero = arguments.pop("tolerances")["aero"]
    off = {name: float(1 + TOLERANCE * rng.uniform(-1, 1)) for name in SYMBOLS}
    rigging = 0.08 * float(rng.uniform(-1, 1))  # [deg]
    sensors = {"velocity": {"bias_rad_s": float(rng.choice([-1.0, 1.0])) * bias * NO_LOAD},
               "position": {"bias_mm": rigging * RAD_PER_DEG * ARM * 1e3}, "noise_scale": noise}
    elevator = {**dict(zip(SEGMENTS, ("hydraulic", "ema", "ema", "hydraulic"))), "reconfigure": reconfigure}
    v = fly(scenario(**arguments, faults=[fault] if fault else [], elevator=elevator, sensors=sensors,
                     tolerances={"aero": aero, "ema": off}, detectors={"enabled": ["ema_kalman_flight"]}), SIGNALS)
    return {name.rpartition(".")[2]: v[name].to_numpy() for name in SIGNALS}


def position_fault(name: str, seed: int, noise: float = 1.0) -> dict[str, bool | float | str | None]:
    """Return n_z, surface and estimate against the same flight without the fault, with and without reconfiguration.

    dnz, dnz_without [g] over 30 s; surface_deg: largest distance from the twin's surface from 2 s after the switch on,
    for 60 s; estimate_deg: of pos_hat from the screw's true position in that time; named, delay_s, valid.
    """
    fault = {"target": "elevator.left_inner.position", "start_s": ONSET, **POSITION[name]}
    whole = ONSET + SETTLE_S + LOOK_S + 2.0
    healthy = flown(seed, noise=noise, duration=whole)
    faulty = flown(seed, fault, noise=noise, duration=whole)
    without = flown(seed, fault, noise=noise, reconfigure=False)
    look = slice(round(ONSET / DT), round((ONSET + NZ_S) / DT))
    switched = faulty["reconf"] > 0.5
    k = int(np.argmax(switched)) if switched.any() else len(switched)
    late = slice(k + round(SETTLE_S / DT), k + round((SETTLE_S + LOOK_S) / DT))
    error = faulty["pos_hat"][2:] - LEAD * faulty["motor"][:-2]  # a row holds the motor of the tick's end
    n = min(len(without["nz"]), look.stop)
    return {
        "dnz": float(np.abs(faulty["nz"] - healthy["nz"])[look].max()),
        "dnz_without": float(np.abs(without["nz"][:n] - healthy["nz"][:n])[look.start:].max()),
        "departed_without": len(without["nz"]) < look.stop,
        "surface_deg": float(np.abs(faulty["delta"] - healthy["delta"])[late].max(initial=0.0) / RAD_PER_DEG),
        "estimate_deg": float(np.abs(error)[late].max(initial=0.0) / ARM / RAD_PER_DEG),
        "reconfigured": bool(switched.any()),
        "delay_s": (k - look.start) * DT if switched.any() else None,
        "named": CULPRITS[int(faulty["culprit"][k])] if switched.any() else "none",
        "valid": bool((faulty["valid"][late] > 0.5).all()),
    }


def loop_fault(name: str, seed: int, path: str | Path, noise: float = 1.0) -> dict[str, bool | float | list[str]]:
    """Return what a current fault does, in the drive's own loop or on the monitor's copy: verdicts, n_z, surface."""
    fault = {"target": "elevator.left_inner.current", "start_s": ONSET, "path": path, **CURRENT[name]}
    healthy, faulty = flown(seed, noise=noise), flown(seed, fault, noise=noise)
    k = round(ONSET / DT)
    said = [verdict.class_name(v) for v in faulty["verdict"][k:]]
    culprits = [CULPRITS[int(c)] for c in faulty["culprit"][k:]]
    names = dict.fromkeys(f"{v} {c}".strip() for v, c in zip(said, culprits) if v != "none")
    return {
        "names": list(names) or ["none"],
        "reconfigured": bool((faulty["reconf"] > 0.5).any()),
        "dnz": float(np.abs(faulty["nz"] - healthy["nz"])[k:].max()),
        "surface_deg": float(np.abs(faulty["delta"] - healthy["delta"])[k:].max() / RAD_PER_DEG),
    }
