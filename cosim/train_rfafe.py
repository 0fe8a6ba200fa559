"""Thresholds of the Sun13 estimators from fault-free flights that nothing else uses.

`python -m cosim.aircraft_level_study thresholds` trains and stores them, then judges them on the second set. Every
flight is one of six points (that of Sun13, A to E of Alwi14), six manoeuvres and three levels of turbulence, 60 s
long, each aerodynamic coefficient up to 5 % off. A threshold is MARGIN times the largest amplitude of f_hat, less the
command's share, in any window of any flight that else would pass for an oscillation. Set "flight" is for all points,
"design_point" for that of Sun13 alone.
"""

import json
import math
from pathlib import Path

import numpy as np

import fdi
from cosim.aircraft_level_study.jobs import many
from cosim.design_rfafe import MANOEUVRES, POINT
from cosim.rfafe_flights import MODULES, estimate, record
from cosim.scenario.tolerance import toleranced
from fdi import bank, tuning

POINTS = (  # [Sun13] table I, [Alwi14] table 4
    POINT,
    {"mass_t": 260.0, "cg_pct": 28.0, "altitude_ft": 12500.0, "cas_kt": 210.0},
    {"mass_t": 260.0, "cg_pct": 36.0, "altitude_ft": 12500.0, "cas_kt": 270.0},
    {"mass_t": 375.0, "cg_pct": 28.0, "altitude_ft": 27500.0, "cas_kt": 210.0},
    {"mass_t": 405.0, "cg_pct": 36.0, "altitude_ft": 27500.0, "cas_kt": 270.0},
    {"mass_t": 320.0, "cg_pct": 28.0, "altitude_ft": 20000.0, "cas_kt": 240.0},
)
TURBULENCE = ("none", "light", "moderate")
FLIGHT_S = 60.0
TOLERANCE = 0.05
MARGIN = 1.25  # 1.2 times the maximum of 40 flights left 1 alarm in 300 (papers/README)
RESERVE = 0.3  # of the largest amplitude that only its shape refused: no threshold hangs on the shape alone
LEAST = math.radians(0.05)  # two and a half sigma of one position sample
REPEATS = 4  # of every combination in training, with other seeds; two in the evaluation
TRAINING, EVALUATION = 1000, 2000  # first seeds of the two sets


def flights(first_seed):
    """Yield the arguments of `record` for every flight of a set; point C has 1.23 g left: steps of 0.15 g at most
    there."""
    seed = first_seed
    for point in POINTS * (REPEATS if first_seed == TRAINING else 2):
        weak = point["mass_t"] == 375.0
        for kind in MANOEUVRES:
            for turbulence in TURBULENCE:
                rng = np.random.default_rng(seed)
                aero = {n: float(1.0 + TOLERANCE * rng.uniform(-1.0, 1.0)) for n in toleranced("aero")}
                manoeuvre = {"kind": kind}
                if weak and kind in ("nose_up", "pitch_protection"):
                    manoeuvre["amplitude_g"] = 0.15
                yield {"duration": FLIGHT_S, "manoeuvre": manoeuvre, "seed": seed, "tolerances": {"aero": aero},
                       "flight": {**point, "turbulence": turbulence}}
                seed += 1


def look(first_seed, index):
    """Fly flight `index` of a set and return {estimator: [survey, largest slow part, alarms]} as JSON can hold it."""
    r = record(**list(flights(first_seed))[index])
    out = {}
    for name, module in MODULES.items():
        p = module.params()
        most, slow = survey(r, name, p)
        alarm = estimate(r, name, p)["alarm"]
        out[name] = [most.tolist(), slow, int(np.sum(np.diff(np.r_[0.0, alarm]) > 0.5))]
    return out


def collect(first_seed, *, out=None, workers=2, progress=None):
    """Fly a set in processes and return [(arguments, what `look` returns)]; `out` is a file that keeps the results."""
    chosen = list(flights(first_seed))
    got = many(look, [(first_seed, i) for i in range(len(chosen))], out=out, workers=workers, progress=progress)
    return [(flight, got[first_seed, i]) for i, flight in enumerate(chosen)]


def survey(recorded, name, p):
    """Return (2, frequency) the largest amplitude of f_hat less the command's share, and the largest slow part.

    Row 0: of windows that pass for an oscillation; row 1: of all. SI.
    """
    log = estimate(recorded, name, p)
    log = log[log["valid"] > 0.5]
    f = np.hypot(log["bank_cos"], log["bank_sin"])
    beyond = f[:, 0] - p["bank_share"][0] * f[:, 1]
    full = log["bank_seen"][:, p["bank_level"][0].astype(int)] > p["bank_n"][0]
    most = np.zeros((2, bank.K))
    most[1] = np.where(full, beyond, 0.0).max(axis=0)
    for k in range(bank.K):
        fits = np.flatnonzero((log["bank_new"][:, k] > 0.5) & full[:, k])
        for i in fits[np.argsort(-beyond[fits, k])]:
            agreement, purity, _ = bank.character(log[i], p[0], k, 1.0, 0.0)
            if agreement >= p["coherence"][0] and purity >= p["purity"][0]:
                most[0, k] = beyond[i, k]
                break
    u = np.abs(log["u_si"][:, :1])  # both sides have one command
    slow = np.abs(log["slow"][:, : int(p["nf"][0])]) - p["static_share"][0] * u
    return most, float(slow.max())


def alarms(collected, name):
    """Return the arguments of the flights on which estimator `name` alarms with the stored thresholds."""
    return [flight for flight, found in collected if found[name][2]]


def train(name, collected):
    """Return the trained fields of estimator `name` and the record of how they were found."""
    found = [f[name] for _, f in collected]
    most = np.max([b for b, _, _ in found], axis=0)
    static = max(s for _, s, _ in found)
    threshold = np.maximum(np.maximum(MARGIN * most[0], RESERVE * most[1]), LEAST)
    made = {"bank_threshold": threshold.tolist(), "th_static": MARGIN * static}
    how = {"flights": len(collected), "first_seed": TRAINING, "flight_s": FLIGHT_S, "margin": MARGIN,
           "largest": most[0].tolist(), "largest_any_shape": most[1].tolist(), "largest_static": static,
           "frequency_hz": bank.frequencies().tolist()}
    return made, how


def retrain(*, out=None, workers=2, progress=None):
    """Fly the training set, store both threshold sets of both estimators, return {(estimator, set): trained fields}."""
    collected, made = collect(TRAINING, out=out, workers=workers, progress=progress), {}
    here = [c for c in collected if all(c[0]["flight"][k] == v for k, v in POINT.items())]
    for name in MODULES:
        for which, chosen in (("flight", collected), ("design_point", here)):
            made[name, which], how = train(name, chosen)
            store(name, which, made[name, which], how)
    return made


def store(name, which, made, how):
    """Write the trained fields into set `which` of `fdi/thresholds/<name>.json`; the other fields are those of
    "flight"."""
    path = Path(fdi.__file__).parent / "thresholds" / f"{name}.json"
    held = json.loads(path.read_text(encoding="utf-8"))
    held[which] = held["flight"] | made
    held["training"] = {k: v for k, v in held.get("training", {}).items() if k in held} | {which: how}
    path.write_text(json.dumps(held, indent=1) + "\n", encoding="utf-8")
    tuning.forget()
    return path
