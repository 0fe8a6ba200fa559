"""Thresholds of the detectors of a hydraulic segment from fault-free flights that nothing else uses.

`python -m cosim.training hydraulic`: filters. FLIGHTS of 60 s at points drawn over an envelope, eight
manoeuvres, also such that move the elevator in steps, three levels of turbulence, aircraft and actuator up to 5 % off,
noise NOISE_SCALE, four segments each. A threshold is what the largest statistic of a flight exceeds with PROBABILITY,
shared among the detector's TESTS and their frequencies (`threshold_fit`), what scales with the drive left out; one that
needs several samples to agree takes the largest that they agree on.

`python -m cosim.training monitors`: as many, manoeuvres of `train_aircraft`, at SPEEDS, half of them at corners of the
actuator's tolerances, in half of these the three symbols that matter most as WORST says. Each statistic is held against
the motion that it may grow with: a threshold is fixed by what no motion makes, and the share of the motion is trained.
On electromechanical segments the position monitor has the threshold alone.
"""

import math
from typing import Any

import numpy as np

from cosim.training import flights as drawn
from cosim.training.flights import DT, FLIGHT_S, NOISE_SCALE, START_S, TOLERANCE, fly_hydraulic, somewhere, watch
from cosim.training.threshold_fit import HELD, PROBABILITY, exceeded, lasting
from cosim.training.trainer import Limits, Training, decimals
from fdi.hydraulic import iotsekf, rtsekf, rtsekf_flight
from fdi.isolation import likelihood
from fdi.monitors import ofc_monitor, position_monitor

FLIGHTS = 384  # 16 of every manoeuvre in each air
FIRST_SEED = 21_000
SETTLED = round(START_S / DT)  # ticks
PEAK = 2.0  # times what lasts: the largest single tick of a lagged input fault; from it on more is looked for
MARGIN = 1.5  # of evidence: flights at points and in manoeuvres drawn otherwise have 1.6 times the largest of these
NEVER = 1e9  # of evidence, that no flight has: an alarm teaches nothing
EVIDENCE = "iotsekf flight_load2"  # the set whose likelihood ratios are asked for
TESTS = {"iotsekf": ("run_threshold",), "rtsekf": ("threshold", "step"), "rtsekf_flight": ("pair_threshold",)}
GRID = np.geomspace(0.1e-3, 8e-3, 32)  # thresholds tried for the crossing counter [m]
LEAST_POSITION = math.radians(0.5)  # of the position monitor: rigging, a step that is not quite followed
LEAST = 0.5e-3  # of the crossing counter's threshold: three times the noise of its residual, 0.17 mm at most [m]
SPEEDS = (180.0, 365.0)  # calibrated airspeed [kt]
# The signs for which a servo misses its reference most: each lowers the rod's speed per valve opening, which is
# phi_n sqrt(P_s) / A_p
WORST = {"A_p": 1.0, "phi_n": -1.0, "P_s": -1.0}
SHARES = (0.1, 0.2, 0.25, 0.3, 0.4)  # of the reference's motion, tried beside them


def survey_iotsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: the lagged input fault that lasts, the command's share left out; with the
    pressure the evidence of each hypothesis, 0 where none speaks for it."""
    p = iotsekf.params(load=load)
    p["limit"], p["asks"] = NEVER, np.where(p["asks"] > 0.0, likelihood.ALL, 0.0)
    log = watch(recorded, iotsekf, p, ("f_slow", "u_slow", "ev", "ev_octave"))[:, SETTLED:]
    r = p[0]
    run = np.abs(log["f_slow"]) - r["run_share"] * np.abs(log["u_slow"])
    out = {"run_threshold": lasting(run, HELD * float(r["run_confirm"]), DT).max()}
    if load == 2:
        asked = log["ev"][(log["ev_octave"] >= 0.0) & (np.arange(log.shape[1]) * DT > likelihood.LEARN_S - START_S)]
        out["limit"] = np.maximum(asked.max(axis=0), 0.0)
    return out


def survey_rtsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: the lagged output fault, and how far it is from what it was [m]."""
    p = rtsekf.params(load=load)
    p["threshold"] = p["step"] = 1e3  # no alarm holds what it was
    log = watch(recorded, rtsekf, p, ("f_slow", "f_was"))[:, SETTLED:]
    return {"threshold": np.abs(log["f_slow"]).max(), "step": np.abs(log["f_slow"] - log["f_was"]).max()}


def survey_rtsekf_flight(recorded: Any) -> dict[str, Any]:
    """Return {"pair_threshold": largest} over one flight: how far rod and surface are apart [m] for HELD of what an
    alarm takes."""
    p = rtsekf_flight.params(pair_threshold=1e3)  # no alarm holds what is learned
    log = watch(recorded, rtsekf_flight, p, ("pair_d",))[:, SETTLED:]
    return {"pair_threshold": lasting(np.abs(log["pair_d"]), HELD * float(p["pair_confirm"][0]), DT).max()}


SURVEYS: dict[str, Any] = {
    "iotsekf": (survey_iotsekf, {f"flight_load{k}": {"load": k} for k in (0, 1, 2)}),
    "rtsekf": (survey_rtsekf, {f"flight_load{k}": {"load": k} for k in (0, 1)}),
    "rtsekf_flight": (survey_rtsekf_flight, {"flight": {}}),
}


def surveyed(**flight: Any) -> dict[str, Any]:
    """Return the largest statistics of every filter over one flight, {detector set: {name: value}}, plain data."""
    recorded = fly_hydraulic(**somewhere(flight))
    found = {f"{name} {which}": survey(recorded, **how) for name, (survey, sets) in SURVEYS.items()
             for which, how in sets.items()}  # fmt: skip
    return {name: {key: np.asarray(v).tolist() for key, v in values.items()} for name, values in found.items()}


def limits(flown: list[dict[str, Any]]) -> Limits:
    """Return the sets of thresholds at PROBABILITY of what `surveyed` found in every flight."""
    out: Limits = {}
    for s, tests in flown[0].items():
        name, which = s.split()
        found = {key: np.array([f[s][key] for f in flown]) for key in tests}
        made = {key: each(v, PROBABILITY / len(TESTS[name])) for key, v in found.items() if key != "limit"}
        if s == EVIDENCE:
            made["limit"] = MARGIN * each(found["limit"], PROBABILITY)
        if name == "iotsekf":
            made["run_threshold"] = PEAK * made["run_threshold"]
        sets, how = out.setdefault(name, ({}, {"largest": {}}))
        sets[which] = decimals(made)
        how["largest"][which] = decimals({key: v.max(axis=0) for key, v in found.items()})
    return out


def each(found: np.ndarray, probability: float) -> np.ndarray:
    """Return the limits (frequencies,) or () that a flight exceeds anywhere with `probability`; `found` (flights, ...).

    Frequencies share it alike; one that no flight shows has the limit 0.
    """
    columns = found.reshape(len(found), -1).T
    return np.array([exceeded(c, probability / len(columns)) for c in columns]).reshape(found.shape[1:])


def survey_ofc_monitor(recorded: Any) -> dict[str, np.ndarray]:
    """Return of a flight (band, share) the largest threshold of GRID [m] at which a band still counts an oscillation
    beyond it and each of SHARES of the reference's motion, 0 for none, and (band,) that motion's mean [m]."""
    p, out, motion = ofc_monitor.params(), np.zeros((ofc_monitor.B, len(SHARES))), np.zeros(ofc_monitor.B)
    for k, share in enumerate(SHARES):
        p["share"] = share
        low, high = np.full(ofc_monitor.B, -1), np.full(ofc_monitor.B, len(GRID))
        while (high - low > 1).any():  # the largest that counts is at or above low, below high
            middle = np.clip((low + high) // 2, 0, len(GRID) - 1)
            p["threshold"] = GRID[middle]
            log = watch(recorded, ofc_monitor, p, ("counts", "ref_peak"))
            counts, motion = log["counts"].any(axis=(0, 1)), log["ref_peak"].mean(axis=(0, 1))
            low, high = np.where(counts, np.maximum(low, middle), low), np.where(counts, high, np.minimum(high, middle))
        out[:, k] = np.where(low >= 0, GRID[low], 0.0)
    return {"threshold": out, "motion": motion}


def survey_position_monitor(recorded: Any) -> float:
    """Return of a flight the largest share of the model's lag by which any segment deviates beyond LEAST_POSITION for
    HELD of the confirmation time, 0 for none."""
    p = position_monitor.params(threshold=1.0, share=0.0)
    log = watch(recorded, position_monitor, p, ("r", "lag"))[:, SETTLED:]
    beyond = lasting(np.abs(log["r"]), HELD * float(p["t_confirm"][0]), DT) - LEAST_POSITION
    return float((np.maximum(beyond, 0.0) / np.maximum(log["lag"], 1e-9)).max())


def cornered(flight: dict[str, Any], first_seed: int = FIRST_SEED) -> dict[str, Any]:
    """Return a flight of the monitors: every second group of 24, each manoeuvre in each air, is at a corner of the
    actuator's tolerances."""
    own, which = flight["tolerances"]["hydraulic"], (flight["seed"] - first_seed) // 24 % 4
    if which % 2 == 0:
        return flight
    rng = np.random.default_rng([flight["seed"], 3])
    sign = {name: rng.choice((-1.0, 1.0)) for name in own} | (WORST if which == 3 else {})
    corner = {name: float(1.0 + TOLERANCE * sign[name]) for name in own}
    return flight | {"tolerances": flight["tolerances"] | {"hydraulic": corner}}


def monitored(**flight: Any) -> dict[str, Any]:
    """Return what the surveys of the monitors find in one flight, as plain data."""
    recorded = fly_hydraulic(**somewhere(cornered(flight), SPEEDS))
    ofc = {key: value.tolist() for key, value in survey_ofc_monitor(recorded).items()}
    return {"ofc_monitor": ofc, "position_monitor": survey_position_monitor(recorded)}


def monitor_limits(flown: list[dict[str, Any]]) -> Limits:
    """Return the thresholds at PROBABILITY of what `monitored` found in every flight."""
    shares = np.array([f["position_monitor"] for f in flown])
    position = {"threshold": LEAST_POSITION, "share": exceeded(shares, PROBABILITY)}
    ofc = [{key: np.array(value) for key, value in f["ofc_monitor"].items()} for f in flown]
    motion = np.mean([f["motion"] for f in ofc], axis=0)
    fields, largest = _shared(np.array([f["threshold"] for f in ofc]), motion)
    ema = {"threshold": LEAST_POSITION, "share": 0.0}
    return {"position_monitor": ({"flight": decimals(position), "flight_ema": decimals(ema)},
                                 {"found": {"largest_share": float(shares.max())}}),
            "ofc_monitor": ({"flight": decimals(fields)}, {"found": {"largest": largest}})}  # fmt: skip


def _shared(found, motion):
    """Return threshold and share of each band, of SHARES the one with the least limit at the mean `motion` (band,) of
    the reference, and the largest that was seen there; `found` (flights, band, share)."""
    each = np.array([[exceeded(found[:, b, k], PROBABILITY / ofc_monitor.B) for k in range(len(SHARES))]
                     for b in range(ofc_monitor.B)])  # fmt: skip
    each = np.maximum(each, LEAST)
    best = (each + np.array(SHARES) * motion[:, None]).argmin(axis=1)
    band = np.arange(ofc_monitor.B)
    fields = {"threshold": each[band, best].tolist(), "share": np.array(SHARES)[best].tolist()}
    return fields, found.max(axis=0)[band, best].tolist()


_ABOUT = {"probability_per_flight": PROBABILITY, "flight_s": FLIGHT_S, "segments": 4, "noise_scale": NOISE_SCALE}
FILTERS = Training(FIRST_SEED, FLIGHTS, drawn.over_envelope, surveyed, limits, _ABOUT)
MONITORS = Training(FIRST_SEED, FLIGHTS, drawn.manoeuvring, monitored, monitor_limits, _ABOUT)
