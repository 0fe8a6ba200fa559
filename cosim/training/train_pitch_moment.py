"""Thresholds of pitch_moment_glr from fault-free flights that nothing else uses: `cosim train pitch_moment`.

Flights as those of `cosim.training.train_aircraft`, up to moderate turbulence, with the manoeuvre at a random time. Of
each flight the largest likelihood ratio of every band of frequencies counts; a threshold is what that exceeds with
RARE per flight of 60 s, shared among the bands; fourteen flights per air and manoeuvre, so that its tail is
extrapolated.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.training import train_aircraft
from cosim.training.flights import AIR, FLIGHT_S, NOISE_SCALE, TOLERANCE, scenario
from cosim.training.threshold_fit import exceeded
from cosim.training.trainer import Trained, Training
from fdi.pitch_moment_glr import pitch_moment_glr

NAME = "pitch_moment_glr"
FLIGHTS, FIRST_SEED = 336, 36_000
RARE = 60.0 / 360e3  # of a false alarm in a flight: one in 100 hours of valid flight


def arguments(index: int, first_seed: int = FIRST_SEED) -> dict[str, Any]:
    """Return the arguments of `flights.scenario` of training flight `index`: still, light and moderate air in turn."""
    block = index // 8
    made = train_aircraft.arguments(index % 8 + 8 * (block % 3 + 4 * (block // 3)), first_seed)
    start = np.random.default_rng([first_seed, index, 1]).uniform(5.0, 45.0)
    if made["manoeuvre"]["kind"] != "cruise":
        made["manoeuvre"] = made["manoeuvre"] | {"start_s": float(start)}
    return made


def surveyed(index: int, first_seed: int = FIRST_SEED) -> list[float]:
    """Return the largest likelihood ratio of each band in one training flight."""
    wires, made = sources(NAME), arguments(index, first_seed)
    frame = fly(scenario(**made), dict.fromkeys(wires.values()))
    block = index // 8
    p = train_aircraft.fitted(NAME, index % 8 + 8 * (block % 3 + 4 * (block // 3)))
    log = detect(frame, pitch_moment_glr, wires, p, ("raw", "valid"))
    return np.where(log["valid"][:, None] > 0.5, log["raw"], 0.0).max(axis=0).tolist()


def collect(first_seed: int, number: int, run: Callable[..., Any]) -> np.ndarray:
    """Return the largest likelihood ratios (flights, bands)."""
    return np.array(run([(surveyed, {"index": k, "first_seed": first_seed}) for k in range(number)]))


def limits(largest: np.ndarray) -> list[Trained]:
    """Return the thresholds of the bands of frequencies from `collect`."""
    threshold = [exceeded(column, RARE / largest.shape[1]) for column in largest.T]
    return [Trained(NAME, "flight", {"threshold": threshold}, {"largest": np.round(largest.max(axis=0), 3).tolist()})]


TRAINING = Training("pitch_moment", FIRST_SEED, FLIGHTS, collect, limits, {
    "probability_per_flight": RARE, "flight_s": FLIGHT_S, "air": list(AIR[:3]),
    "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE,
})  # fmt: skip
