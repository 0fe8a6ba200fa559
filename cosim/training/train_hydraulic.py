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
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import minimum_filter1d

import fdi
from cosim.campaign.jobs import work
from cosim.errors import TrimError
from cosim.files import replace_text
from cosim.scenario.catalog import SEGMENTS
from cosim.training.flights import (
    DT,
    MANOEUVRES,
    TURBULENCE,
    draw,
    envelope,
    fly_hydraulic,
    watch,
    wires,
)
from cosim.training.threshold_fit import PROBABILITY, exceeded
from cosim.training.train_aircraft import HELD, trimming
from fdi.common import bank, compact
from fdi.hydraulic import iotsekf, rtsekf, windows

FLIGHTS = 384  # 16 of every manoeuvre in each air
NOISE_SCALE = 1.2  # of the sensors
TRAINING, EVALUATION = 21_000, 12_000  # first seeds of the two sets
START_S = 2.0  # filters settle
FOLDER = Path(fdi.__file__).parent / "thresholds"
# What noise alone asks for in still air, where the search finds nothing; where it begins. Of the amplitudes that noise
# alone makes 2.4e-6 are larger; at 1 Hz a flight has 240 fits apart, and two in a row must agree and look like a sine
NOISE_SIGMA, FLOOR_SIGMA = 3.6, 1.8
PEAK = 2.0  # times what lasts: the largest single tick of a lagged input fault; from it on more is looked for
NEVER = 1e9  # fits in a row that no flight has: what is found is no alarm, behind which the filter would look otherwise
TESTS = {"iotsekf": ("bank_threshold", "slow_threshold", "run_threshold"), "rtsekf": ("threshold", "step")}
# amplitude noise of a fit over noise of a sample: sqrt(2 / n) with n samples in two periods
SLOW_WINDOW = windows.SLOW_S * np.array(windows.SLOW_HZ)


def survey_iotsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: of each frequency the amplitude that would pass for an oscillation with a
    threshold of FLOOR_SIGMA, and the largest lagged input fault that lasts; the drive's shares left out.
    """
    p = iotsekf.params(load=load)
    floor = {n: FLOOR_SIGMA / NOISE_SIGMA * np.asarray(v) for n, v in quiet_floor(load).items()}
    p["bank_threshold"], p["slow_threshold"] = floor["bank_threshold"], floor["slow_threshold"]
    hits, p["hits"] = float(p["hits"][0]), NEVER
    fields = ("ratio", "hit", "slow_ratio", "slow_hit", "f_slow", "u_slow")
    log = watch(recorded, iotsekf, p, fields)[:, round(START_S / DT) :]
    r = p[0]
    passed = {n: np.where(log[hit] >= hits, log[ratio], 0.0).max(axis=(0, 1))
              for n, ratio, hit in (("bank", "ratio", "hit"), ("slow", "slow_ratio", "slow_hit"))}  # fmt: skip
    run = np.abs(log["f_slow"]) - r["run_share"] * np.abs(log["u_slow"])
    held = minimum_filter1d(run, max(round(HELD * float(r["run_confirm"]) / DT), 1), axis=1)
    return {"bank_threshold": passed["bank"] * floor["bank_threshold"],
            "slow_threshold": passed["slow"] * floor["slow_threshold"], "run_threshold": held.max()}  # fmt: skip


def survey_rtsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: the lagged output fault, and how far it is from what it was [m]."""
    p = rtsekf.params(load=load)
    p["threshold"] = p["step"] = 1e3  # no alarm holds what it was
    log = watch(recorded, rtsekf, p, ("f_slow", "f_was"))[:, round(START_S / DT) :]
    found = {"threshold": log["f_slow"], "step": log["f_slow"] - log["f_was"]}
    return {name: float(np.abs(v).max()) for name, v in found.items()}


def survey(recorded: Any) -> Any:
    """Return every detector's largest statistics over one flight, {detector or set: {name: value}}."""
    out = {f"flight_load{k}": survey_iotsekf(recorded, k) for k in (0, 1, 2)}
    out |= {f"rtsekf_load{k}": survey_rtsekf(recorded, k) for k in (0, 1)}
    return out


def lively(mass_t: Any) -> Any:
    """Return the manoeuvres of training: those of [Sun13] section IV, and those that drive the elevators fastest."""
    weak = {"amplitude_g": 0.15}  # what a heavy aircraft has left
    kinds = [{"kind": kind, **(weak if kind in ("nose_up", "pitch_protection") and mass_t > 300.0 else {})}
             for kind in MANOEUVRES]  # fmt: skip
    return [*kinds, {"kind": "three_two_one_one", "amplitude_deg": 2.0, "unit_s": 0.5}, {"kind": "nz_doublet"}]


def training(first_seed: int = TRAINING, number: int = FLIGHTS) -> Any:
    """Return the arguments of `flights.scenario` of every training flight, at points over the envelope that trim."""
    out = []
    for k in range(number):
        rng = np.random.default_rng([first_seed, k])
        where = envelope(rng)
        manoeuvre = lively(where["mass_t"])[k % 8]
        flight = draw(first_seed + k, point=where, manoeuvre=manoeuvre, turbulence=TURBULENCE[k // 8 % 3])
        out.append({**flight, "sensors": {"noise_scale": NOISE_SCALE}})
    return out


def fitting(fly: Any, flight: Any) -> Any:
    """Return the table of a flight; where its point does not trim, that of the next one that does."""
    rng = np.random.default_rng(flight["seed"])
    while True:
        try:
            return fly(**flight)
        except TrimError:
            flight = {**flight, "flight": {**flight["flight"], **envelope(rng)}}


def everywhere(flight: dict[str, Any]) -> Any:
    """Return the table of a flight at a point drawn over the whole envelope by its seed."""
    rng = np.random.default_rng([flight["seed"], 2])
    return fly_hydraulic(**trimming(rng, flight, {"turbulence": flight["flight"]["turbulence"]}))


def surveyed(**flight: Any) -> dict[str, Any]:
    """Return what `survey` finds in one flight, as plain data."""
    found = survey(everywhere(flight))
    return {name: {key: np.asarray(v).tolist() for key, v in values.items()} for name, values in found.items()}


def train(*, first_seed: int = TRAINING, number: int = FLIGHTS, **how: Any) -> dict:
    """Fly the training set; return {"limits": {set: {name: threshold}}, "largest": the same, "flights", "first_seed"}.

    `how`: see `cosim.campaign.jobs.work`.
    """
    flown = list(work([(surveyed, flight) for flight in training(first_seed, number)], **how))
    return limits(flown) | {"flights": len(flown), "first_seed": first_seed}


def limits(flown: list[dict[str, Any]]) -> dict[str, Any]:
    """Return {"limits", "largest"} at PROBABILITY of what `surveyed` found in every flight."""
    out: dict = {"limits": {}, "largest": {}}
    for name in flown[0]:
        tests = TESTS["rtsekf" if name.startswith("rtsekf") else "iotsekf"]
        found = {key: np.array([f[name][key] for f in flown]) for key in tests}
        limit = {key: each(v, PROBABILITY / len(tests)) for key, v in found.items()}
        if "run_threshold" in limit:
            limit["run_threshold"] = PEAK * limit["run_threshold"]
            for key in ("bank_threshold", "slow_threshold"):
                limit[key] = np.maximum(limit[key], quiet_floor(int(name[-1]))[key])
        out["limits"][name] = {key: np.asarray(v).tolist() for key, v in limit.items()}
        out["largest"][name] = {key: np.max(v, axis=0).tolist() for key, v in found.items()}
    return out


def each(found: np.ndarray, probability: float) -> np.ndarray:
    """Return the limits (frequencies,) or () that a flight exceeds anywhere with `probability`; `found` (flights, ...).

    Frequencies share it alike; one that no flight shows has the limit 0.
    """
    columns = found.reshape(len(found), -1).T
    return np.array([exceeded(c, probability / len(columns)) for c in columns]).reshape(found.shape[1:])


def stored_as(name: str) -> Any:
    """Return the threshold set of what training calls `name`."""
    return f"flight{name.removeprefix('rtsekf').removeprefix('flight')}"


def store(found: dict) -> None:
    """Write what `train` found into the files that the detectors read, each with how it was found."""
    for file, tests in TESTS.items():
        path = FOLDER / f"{file}.json"
        data = json.loads(path.read_text(encoding="utf-8"))
        names = [n for n in found["limits"] if n.startswith("rtsekf") == (file == "rtsekf")]
        for name in names:
            target = data[stored_as(name)]
            target |= {key: np.round(found["limits"][name][key], 7).tolist() for key in tests}
            if file == "iotsekf":
                target["sum_threshold"] = quiet_floor(int(name[-1]))["sum_threshold"]
        data["training"] = {
            "command": "cosim train hydraulic", "probability_per_flight": PROBABILITY, "flight_s": 60.0, "segments": 4,
            "flights": found["flights"], "first_seed": found["first_seed"], "noise_scale": NOISE_SCALE,
            "largest": {n: {k: np.round(v, 7).tolist() for k, v in found["largest"][n].items()} for n in names},
        }  # fmt: skip
        replace_text(path, compact.text(data))


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


def changes(found: dict) -> list[tuple]:
    """Return [(file, set, field, stored, trained)] of every threshold that `store` would write, largest of a row."""
    out = []
    for name, values in found["limits"].items():
        file = name.partition("_load")[0] if name.startswith("rtsekf") else "iotsekf"
        held = json.loads((FOLDER / f"{file}.json").read_text(encoding="utf-8"))
        for key, value in values.items():
            stored, trained = np.asarray(held[stored_as(name)][key]), np.asarray(value)
            k = int(np.argmax(trained / stored)) if stored.ndim else 0
            out.append((file, name, key, float(np.ravel(stored)[k]), float(np.ravel(trained)[k])))
    return out
