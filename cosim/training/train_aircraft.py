"""Thresholds of the aircraft-level detectors from fault-free flights: `python -m cosim.training aircraft`.

FLIGHTS of 60 s at points drawn over mass, CG, altitude and speed, eight manoeuvres, four airs, every aerodynamic
coefficient 5 % up or down, noise NOISE_SCALE. Each statistic is held against what it may grow
with, all of it measured (`cosim.training.threshold_fit`), at one PROBABILITY (RARE) of a false alarm per flight and
detector, shared among what it tests.
"""

import math
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from cosim.flight.blocks.sensors import TRANSPORT as SENSORS
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft, multipliers
from cosim.training import train_rfafe
from cosim.training.flights import (
    AIR,
    FLIGHT_S,
    LEVEL,
    NOISE_SCALE,
    TOLERANCE,
    drawn_manoeuvre,
    fits,
    fitted,
    fly_level,
    reach,
    trimming,
)
from cosim.training.threshold_fit import HELD, LEAST, PROBABILITY, blocks, limit
from cosim.training.trainer import Limits, Training, decimals
from fdi import registry
from fdi.control_redundancy.core import NR
from fdi.kinematic import signatures
from fdi.lpv_smo.lpv_smo import LEFT

# what each is trained in; the others' estimates are not made for severe air
TRAINED_IN = dict.fromkeys(LEVEL, AIR[:3]) | {"kinematic": AIR}
LPV_PARTS = ("elevator", "n_z", "alpha")
LPV_FIELDS = ("limit", "limit_gust", "limit_away")
# in place of PROBABILITY, shared by four tests
RARE = {"lpv_smo": 8e-5}
LARGEST = {"gust_max"}
# of the median of lpv_smo's estimate of the elevators, its limit's constant: what a protection leaves in it is seen
# neither in gusts nor in the angle of attack; with LEAST 2 of 352 other flights alarmed, long after one
CONSTANT = 3.0
LPV = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha", "rms", "apart", "valid")
FLOOR = 0.5  # of an accelerometer's noise: five sigma of its mean over half a second [g]
FLIGHTS, FIRST_SEED = 384, 31_000
OTHERS, OTHERS_SEED = 128, 41_000  # of another aircraft


def arguments(index: int, first_seed: int = FIRST_SEED, aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the arguments of `flights.scenario` of training flight `index`: manoeuvre, air and layout in turn."""
    own, rng = load_aircraft(aircraft), np.random.default_rng([first_seed, index])
    fixed: dict[str, Any] = {
        "duration": FLIGHT_S, "manoeuvre": drawn_manoeuvre(index, first_seed), "seed": first_seed + index,
        "technology": elevators(index, own), "sensors": {"noise_scale": NOISE_SCALE}, "aircraft": aircraft,
        "tolerances": {"aero": {n: float(1 + TOLERANCE * rng.choice((-1, 1))) for n in multipliers(own.folder)}},
    }  # fmt: skip
    return trimming(rng, fixed, {"turbulence": air(index)})


def survey_lpv_smo(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of the three estimates and of an oscillation: 1, rms of gusts, distance from where offsets were
    learned; of the last less what its limit has of gusts at its frequency already."""
    log = watched(frame, "lpv_smo", p, LPV)
    features = [1.0, log["rms"], log["apart"]]
    hold, valid, dt = HELD * float(p["t_confirm"][0]), log["valid"] > 0.5, frame.attrs["dt"]
    out = {part: blocks(np.abs(log[f"f_hat_{part}"]), features, valid, dt, hold) for part in LPV_PARTS}
    q = p.copy()
    for part in ("limit", "gust", "away"):  # the shape of an oscillation is asked, its size is what is found
        q[f"swing_{part}"] = 0.0
    fits = watched(frame, "lpv_smo", q, ("bank_cos", "bank_sin", "bank_new", "hit"))
    size = np.hypot(fits["bank_cos"], fits["bank_sin"])  # (ticks, 2, frequencies): of the estimate, of gusts
    passed = (fits["hit"] >= p["hits"][0] - 1.0) & (fits["bank_new"] > 0.5)
    found = np.where(passed, size[:, 0] - LEFT * size[:, 1], 0.0)
    swings = [blocks(found[:, k], features, valid, dt) for k in range(found.shape[1])]
    return out | {"swing": np.concatenate(swings)}  # one limit for all frequencies: few flights pass the shape of each


def over_rows(frame: pd.DataFrame, log: np.ndarray) -> list[tuple[np.ndarray, list]]:
    """Return (statistic (ticks,), what its limit grows with) of every row of kinematic: the residual less what the
    limit has of the wind's doubt already, and the terms that `fields` gives weights. Units of the row."""
    speed = frame[sources("kinematic")["v_ground"]].to_numpy()
    doubt = {signatures.CLIMB + k: log["doubt"][:, k] for k in range(3)}
    out = []
    for i in range(signatures.NR):
        lateral = log["lateral"][:, i]
        side = [lateral * speed, lateral * log["rough"]] if i in doubt else []  # climb, turn and speed
        out.append((np.abs(log["res"][:, i]) - doubt.get(i, 0.0), [1.0, log["rough"], *side]))
    return out


def survey_kinematic(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of each row, of its jumps, and of the noise of all readings."""
    log = watched(frame, "kinematic", p, ("res", "raw", "lateral", "doubt", "rough", "valid", "ratio"))
    valid, dt = log["valid"] > 0.5, frame.attrs["dt"]
    out = {}
    for i, (row, (over, features)) in enumerate(zip(signatures.ROWS, over_rows(frame, log), strict=True)):
        out[row] = blocks(over, features, valid, dt)
        out[f"{row} jump"] = blocks(np.abs(np.diff(log["raw"][:, i], prepend=log["raw"][0, i])), [1.0], valid, dt)
    return out | {"noise": blocks(log["ratio"].max(axis=1), [1.0], valid, dt)}


def survey_control_redundancy(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of the force rows, beyond what wrong coefficients and thrust can do, and of the gusts [m/s]."""
    p = p.copy()
    p["gust_max"] = 0.0
    log = watched(frame, "control_redundancy", p, ("avg", "valid", "rough"))
    valid, dt, hold = log["valid"] > 0.5, frame.attrs["dt"], HELD * float(p["t_confirm"][0])
    out = {}
    for i, row in enumerate(("x", "y", "z")):
        over = np.abs(log["avg"][:, i]) - p["rel"][0] * log["avg"][:, NR + i]
        out[f"t_{row}"] = blocks(np.maximum(over, 1e-6), [1.0], valid, dt, hold)
    speed = frame[sources("control_redundancy")["v_ground"]].to_numpy()
    return out | {"gust_max": blocks(speed * np.sqrt(log["rough"]), [1.0], valid, dt)}


SURVEYS: dict[str, Any] = {
    "lpv_smo": survey_lpv_smo, "kinematic": survey_kinematic, "control_redundancy": survey_control_redundancy,
}  # fmt: skip


def watched(frame: pd.DataFrame, name: str, p: np.ndarray, fields: tuple[str, ...]) -> np.ndarray:
    """Return the `fields` of detector `name` at every tick of a flown table."""
    return detect(frame, registry.module(name), sources(name), p, fields)


def surveyed(index: int, first_seed: int, aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return what is found in one training flight of an aircraft, plain data: its air, and of each detector that is
    trained in it the survey. On another aircraft the Sun13 estimators fly in it, too."""
    own, flight, turbulence = load_aircraft(aircraft), arguments(index, first_seed, aircraft), air(index)
    frame = fly_level(**flight)
    out: dict[str, Any] = {"air": turbulence}
    for name in fits(own) if own.own_designs else SURVEYS:
        p = fitted(name, flight["technology"], aircraft)
        if turbulence not in TRAINED_IN[name]:
            continue
        if name in SURVEYS:
            out[name] = {part: rows.tolist() for part, rows in SURVEYS[name](frame, p).items()}
        else:
            out[name] = train_rfafe.survey(frame, name, p)
    return out


def air(index: int) -> str:
    """Return the turbulence of training flight `index`."""
    return AIR[index // 8 % 4]


def elevators(index: int, own: Aircraft) -> tuple[str, ...]:
    """Return the technologies of the segments in training flight `index`: those of the aircraft, or all hydraulic."""
    return ("hydraulic",) * len(own.technology) if index // 32 % 2 else tuple(own.technology.values())


def flights(first_seed: int, number: int, aircraft: str = DEFAULT) -> list[dict[str, Any]]:
    """Return the arguments of `surveyed` of every flight."""
    return [{"index": k, "first_seed": first_seed, "aircraft": aircraft} for k in range(number)]


def limits(values: list[dict], aircraft: str = DEFAULT) -> Limits:
    """Return the thresholds of every detector that `values` are of."""
    own, out = load_aircraft(aircraft), {}
    for name in [n for n in SURVEYS if any(n in v for v in values)]:  # an aircraft may lack one's inputs
        found = [(v["air"], v[name]) for v in values if v.get(name)]
        made, how = _limits_of(name, found)
        if own.own_designs and "alpha_max" in registry.module(name).PARAMS.names:
            made["alpha_max"] = math.radians(reach(own)[0])
        out[name] = ({"flight": decimals(made)}, {"air": list(TRAINED_IN[name]), **how})
    sun13 = {name: found for name in train_rfafe.MODULES if (found := [v[name] for v in values if name in v])}
    return out | (train_rfafe.limits(sun13, aircraft) if sun13 else {})


def _limits_of(name, found):
    """Return the fields of a detector at PROBABILITY or RARE per flight, shared among its tests, and how they were
    found in [(air, {part: blocks})]. Of a part in LARGEST it is the largest that was seen: beyond it nothing is said.
    """
    parts = list(dict.fromkeys(part for _, v in found for part in v if part not in LARGEST))
    tests = [part.split()[0] for part in parts]  # "phi jump" is of the test "phi"
    probability = RARE.get(name, PROBABILITY)
    made: dict[str, list] = {}
    how: dict[str, Any] = {}
    for part in LARGEST & found[0][1].keys():
        made[part] = [max(float(np.array(v[part])[:, 0].max()) for _, v in found if len(v[part]))]
        how[part] = {"largest": made[part][0]}
    for part, test in zip(parts, tests, strict=True):
        rows = [np.array(v[part]) for _, v in found if part in v]
        least = CONSTANT if (name, part) == ("lpv_smo", "elevator") else LEAST
        kinds = [turbulence for turbulence, _ in found] if name == "kinematic" else None
        share = probability / len(set(tests)) / tests.count(test)
        w, how[part] = limit(rows, share, f"{name}, {part}", least, kinds)
        made[part] = w.tolist()
    return fields(name, made), {"found": how, "probability_per_flight": probability}


def fields(name: str, made: dict[str, list]) -> dict[str, Any]:
    """Return the PARAMS fields of detector `name` that the limits `made` of its parts stand for."""
    if name == "lpv_smo":
        limits = {field: [made[part][i] for part in LPV_PARTS] for i, field in enumerate(LPV_FIELDS)}
        return limits | dict(zip(("swing_limit", "swing_gust", "swing_away"), made["swing"], strict=True))
    if name == "control_redundancy":
        floors = {row: FLOOR * SENSORS[f"n_{row}"][1] for row in "xyz"}
        return {"threshold": [max(made[f"t_{row}"][0], floor) for row, floor in floors.items()],
                "gust_max": made["gust_max"][0]}  # fmt: skip
    rows = [(made[row] + [0.0] * 4)[:4] for row in signatures.ROWS]
    threshold, gust, side, side_gust = (list(column) for column in zip(*rows))
    return {"threshold": threshold, "gust": gust, "side": side, "side_gust": side_gust,
            "jump": [made[f"{row} jump"][0] for row in signatures.ROWS], "noise_ratio": made["noise"][0]}  # fmt: skip


_ABOUT = {"flight_s": FLIGHT_S, "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE}
TRANSPORT = Training(FIRST_SEED, FLIGHTS, flights, surveyed, limits, _ABOUT)


def another(aircraft: str) -> Training:
    """Return the training of the detectors of the aircraft level on another aircraft, a name or folder."""
    return Training(OTHERS_SEED, OTHERS, partial(flights, aircraft=aircraft), surveyed,
                    partial(limits, aircraft=aircraft), _ABOUT)  # fmt: skip
