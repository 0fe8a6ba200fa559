"""Thresholds of the aircraft-level detectors from fault-free flights that nothing else uses: `cosim train aircraft`.

FLIGHTS of 60 s at points drawn over mass, CG, altitude and speed, eight manoeuvres, four airs, every aerodynamic
coefficient 5 % up or down, noise NOISE_SCALE. Each statistic is held against what it may grow with, all of it measured
(`cosim.training.tail`), at one PROBABILITY of a false alarm per flight and detector, shared among what it tests.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import minimum_filter1d

import fdi
from cosim.campaign.jobs import work
from cosim.errors import TrimError
from cosim.files import replace_text
from cosim.flight.build import build
from cosim.flight.detectors import sources
from cosim.flight.signals import detect, fly
from cosim.flight.site import site
from cosim.scenario.tolerance import toleranced
from cosim.training.flights import DT, scenario
from cosim.training.tail import limit
from fdi import registry
from fdi.common import bank, compact, tuning
from fdi.control_redundancy.core import NR
from fdi.kinematic import kinematic

DETECTORS = ("lpv_smo", "control_redundancy", "kinematic", "rfafe", "rfafe_airframe")
TURBULENCE = ("none", "light", "moderate", "severe")
# what each is trained in; the others' estimates are not made for severe air
AIR = {"kinematic": TURBULENCE, "lpv_smo": TURBULENCE[:3], "control_redundancy": TURBULENCE[:3]}
PROBABILITY = 1e-3  # of a false alarm in a flight of 60 s
BLOCK_S = 1.0
LPV_PARTS = ("elevator", "n_z", "alpha")
LPV = ("f_hat_elevator", "f_hat_n_z", "f_hat_alpha", "gust", "path", "alpha_0", "valid")
HELD = 0.8  # of its confirmation time: a statistic that lasts so long counts as one that alarms
KINDS: tuple[dict, ...] = (
    {"kind": "cruise"}, {"kind": "coordinated_turn", "duration_s": 35.0}, {"kind": "yaw_angle"}, {"kind": "nz_doublet"},
    {"kind": "three_two_one_one"}, {"kind": "nose_up", "amplitude_g": 0.3}, {"kind": "aoa_protection"},
    {"kind": "pitch_protection"},
)  # fmt: skip
ELEVATORS = (("hydraulic", "hydraulic", "ema", "ema"), ("hydraulic",) * 4)
NOISE_SCALE = 1.2  # of the sensors
TOLERANCE = 0.05
FLIGHTS, TRAINING = 384, 31_000  # how many, and the first seed


def point(rng: np.random.Generator) -> dict:
    """Return a point drawn over mass, CG, altitude and speed; not every one trims."""
    mass, cg = rng.uniform(200.0, 405.0), rng.uniform(25.0, 36.0)
    height, speed = rng.uniform(5000.0, 39000.0), rng.uniform(180.0, 330.0)
    return {"mass_t": mass, "cg_pct": cg, "altitude_ft": height, "cas_kt": speed}


def arguments(index: int, first_seed: int = TRAINING) -> dict:
    """Return the arguments of `flights.scenario` of training flight `index`, at a point that trims with throttle below
    95 % and angle of attack below 10.5 deg."""
    rng = np.random.default_rng([first_seed, index])
    fixed: dict[str, Any] = {
        "duration": 60.0, "manoeuvre": KINDS[index % 8], "seed": first_seed + index,
        "technology": ELEVATORS[index // 32 % 2], "sensors": {"noise_scale": NOISE_SCALE},
        "tolerances": {"aero": {n: float(1 + TOLERANCE * rng.choice((-1, 1))) for n in toleranced("aero")}},
    }  # fmt: skip
    while True:
        flight: dict[str, Any] = fixed | {"flight": point(rng) | {"turbulence": TURBULENCE[index // 8 % 4]}}
        try:
            setup = build(scenario(**flight))
        except TrimError:
            continue
        if setup.trim.throttle < 0.95 and math.degrees(setup.trim.alpha) < 10.5:
            return flight


def flown(index: int, first_seed: int = TRAINING) -> pd.DataFrame:
    """Fly training flight `index` and return what the detectors of the aircraft level read."""
    wires = [name for d in DETECTORS for name in sources(d).values()]
    return fly(scenario(**arguments(index, first_seed)), dict.fromkeys(wires))


def blocks(y: np.ndarray, features: list, valid: np.ndarray, dt: float, hold: float = 0.0) -> np.ndarray:
    """Return (blocks, 1 + features): of each second the largest y (ticks,) that lasted for `hold` [s], and the
    features (ticks,) or numbers there. Blocks without one are left out."""
    y = np.where(valid, y, 0.0)
    if hold > 0.0:
        y = minimum_filter1d(y, max(round(hold / dt), 1))
    n = round(BLOCK_S / dt)
    at = np.arange(0, len(y) - n + 1, n)
    at = at + y[: len(at) * n].reshape(-1, n).argmax(axis=1)
    at = at[y[at] > 0.0]
    return np.stack([y[at], *(np.broadcast_to(f, len(y))[at] for f in features)], axis=1)


def survey_lpv_smo(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of the three estimates: 1, rms of gusts, distance from where offsets were learned."""
    log = watched(frame, "lpv_smo", p, LPV)
    features = [1.0, np.sqrt(log["gust"]), np.abs(log["path"] - log["alpha_0"])]
    hold, valid, dt = HELD * float(p["t_confirm"][0]), log["valid"] > 0.5, frame.attrs["dt"]
    out = {part: blocks(np.abs(log[f"f_hat_{part}"]), features, valid, dt, hold) for part in LPV_PARTS}
    q = p.copy()
    q["swing_threshold"], q["swing_gust"] = 0.0, 0.0  # the shape of an oscillation is asked, its size is what is found
    fits = watched(frame, "lpv_smo", q, ("bank_cos", "bank_sin", "bank_new", "hit"))
    size = np.hypot(fits["bank_cos"][:, 0], fits["bank_sin"][:, 0])
    size = np.where((fits["hit"] >= p["hits"][0] - 1.0) & (fits["bank_new"] > 0.5), size, 0.0)
    swings = [blocks(size[:, k], features[:2], valid, dt) for k in range(size.shape[1])]
    return out | {"swing": np.concatenate(swings)}  # one limit for all frequencies: few flights pass the shape of each


def survey_kinematic(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of each row, of its jumps, and of the noise of all readings."""
    log = watched(frame, "kinematic", p, ("res", "raw", "lateral", "rough", "valid", "power", "level"))
    valid, dt = log["valid"] > 0.5, frame.attrs["dt"]
    speed = frame[sources("kinematic")["v_ground"]].to_numpy()
    out = {}
    for i, row in enumerate(kinematic.ROWS):
        features = [1.0, log["rough"]]
        if row in ("climb", "turn", "speed"):
            lateral = log["lateral"][:, i]
            features += [lateral * speed, lateral * log["rough"]]
        out[row] = blocks(np.abs(log["res"][:, i]), features, valid, dt)
        out[f"{row} jump"] = blocks(np.abs(np.diff(log["raw"][:, i], prepend=log["raw"][0, i])), [1.0], valid, dt)
    ratio = (log["power"] / np.maximum(log["level"], 1e-300)).max(axis=1)
    return out | {"noise": blocks(ratio, [1.0], valid, dt)}


def survey_control_redundancy(frame: pd.DataFrame, p: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of the force rows, beyond what wrong coefficients and thrust can do."""
    log = watched(frame, "control_redundancy", p, ("avg", "valid"))
    valid, dt, hold = log["valid"] > 0.5, frame.attrs["dt"], HELD * float(p["t_confirm"][0])
    out = {}
    for i, row in enumerate(("x", "y", "z")):
        over = np.abs(log["avg"][:, i]) - p["rel"][0] * log["avg"][:, NR + i]
        out[f"t_{row}"] = blocks(np.maximum(over, 1e-6), [1.0], valid, dt, hold)
    return out


SURVEYS: dict[str, Any] = {
    "lpv_smo": survey_lpv_smo, "kinematic": survey_kinematic, "control_redundancy": survey_control_redundancy,
}  # fmt: skip


def watched(frame: pd.DataFrame, name: str, p: np.ndarray, fields: tuple[str, ...]) -> np.ndarray:
    """Return the `fields` of detector `name` at every tick of a flown table."""
    return detect(frame, registry.module(name), sources(name), p, fields)


def surveyed(index: int, first_seed: int = TRAINING) -> dict[str, dict[str, list]]:
    """Return what the surveys find in one training flight, plain data; of detectors not trained in its air nothing."""
    frame, air = flown(index, first_seed), TURBULENCE[index // 8 % 4]
    return {name: {part: rows.tolist() for part, rows in survey(frame, fitted(name)).items()}
            for name, survey in SURVEYS.items() if air in AIR[name]}  # fmt: skip


def fitted(name: str) -> np.ndarray:
    """Return the parameters with which detector `name` flies."""
    return registry.record(name).fit(site(DT))


def train(*, first_seed: int = TRAINING, number: int = FLIGHTS, **how: Any) -> dict:
    """Fly the training set; return {"limits": {detector: {part: weights}}, "how": ...}; `how` as in
    `cosim.campaign.jobs.work`."""
    values = work([(surveyed, {"index": k, "first_seed": first_seed}) for k in range(number)], **how)
    return limits(values) | {"flights": number, "first_seed": first_seed}


def limits(values: list[dict]) -> dict:
    """Return the limits of every part, at PROBABILITY per flight and detector, shared among its parts."""
    out: dict = {"limits": {}, "found": {}}
    for name in SURVEYS:
        own = [v[name] for v in values if v.get(name)]
        tests = [part.split()[0] for part in own[0]]  # "swing 3" is of the test "swing"
        for part, test in zip(own[0], tests, strict=True):
            rows = [np.array(v[part]) for v in own]
            w, found = limit(rows, PROBABILITY / len(set(tests)) / tests.count(test))
            out["limits"].setdefault(name, {})[part] = w.tolist()
            out["found"].setdefault(name, {})[part] = found
    return out


def fields(name: str, made: dict[str, list]) -> dict[str, Any]:
    """Return the PARAMS fields of detector `name` that the limits `made` of its parts stand for."""
    if name == "lpv_smo":
        level = {f"{letter}_{part}": made[part][i] for part in LPV_PARTS for i, letter in enumerate("tgs")}
        return level | {f"swing_{n}": [w] * bank.K for n, w in zip(("threshold", "gust"), made["swing"], strict=True)}
    if name == "control_redundancy":
        return {part: w[0] for part, w in made.items()}
    rows = [(made[row] + [0.0] * 4)[:4] for row in kinematic.ROWS]
    threshold, gust, side, side_gust = (list(column) for column in zip(*rows))
    return {"threshold": threshold, "gust": gust, "side": side, "side_gust": side_gust,
            "jump": [made[f"{row} jump"][0] for row in kinematic.ROWS], "noise_ratio": made["noise"][0]}  # fmt: skip


def changes(found: dict) -> list[tuple]:
    """Return [(file, set, field, stored, trained)] of every threshold that `store` would write, largest of a row."""
    out = []
    for name, made in found["limits"].items():
        held = json.loads(_path(name).read_text(encoding="utf-8"))["flight"]
        for key, value in fields(name, made).items():
            stored, trained = np.atleast_1d(held[key]), np.atleast_1d(value)
            k = int(np.argmax(np.abs(trained - stored)))
            out.append((name, "flight", key, float(stored[k]), float(trained[k])))
    return out


def store(found: dict) -> None:
    """Write what `train` found into `fdi/thresholds/<detector>.json`, with how it was found."""
    for name, made in found["limits"].items():
        held = json.loads(_path(name).read_text(encoding="utf-8"))
        held["flight"] |= {k: np.round(v, 7).tolist() for k, v in fields(name, made).items()}
        held["training"] = {
            "command": "cosim train aircraft", "probability_per_flight": PROBABILITY, "flight_s": 60.0,
            "flights": found["flights"], "first_seed": found["first_seed"], "air": list(AIR[name]),
            "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE, "found": found["found"][name],
        }  # fmt: skip
        replace_text(_path(name), compact.text(held))
    tuning.forget()


def _path(name):
    return Path(fdi.__file__).parent / "thresholds" / f"{name}.json"
