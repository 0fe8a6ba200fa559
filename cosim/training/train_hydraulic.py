"""Thresholds of the hydraulic detectors from fault-free flights that nothing else uses.

The flights, FLIGHTS of 60 s, are at points drawn over the envelope of `train_aircraft`: eight manoeuvres, also such
that move the elevator in steps, three levels of turbulence, aircraft and actuator up to 5 % off, noise NOISE_SCALE,
four segments each. A threshold is what the largest statistic of a flight exceeds with PROBABILITY, shared among the
detector's TESTS and their frequencies (`threshold_fit`), what scales with the drive left out; one that needs
several samples to agree takes the largest that they agree on. What watches electromechanical segments is trained by
`train_ema`, the monitors by `train_monitors`.

    cosim train hydraulic --check      fly the training set, say what would change
    cosim train hydraulic              and write fdi/thresholds/*.json
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import minimum_filter1d

from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import (
    DT,
    FLIGHT_S,
    NOISE_SCALE,
    START_S,
    fly_hydraulic,
    over_envelope,
    somewhere,
    watch,
    wires,
)
from cosim.training.threshold_fit import HELD, PROBABILITY, exceeded
from cosim.training.trainer import Trained, Training, decimals
from fdi.common import bank
from fdi.hydraulic import iotsekf, rtsekf, rtsekf_flight, windows
from fdi.isolation import likelihood

FLIGHTS = 384  # 16 of every manoeuvre in each air
FIRST_SEED, EVALUATION = 21_000, 12_000  # of the two sets
# What noise alone asks for in still air, where the search finds nothing; where it begins. Of the amplitudes that noise
# alone makes 2.4e-6 are larger; at 1 Hz a flight has 240 fits apart, and two in a row must agree and look like a sine
NOISE_SIGMA, FLOOR_SIGMA = 3.6, 1.8
PEAK = 2.0  # times what lasts: the largest single tick of a lagged input fault; from it on more is looked for
MARGIN = 1.5  # of evidence: flights at points and in manoeuvres drawn otherwise have 1.6 times the largest of these
NEVER = 1e9  # fits in a row that no flight has: what is found is no alarm, behind which the filter would look otherwise
EVIDENCE = "iotsekf flight_load2"  # the set whose likelihood ratios are asked for
TESTS = {"iotsekf": ("bank_threshold", "slow_threshold", "run_threshold"), "rtsekf": ("threshold", "step"),
         "rtsekf_flight": ("pair_threshold",)}  # fmt: skip
# amplitude noise of a fit over noise of a sample: sqrt(2 / n) with n samples in two periods
SLOW_WINDOW = windows.SLOW_S * np.array(windows.SLOW_HZ)


def survey_iotsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: of each frequency the amplitude that would pass for an oscillation with a
    threshold of FLOOR_SIGMA, the largest lagged input fault that lasts, the drive's shares left out; with the pressure
    the evidence of each hypothesis, 0 where none speaks for it.
    """
    p = iotsekf.params(load=load)
    floor = {n: FLOOR_SIGMA / NOISE_SIGMA * np.asarray(v) for n, v in quiet_floor(load).items()}
    p["bank_threshold"], p["slow_threshold"] = floor["bank_threshold"], floor["slow_threshold"]
    hits, p["hits"] = float(p["hits"][0]), NEVER
    p["limit"], p["asks"] = NEVER, np.where(p["asks"] > 0.0, likelihood.ALL, 0.0)
    fields = ("ratio", "hit", "slow_ratio", "slow_hit", "f_slow", "u_slow", "ev", "ev_octave")
    log = watch(recorded, iotsekf, p, fields)[:, round(START_S / DT) :]
    r = p[0]
    passed = {n: np.where(log[hit] >= hits, log[ratio], 0.0).max(axis=(0, 1))
              for n, ratio, hit in (("bank", "ratio", "hit"), ("slow", "slow_ratio", "slow_hit"))}  # fmt: skip
    run = np.abs(log["f_slow"]) - r["run_share"] * np.abs(log["u_slow"])
    held = minimum_filter1d(run, max(round(HELD * float(r["run_confirm"]) / DT), 1), axis=1)
    asked = log["ev"][(log["ev_octave"] >= 0.0) & (np.arange(log.shape[1]) * DT > likelihood.LEARN_S - START_S)]
    evidence = {"limit": np.maximum(asked.max(axis=0), 0.0)} if load == 2 else {}
    slow = passed["slow"] * floor["slow_threshold"]
    return {"bank_threshold": passed["bank"] * floor["bank_threshold"], "slow_threshold": slow,
            "run_threshold": held.max(), **evidence}  # fmt: skip


def survey_rtsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: the lagged output fault, and how far it is from what it was [m]."""
    p = rtsekf.params(load=load)
    p["threshold"] = p["step"] = 1e3  # no alarm holds what it was
    log = watch(recorded, rtsekf, p, ("f_slow", "f_was"))[:, round(START_S / DT) :]
    found = {"threshold": log["f_slow"], "step": log["f_slow"] - log["f_was"]}
    return {name: float(np.abs(v).max()) for name, v in found.items()}


def survey_rtsekf_flight(recorded: Any) -> dict[str, Any]:
    """Return {"pair_threshold": largest} over one flight: how far rod and surface are apart [m] for HELD of what an
    alarm takes."""
    p = rtsekf_flight.params(pair_threshold=1e3)  # no alarm holds what is learned
    log = watch(recorded, rtsekf_flight, p, ("pair_d",))[:, round(START_S / DT) :]
    ticks = max(round(HELD * float(p["pair_confirm"][0]) / DT), 1)
    return {"pair_threshold": float(minimum_filter1d(np.abs(log["pair_d"]), ticks, axis=1).max())}


def surveyed(**flight: Any) -> dict[str, Any]:
    """Return the largest statistics of every detector over one flight, {detector set: {name: value}}, plain data."""
    recorded = fly_hydraulic(**somewhere(flight))
    found = {f"{name} {which}": survey(recorded, **how) for name, (survey, sets) in SURVEYS.items()
             for which, how in sets.items()}  # fmt: skip
    return {name: {key: np.asarray(v).tolist() for key, v in values.items()} for name, values in found.items()}


SURVEYS: dict[str, Any] = {
    "iotsekf": (survey_iotsekf, {f"flight_load{k}": {"load": k} for k in (0, 1, 2)}),
    "rtsekf": (survey_rtsekf, {f"flight_load{k}": {"load": k} for k in (0, 1)}),
    "rtsekf_flight": (survey_rtsekf_flight, {"flight": {}}),
}


def collect(first_seed: int, number: int, run: Callable[..., Any]) -> list[dict[str, Any]]:
    """Return what `surveyed` finds in every flight."""
    return run([(surveyed, flight) for flight in over_envelope(first_seed, number)])


def limits(flown: list[dict[str, Any]]) -> list[Trained]:
    """Return the sets of thresholds at PROBABILITY of what `surveyed` found in every flight."""
    out = []
    for name, tests in TESTS.items():
        sets = [key for key in flown[0] if key.split()[0] == name]
        found = {s: {key: np.array([f[s][key] for f in flown]) for key in tests} for s in sets}
        if name == "iotsekf":
            found[EVIDENCE]["limit"] = np.array([f[EVIDENCE]["limit"] for f in flown])
        largest = {s.split()[1]: {key: decimals(v.max(axis=0)) for key, v in found[s].items()} for s in sets}
        for s in sets:
            limit = {key: each(v, PROBABILITY / len(tests)) for key, v in found[s].items() if key in tests}
            if s == EVIDENCE:
                limit["limit"] = MARGIN * each(found[s]["limit"], PROBABILITY)
            if name == "iotsekf":
                floor = quiet_floor(int(s[-1]))
                limit["run_threshold"] = PEAK * limit["run_threshold"]
                limit |= {key: np.maximum(limit[key], floor[key]) for key in ("bank_threshold", "slow_threshold")}
                limit["sum_threshold"] = floor["sum_threshold"]
            fields = {key: np.asarray(v).tolist() for key, v in limit.items()}
            out.append(Trained(name, s.split()[1], fields, {"largest": largest}))
    return out


def each(found: np.ndarray, probability: float) -> np.ndarray:
    """Return the limits (frequencies,) or () that a flight exceeds anywhere with `probability`; `found` (flights, ...).

    Frequencies share it alike; one that no flight shows has the limit 0.
    """
    columns = found.reshape(len(found), -1).T
    return np.array([exceeded(c, probability / len(columns)) for c in columns]).reshape(found.shape[1:])


@functools.cache
def quiet_floor(load: Any, seed: int = 1) -> dict[str, Any]:
    """Return the thresholds that sensor noise alone asks for: a still rod for 60 s, noise of the set `transport`."""
    rng, ticks = np.random.default_rng(seed), round(60.0 / DT)
    p = iotsekf.params(load=load)
    u = np.zeros((4, ticks), iotsekf.INPUTS)
    for name in ("y_rod_valid", "y_surface_valid", "y_dp_valid"):
        u[name] = 1.0
    u["y_rod"] = np.sqrt(p["r_rod"]) * rng.standard_normal((4, ticks))
    u["y_dp"] = np.sqrt(p["r_dp"]) * rng.standard_normal((4, ticks))
    frame = pd.DataFrame({path: u[n][i] for i, s in enumerate(SEGMENTS) for n, path in wires(iotsekf, s).items()})
    frame.attrs["dt"] = DT
    log = watch(frame, iotsekf, p, ("bank_cos", "bank_sin"))[:, round(5.0 / DT) :]
    c, s = log["bank_cos"], log["bank_sin"]
    residual = np.sqrt((c[:, :, 0] ** 2 + s[:, :, 0] ** 2).mean(axis=(0, 1)))
    both = np.sqrt((c.sum(axis=2) ** 2 + s.sum(axis=2) ** 2).mean(axis=(0, 1)))
    assert residual.shape == (bank.K,)
    slow = windows.SIGMA[windows.SLOW] * windows.ROUGHER[load] * np.sqrt(SLOW_WINDOW)
    return {"bank_threshold": NOISE_SIGMA * residual, "slow_threshold": NOISE_SIGMA * slow,
            "sum_threshold": np.round(3.0 * both, 7).tolist()}  # fmt: skip


TRAINING = Training("hydraulic", FIRST_SEED, FLIGHTS, collect, limits, {
    "probability_per_flight": PROBABILITY, "flight_s": FLIGHT_S, "segments": 4, "noise_scale": NOISE_SCALE,
})  # fmt: skip
