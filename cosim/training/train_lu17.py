"""Thresholds of the hydraulic detectors from fault-free flights that nothing else uses.

The flights, FLIGHTS of 60 s, are at points drawn over the envelope: eight manoeuvres, also such that move the elevator
in steps, three levels of turbulence, aircraft and actuator up to 5 % off, noise NOISE_SCALE, four segments each. A
threshold is MARGIN times the largest statistic of any segment in any flight, what scales with the drive left out;
one that needs several samples to agree takes the largest that they agree on. What watches electromechanical segments
is trained by `train_ema`, the monitors by `train_monitors`.

    cosim train hydraulic --check      fly the training set, say what would change
    cosim train hydraulic              and write fdi/thresholds/*.json
"""

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

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
from fdi.common import bank, compact
from fdi.hydraulic import iotsekf, rtsekf, windows

MARGIN = 1.25  # 1.2 times the maximum of 40 flights left 1 alarm in 300
FLIGHTS = 384  # 16 of every manoeuvre in each air
NOISE_SCALE = 1.2  # of the sensors
TRAINING, EVALUATION = 21_000, 12_000  # first seeds of the two sets
START_S = 2.0  # filters settle
FOLDER = Path(fdi.__file__).parent / "thresholds"
# What noise alone asks for in still air: below it more flights would only find it again [unit of the valve command]
NOISE_SIGMA, FLOOR_SIGMA = 3.6, 3.0  # as stored; where the search for the largest begins
# amplitude noise of a fit over noise of a sample: sqrt(2 / n) with n samples in two periods
SLOW_WINDOW = windows.SLOW_S * np.array(windows.SLOW_HZ)


def survey_iotsekf(recorded: Any, load: float) -> dict[str, Any]:
    """Return {name: largest} over one flight: of each frequency the amplitude that would pass for an oscillation where
    noise alone set its threshold, and the largest lagged input fault; the drive's shares left out.
    """
    p = iotsekf.params(load=load)
    floor = {n: FLOOR_SIGMA / NOISE_SIGMA * np.asarray(v) for n, v in quiet_floor(load).items()}
    p["bank_threshold"], p["slow_threshold"] = floor["bank_threshold"], floor["slow_threshold"]
    fields = ("ratio", "hit", "slow_ratio", "slow_hit", "f_slow", "u_slow")
    log = watch(recorded, iotsekf, p, fields)[:, round(START_S / DT) :]
    r = p[0]
    passed = {n: np.where(log[hit] >= r["hits"], log[ratio], 0.0).max(axis=(0, 1))
              for n, ratio, hit in (("bank", "ratio", "hit"), ("slow", "slow_ratio", "slow_hit"))}  # fmt: skip
    run = np.abs(log["f_slow"]) - r["run_share"] * np.abs(log["u_slow"])
    return {"bank_threshold": passed["bank"] * floor["bank_threshold"],
            "slow_threshold": passed["slow"] * floor["slow_threshold"], "run_threshold": run.max()}  # fmt: skip


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


def surveyed(**flight: Any) -> dict[str, Any]:
    """Return what `survey` finds in one flight, as plain data."""
    found = survey(fitting(fly_hydraulic, flight))
    return {name: {key: np.asarray(v).tolist() for key, v in values.items()} for name, values in found.items()}


def train(*, first_seed: int = TRAINING, number: int = FLIGHTS, **how: Any) -> dict:
    """Fly the training set; return {"largest": {set: {name: largest}}, "flights": number, "first_seed"}.

    `how`: see `cosim.campaign.jobs.work`.
    """
    hydraulic = training(first_seed, number)
    most: dict = {}
    for flown in work([(surveyed, flight) for flight in hydraulic], **how):
        for name, values in flown.items():
            kept = most.setdefault(name, {})
            for key, value in values.items():
                kept[key] = np.maximum(kept.get(key, 0.0), value)
    return {"largest": most, "flights": len(hydraulic), "first_seed": first_seed}


def stored_as(name: str) -> Any:
    """Return the threshold set of what training calls `name`."""
    return f"flight{name.removeprefix('rtsekf').removeprefix('flight')}"


def store(found: dict) -> None:
    """Write what `train` found into the files that the detectors read, each with how it was found."""
    most = found["largest"]
    how = {"flights": found["flights"], "first_seed": found["first_seed"], "margin": MARGIN, "flight_s": 60.0,
           "segments": 4}  # fmt: skip
    quiet = {k: quiet_floor(k) for k in (0, 1, 2)}
    for file, names in (("iotsekf", [f"flight_load{k}" for k in (0, 1, 2)]),
                        ("rtsekf", [f"rtsekf_load{k}" for k in (0, 1)])):
        path = FOLDER / f"{file}.json"
        data = json.loads(path.read_text(encoding="utf-8"))
        for name in names:
            target = data[stored_as(name)]
            for key, value in most[name].items():
                new = MARGIN * np.asarray(value)
                if key in ("bank_threshold", "slow_threshold"):
                    new = np.maximum(new, quiet[int(name[-1])][key])
                target[key] = np.round(new, 7).tolist()
            if file == "iotsekf":
                target["sum_threshold"] = quiet[int(name[-1])]["sum_threshold"]
        largest = {n: {k: np.round(v, 7).tolist() for k, v in most[n].items()} for n in names}
        chosen = {k: v for k, v in data.get("training", {}).items() if k == "chosen"}
        data["training"] = {**how, "largest": largest, **chosen}
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
    for name, values in found["largest"].items():
        file = name.partition("_load")[0] if name.startswith("rtsekf") else "iotsekf"
        held = json.loads((FOLDER / f"{file}.json").read_text(encoding="utf-8"))
        for key, value in values.items():
            stored = np.asarray(held[stored_as(name)][key])
            trained = MARGIN * np.asarray(value)
            k = int(np.argmax(trained / stored)) if stored.ndim else 0
            out.append((file, name, key, float(np.ravel(stored)[k]), float(np.ravel(trained)[k])))
    return out
