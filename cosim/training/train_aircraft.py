"""Thresholds of the aircraft-level detectors from fault-free flights: `python -m cosim.training aircraft`.

FLIGHTS of 60 s at points drawn over mass, CG, altitude and speed, eight manoeuvres, four airs, every aerodynamic
coefficient 5 % up or down, noise NOISE_SCALE, and STILL long ones. Each statistic is held against what it may grow
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
from cosim.training.threshold_fit import HELD, LEAST, PROBABILITY, blocks, lasting, limit
from cosim.training.trainer import Trained, Training
from fdi import registry
from fdi.common import bank
from fdi.control_redundancy.core import NR
from fdi.kinematic import signatures

DETECTORS = ("lpv_smo", "control_redundancy", "kinematic", "rfafe", "rfafe_airframe")
# what each is trained in; the others' estimates are not made for severe air
TRAINED_IN = dict.fromkeys(DETECTORS, AIR[:3]) | {"kinematic": AIR}
LPV_PARTS = ("elevator", "n_z", "alpha")
# in place of PROBABILITY: four tests share it, the floor and three least limits take a quarter each, too: 1 in 100 h
RARE = {"lpv_smo": 8e-5}
LARGEST = {"gust_max"}
# a row for each PIECE_S of a flight; they have no share in PROBABILITY: other tests need gusts
PIECES = {"floor", *(f"least_{part}" for part in LPV_PARTS)}
# of the median of lpv_smo's estimate of the elevators, its limit's constant: what a protection leaves in it is seen
# neither in gusts nor in the angle of attack; with LEAST 2 of 352 other flights alarmed, long after one
CONSTANT = 3.0
DOUBLE = 2.0  # of the deviations over the training flights
LPV = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha", "f_sigma", "sigma", "rms", "apart", "valid")
ALL_HYDRAULIC = 32  # the first flight with such elevators
FLIGHTS, FIRST_SEED = 384, 31_000
# and for lpv_smo STILL flights in still air with every coefficient as it is known: then nothing but noise is in its
# estimates, and its limits, which grow with gusts, come down to it after a minute
STILL, STILL_S, STILL_ALPHA = 24, 400.0, 12.9
PIECE_S = 60.0  # of a flight: for so long PROBABILITY is
HALF_S = 1.0  # between half periods that count together


def arguments(index: int, first_seed: int = FIRST_SEED, aircraft: str = DEFAULT) -> dict[str, Any]:
    """Return the arguments of `flights.scenario` of training flight `index`: manoeuvre, air and layout in turn."""
    own, rng = load_aircraft(aircraft), np.random.default_rng([first_seed, index])
    fixed: dict[str, Any] = {
        "duration": FLIGHT_S, "manoeuvre": drawn_manoeuvre(index, first_seed), "seed": first_seed + index,
        "technology": elevators(index, own), "sensors": {"noise_scale": NOISE_SCALE}, "aircraft": aircraft,
        "tolerances": {"aero": {n: float(1 + TOLERANCE * rng.choice((-1, 1))) for n in own.multipliers}},
    }  # fmt: skip
    return trimming(rng, fixed, {"turbulence": air(index)})


def still(index: int, first_seed: int = FIRST_SEED) -> dict:
    """Return the arguments of `flights.scenario` of the still flight `index`, from 0 to STILL."""
    rng = np.random.default_rng([first_seed, FLIGHTS, index])
    fixed = {"duration": STILL_S, "seed": first_seed + FLIGHTS + index, "sensors": {"noise_scale": NOISE_SCALE}}
    return trimming(rng, fixed, {"turbulence": "none"}, STILL_ALPHA)


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


def survey_lpv_smo(frame: pd.DataFrame, p: np.ndarray, still: bool = False) -> dict[str, np.ndarray]:
    """Return the blocks of the three estimates: 1, rms of gusts, distance from where offsets were learned; likewise of
    an oscillation. A `still` flight tells only how far beyond their predicted standard deviation the estimates last.

    The floor is what alternates beyond the limit that these three make; in a `still` flight, where nothing but noise
    does, whatever that limit is, so that the floor does not hang on the limit of the training before.
    """
    log = watched(frame, "lpv_smo", p, LPV)
    features = [1.0, log["rms"], log["apart"]]
    hold, valid, dt = HELD * float(p["t_confirm"][0]), log["valid"] > 0.5, frame.attrs["dt"]
    n = round(PIECE_S / dt)
    pieces = [slice(k, k + n) for k in range(0, max(len(frame) - n // 2, 1), n)]
    if still:
        most, out = 0.0, {}
        for part, sigma in zip(LPV_PARTS, (log["f_sigma"], *log["sigma"].T)):
            size = np.divide(np.abs(log[f"f_hat_{part}"]), sigma, out=np.zeros(len(frame)), where=valid)
            lasts = lasting(size, hold, dt)
            out[f"least_{part}"] = np.array([[lasts[k].max(), 1.0] for k in pieces])
    else:
        most = sum(p[f"{n}_elevator"][0] * x for n, x in zip("tgs", features, strict=True))
        out = {part: blocks(np.abs(log[f"f_hat_{part}"]), features, valid, dt, hold) for part in LPV_PARTS}
        q = p.copy()
        for part in ("threshold", "gust", "away"):  # the shape of an oscillation is asked, its size is what is found
            q[f"swing_{part}"] = 0.0
        fits = watched(frame, "lpv_smo", q, ("bank_cos", "bank_sin", "bank_new", "hit"))
        size = np.hypot(fits["bank_cos"][:, 0], fits["bank_sin"][:, 0])
        size = np.where((fits["hit"] >= p["hits"][0] - 1.0) & (fits["bank_new"] > 0.5), size, 0.0)
        swings = [blocks(size[:, k], features, valid, dt) for k in range(size.shape[1])]
        out["swing"] = np.concatenate(swings)  # one limit for all frequencies: few flights pass the shape of each
    swung = np.where(valid & (np.abs(log["f_hat_elevator"]) >= most), log["f_hat_elevator"] / log["f_sigma"], 0.0)
    return out | {"floor": np.array([[alternating(swung[k], dt), 1.0] for k in pieces])}


def alternating(y: np.ndarray, dt: float) -> float:
    """Return the largest level [unit of y (ticks,)] that y passes three times with alternating sign, each within HALF_S
    of the one before: what lpv_smo counts as an oscillation."""
    low, high = 0.0, float(np.abs(y).max())
    while high - low > 1e-3:
        level = 0.5 * (low + high)
        at = np.flatnonzero(np.abs(y) >= level)
        at = at[np.diff(np.sign(y[at]), prepend=0.0) != 0.0]  # where it comes to a side
        close = np.diff(at) * dt < HALF_S
        low, high = (level, high) if (close[1:] & close[:-1]).any() else (low, level)
    return low


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


def surveyed_still(index: int, first_seed: int = FIRST_SEED) -> dict[str, dict[str, list]]:
    """Return what lpv_smo's survey finds in one still flight, plain data."""
    found = survey_lpv_smo(flown(still(index, first_seed)), fitted("lpv_smo"), still=True)
    return {"lpv_smo": {part: rows.tolist() for part, rows in found.items()}}


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
    """Return what `surveyed` and `surveyed_still` find in every flight, of detectors `names`; `aircraft` and its
    `digest` if it is not the default one, which alone has still flights."""
    given = {"first_seed": first_seed, "names": tuple(names), **aircraft}
    chosen = [k for k in range(number) if any(air(k) in TRAINED_IN[name] for name in names)]
    jobs: list = [(surveyed, {"index": k, **given}) for k in chosen]
    if "lpv_smo" in names and not aircraft:
        jobs += [(surveyed_still, {"index": k, "first_seed": first_seed}) for k in range(STILL)]
    return run(jobs)


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
        share = probability / len(set(tests) - PIECES)
        made: dict[str, list] = {}
        found: dict[str, Any] = {}
        for part in LARGEST & own[0].keys():
            made[part] = [max(float(np.array(v[part])[:, 0].max()) for v in own if len(v[part]))]
            found[part] = {"largest": made[part][0]}
        for part, test in zip(parts, tests, strict=True):
            rows = [np.array(v[part]) for v in own if part in v]
            if part in PIECES:
                rows = [piece[None] for flight in rows for piece in flight]
            least = CONSTANT if (name, part) == ("lpv_smo", "elevator") else LEAST
            kinds = [v["air"] for v in values if v.get(name)] if name == "kinematic" else None
            w, found[part] = limit(rows, share / tests.count(test), f"{name}, {part}", least, kinds)
            made[part] = w.tolist()
        about: dict[str, Any] = {"air": list(TRAINED_IN[name]), "found": found, "probability_per_flight": probability}
        if name == "lpv_smo":
            about |= {"still_flights": STILL, "still_s": STILL_S}
        out.append(Trained(name, "flight", fields(name, made), about))
    return out


def fields(name: str, made: dict[str, list]) -> dict[str, Any]:
    """Return the PARAMS fields of detector `name` that the limits `made` of its parts stand for."""
    if name == "lpv_smo":
        level = {f"{letter}_{part}": made[part][i] for part in LPV_PARTS for i, letter in enumerate("tgs")}
        level["floor"] = made["floor"][0]
        if least := [made[f"least_{part}"][0] for part in LPV_PARTS if f"least_{part}" in made]:
            level["least"] = least
        swing = zip(("threshold", "gust", "away"), made["swing"], strict=True)
        return level | {f"swing_{n}": [w] * bank.K for n, w in swing}
    if name == "control_redundancy":
        return {part: w[0] for part, w in made.items()}
    rows = [(made[row] + [0.0] * 4)[:4] for row in signatures.ROWS]
    threshold, gust, side, side_gust = (list(column) for column in zip(*rows))
    return {"threshold": threshold, "gust": gust, "side": side, "side_gust": side_gust,
            "jump": [made[f"{row} jump"][0] for row in signatures.ROWS], "noise_ratio": made["noise"][0]}  # fmt: skip


TRAININGS = {"aircraft": Training("aircraft", FIRST_SEED, FLIGHTS, collect, limits, {
    "flight_s": FLIGHT_S, "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE,
})}  # fmt: skip
