"""Thresholds of the aircraft-level detectors from fault-free flights: `python -m cosim.training aircraft`.

FLIGHTS of 60 s at points drawn over mass, CG, altitude and speed, eight manoeuvres, four airs, every aerodynamic
coefficient 5 % up or down, noise NOISE_SCALE. Each statistic is held against what it may grow
with, all of it measured (`cosim.training.threshold_fit`), at one PROBABILITY (RARE) of a false alarm per flight and
detector, shared among what it tests.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources, unfit
from cosim.flight.loop.signals import detect, fly
from cosim.scenario.aircraft import DEFAULT, Aircraft, load_aircraft
from cosim.training import train_rfafe
from cosim.training.flights import (
    AIR,
    COMMAND,
    DT,
    FLIGHT_S,
    NOISE_SCALE,
    TOLERANCE,
    drawn_manoeuvre,
    reach,
    scenario,
    trimming,
)
from cosim.training.threshold_fit import HELD, LEAST, PROBABILITY, blocks, limit
from cosim.training.trainer import Trained, Training
from fdi import registry
from fdi.control_redundancy.core import NR
from fdi.kinematic import signatures
from fdi.kinematic.rows import WIND

DETECTORS = ("lpv_smo", "control_redundancy", "kinematic", "rfafe", "rfafe_airframe")
# what each is trained in; the others' estimates are not made for severe air
TRAINED_IN = dict.fromkeys(DETECTORS, AIR[:3]) | {"kinematic": AIR}
LPV_PARTS = ("elevator", "n_z", "alpha")
LPV_FIELDS = ("limit", "limit_gust", "limit_away")
# in place of PROBABILITY, shared by four tests
RARE = {"lpv_smo": 8e-5}
LARGEST = {"gust_max"}
# of the median of lpv_smo's estimate of the elevators, its limit's constant: what a protection leaves in it is seen
# neither in gusts nor in the angle of attack; with LEAST 2 of 352 other flights alarmed, long after one
CONSTANT = 3.0
LPV = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha", "rms", "apart", "valid")
ALL_HYDRAULIC = 32  # the first flight with such elevators
FLIGHTS, FIRST_SEED = 384, 31_000


def arguments(index: int, first_seed: int = FIRST_SEED, aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the arguments of `flights.scenario` of training flight `index`: manoeuvre, air and layout in turn."""
    own, rng = load_aircraft(aircraft), np.random.default_rng([first_seed, index])
    fixed: dict[str, Any] = {
        "duration": FLIGHT_S, "manoeuvre": drawn_manoeuvre(index, first_seed), "seed": first_seed + index,
        "technology": elevators(index, own), "sensors": {"noise_scale": NOISE_SCALE}, "aircraft": aircraft,
        "tolerances": {"aero": {n: float(1 + TOLERANCE * rng.choice((-1, 1))) for n in own.multipliers}},
    }  # fmt: skip
    return trimming(rng, fixed, {"turbulence": air(index)})


def fits(own: Aircraft) -> tuple[str, ...]:
    """Return the detectors of the aircraft level that have all their inputs on an aircraft."""
    return tuple(name for name in DETECTORS if not unfit(registry.record(name), own))


def flown(flight: dict[str, Any]) -> pd.DataFrame:
    """Fly a training flight from its arguments and return what the detectors of the aircraft level read, under its
    names on the default aircraft."""
    own = load_aircraft(flight.get("aircraft", DEFAULT))
    wires = [(sources(d), sources(d, aircraft=own)) for d in fits(own)]
    frame = fly(scenario(**flight), dict.fromkeys([COMMAND, *(s for _, its in wires for s in its.values())]))
    said = {there[field]: frame[its[field]] for there, its in wires for field in its}
    out = pd.DataFrame({**{c: frame[c] for c in frame}, **said}, copy=False)
    out.attrs = frame.attrs
    return out


def survey_lpv_smo(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of the three estimates and of an oscillation: 1, rms of gusts or their amplitude at its
    frequency, distance from where offsets were learned."""
    log = watched(frame, "lpv_smo", p, LPV)
    features = [1.0, log["rms"], log["apart"]]
    hold, valid, dt = HELD * float(p["t_confirm"][0]), log["valid"] > 0.5, frame.attrs["dt"]
    out = {part: blocks(np.abs(log[f"f_hat_{part}"]), features, valid, dt, hold) for part in LPV_PARTS}
    q = p.copy()
    for part in ("limit", "gust", "away"):  # the shape of an oscillation is asked, its size is what is found
        q[f"swing_{part}"] = 0.0
    fits = watched(frame, "lpv_smo", q, ("bank_cos", "bank_sin", "bank_new", "hit"))
    size = np.hypot(fits["bank_cos"], fits["bank_sin"])  # (ticks, 2, frequencies): of the estimate, of gusts
    found = np.where((fits["hit"] >= p["hits"][0] - 1.0) & (fits["bank_new"] > 0.5), size[:, 0], 0.0)
    swings = [blocks(found[:, k], [1.0, size[:, 1, k], log["apart"]], valid, dt) for k in range(found.shape[1])]
    return out | {"swing": np.concatenate(swings)}  # one limit for all frequencies: few flights pass the shape of each


def survey_kinematic(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of each row, less what its limit has of a wind across already, of its jumps, and of the noise
    of all readings."""
    log = watched(frame, "kinematic", p, ("res", "raw", "lateral", "rough", "valid", "ratio"))
    valid, dt, rough = log["valid"] > 0.5, frame.attrs["dt"], log["rough"]
    out = {}
    for i, row in enumerate(signatures.ROWS):
        lateral = log["lateral"][:, i]
        side = [lateral * rough] if lateral.any() else []  # climb, turn and speed
        out[row] = blocks(np.abs(log["res"][:, i]) - WIND * lateral, [1.0, rough, *side], valid, dt)
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


def surveys(
    frame: pd.DataFrame, turbulence: str, fitted: Callable[[str], np.ndarray], names: Sequence[str]
) -> dict[str, Any]:
    """Return what the surveys of detectors `names` find in one flown table, plain data; of those not trained in its air
    nothing. Its `air` stands beside. `fitted(name)` gives the parameters."""
    out: dict[str, Any] = {"air": turbulence}
    for name in (n for n in names if turbulence in TRAINED_IN[n]):
        if name in train_rfafe.MODULES:
            out[name] = train_rfafe.survey(frame, name, fitted(name))
        else:
            out[name] = {part: rows.tolist() for part, rows in SURVEYS[name](frame, fitted(name)).items()}
    return out


def surveyed(
    index: int, first_seed: int, names: Sequence[str], aircraft: str = DEFAULT, digest: str = ""
) -> dict[str, Any]:
    """Return what `surveys` finds in one training flight of an aircraft; `digest` is of its numbers."""
    frame = flown(arguments(index, first_seed, aircraft))
    return surveys(frame, air(index), partial(fitted, index=index, aircraft=aircraft), names)


def fitted(name: str, index: int = 0, aircraft: str = DEFAULT) -> np.ndarray:
    """Return the parameters with which detector `name` flies in training flight `index` of an aircraft."""
    own = load_aircraft(aircraft)
    p = registry.record(name).fit(site(DT, "", dict(zip(own.segments, elevators(index, own), strict=True)), own))
    if own.own_designs and "alpha_max" in p.dtype.names:
        p["alpha_max"] = math.radians(reach(own)[0])
    return p


def air(index: int) -> str:
    """Return the turbulence of training flight `index`."""
    return AIR[index // 8 % 4]


def elevators(index: int, own: Aircraft | None = None) -> tuple[str, ...]:
    """Return the technologies of the segments in training flight `index`: those of the aircraft, or all hydraulic."""
    technology = (own or load_aircraft()).technology
    return ("hydraulic",) * len(technology) if index // 32 % 2 else tuple(technology.values())


def collect(
    first_seed: int, number: int, run: Callable[..., Any], names: Sequence[str] = tuple(SURVEYS), **aircraft: str
) -> list[dict]:
    """Return what `surveyed` finds in every flight, of detectors `names`; `aircraft` and its `digest` if it is not the
    default one."""
    given = {"first_seed": first_seed, "names": tuple(names), **aircraft}
    chosen = [k for k in range(number) if any(air(k) in TRAINED_IN[name] for name in names)]
    return run([(surveyed, {"index": k, **given}) for k in chosen])


def limits(values: list[dict]) -> list[Trained]:
    """Return the thresholds of every detector that `values` are of, at PROBABILITY or RARE per flight, shared among its
    parts.

    Where a part stands in LARGEST, its limit is the largest that was seen: beyond it nothing is said.
    """
    out = []
    for name in [n for n in SURVEYS if any(n in v for v in values)]:  # an aircraft may lack one's inputs
        own = [v[name] for v in values if v.get(name)]
        parts = [part for part in dict.fromkeys(part for v in own for part in v) if part not in LARGEST]
        tests = [part.split()[0] for part in parts]  # "swing 3" is of the test "swing"
        probability = RARE.get(name, PROBABILITY)
        share = probability / len(set(tests))
        made: dict[str, list] = {}
        found: dict[str, Any] = {}
        for part in LARGEST & own[0].keys():
            made[part] = [max(float(np.array(v[part])[:, 0].max()) for v in own if len(v[part]))]
            found[part] = {"largest": made[part][0]}
        for part, test in zip(parts, tests, strict=True):
            rows = [np.array(v[part]) for v in own if part in v]
            least = CONSTANT if (name, part) == ("lpv_smo", "elevator") else LEAST
            kinds = [v["air"] for v in values if v.get(name)] if name == "kinematic" else None
            w, found[part] = limit(rows, share / tests.count(test), f"{name}, {part}", least, kinds)
            made[part] = w.tolist()
        about: dict[str, Any] = {"air": list(TRAINED_IN[name]), "found": found, "probability_per_flight": probability}
        out.append(Trained(name, "flight", fields(name, made), about))
    return out


def fields(name: str, made: dict[str, list]) -> dict[str, Any]:
    """Return the PARAMS fields of detector `name` that the limits `made` of its parts stand for."""
    if name == "lpv_smo":
        limits = {field: [made[part][i] for part in LPV_PARTS] for i, field in enumerate(LPV_FIELDS)}
        return limits | dict(zip(("swing_limit", "swing_gust", "swing_away"), made["swing"], strict=True))
    if name == "control_redundancy":
        return {"threshold": [made[f"t_{row}"][0] for row in "xyz"], "gust_max": made["gust_max"][0]}
    rows = [(made[row] + [0.0])[:3] for row in signatures.ROWS]
    threshold, gust, side = (list(column) for column in zip(*rows))
    return {"threshold": threshold, "gust": gust, "side": side,
            "jump": [made[f"{row} jump"][0] for row in signatures.ROWS], "noise_ratio": made["noise"][0]}  # fmt: skip


TRAININGS = {"aircraft": Training("aircraft", FIRST_SEED, FLIGHTS, collect, limits, {
    "flight_s": FLIGHT_S, "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE,
})}  # fmt: skip
