"""Thresholds of pitch_moment_glr from fault-free flights that nothing else uses: `cosim train pitch_moment`.

Flights as those of `cosim.training.train_aircraft`, up to moderate turbulence, with the manoeuvre at a random time. Of
each flight the largest likelihood ratio of every band of frequencies counts; a threshold is what that exceeds with
PROBABILITY per flight of 60 s, shared among the bands; seven flights per air and manoeuvre, so that its tail is
extrapolated.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

import fdi
from cosim.campaign.jobs import work
from cosim.files import replace_text
from cosim.flight.detectors import sources
from cosim.flight.signals import detect, fly
from cosim.training import train_aircraft
from cosim.training.flights import scenario
from cosim.training.tail import PROBABILITY, exceeded
from fdi.common import compact, tuning
from fdi.pitch_moment_glr import pitch_moment_glr

NAME = "pitch_moment_glr"
FLIGHTS, TRAINING = 168, 36_000  # how many, and the first seed
MARGIN = 1.25  # without it 2 of 48 other flights up to moderate air alarmed, by 1 and 4 %: manoeuvres in still air
PATH = Path(fdi.__file__).parent / "thresholds" / f"{NAME}.json"


def arguments(index: int, first_seed: int = TRAINING) -> dict[str, Any]:
    """Return the arguments of `flights.scenario` of training flight `index`: still, light and moderate air in turn."""
    block = index // 8
    made = train_aircraft.arguments(index % 8 + 8 * (block % 3 + 4 * (block // 3)), first_seed)
    start = np.random.default_rng([first_seed, index, 1]).uniform(5.0, 45.0)
    if made["manoeuvre"]["kind"] != "cruise":
        made["manoeuvre"] = made["manoeuvre"] | {"start_s": float(start)}
    return made


def surveyed(index: int, first_seed: int = TRAINING) -> list[float]:
    """Return the largest likelihood ratio of each band in one training flight."""
    wires, made = sources(NAME), arguments(index, first_seed)
    frame = fly(scenario(**made), dict.fromkeys(wires.values()))
    block = index // 8
    p = train_aircraft.fitted(NAME, index % 8 + 8 * (block % 3 + 4 * (block // 3)))
    log = detect(frame, pitch_moment_glr, wires, p, ("raw", "valid"))
    return np.where(log["valid"][:, None] > 0.5, log["raw"], 0.0).max(axis=0).tolist()


def train(*, first_seed: int = TRAINING, number: int = FLIGHTS, **how: Any) -> dict[str, Any]:
    """Fly the training set; return {"threshold", "largest", "flights", "first_seed"}; `how` as for `jobs.work`."""
    largest = np.array(work([(surveyed, {"index": k, "first_seed": first_seed}) for k in range(number)], **how))
    limits = [MARGIN * exceeded(column, PROBABILITY / largest.shape[1]) for column in largest.T]
    return {"threshold": limits, "largest": largest.max(axis=0).tolist(), "flights": number, "first_seed": first_seed}


def changes(found: dict[str, Any]) -> list[tuple]:
    """Return [(file, set, field, stored, trained)] of the thresholds that `store` would write, the largest change."""
    stored = np.array(json.loads(PATH.read_text(encoding="utf-8"))["flight"]["threshold"])
    trained = np.array(found["threshold"])
    k = int(np.argmax(np.abs(trained - stored)))
    return [(NAME, "flight", "threshold", float(stored[k]), float(trained[k]))]


def store(found: dict[str, Any]) -> None:
    """Write what `train` found into `fdi/thresholds/`, with how it was found."""
    held = json.loads(PATH.read_text(encoding="utf-8"))
    held["flight"]["threshold"] = np.round(found["threshold"], 3).tolist()
    held["training"] = {
        "command": "cosim train pitch_moment", "probability_per_flight": PROBABILITY, "flight_s": 60.0,
        "flights": found["flights"], "margin": MARGIN,
        "first_seed": found["first_seed"], "air": list(train_aircraft.TURBULENCE[:3]),
        "noise_scale": train_aircraft.NOISE_SCALE, "tolerance": train_aircraft.TOLERANCE,
        "largest": np.round(found["largest"], 3).tolist(),
    }  # fmt: skip
    replace_text(PATH, compact.text(held))
    tuning.forget()
