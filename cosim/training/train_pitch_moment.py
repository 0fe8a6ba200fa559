"""Thresholds of pitch_moment_glr from fault-free flights that nothing else uses: `cosim train pitch_moment`.

Flights as those of `cosim.training.train_aircraft`, up to moderate turbulence, with the manoeuvre at a random time. Of
each flight the largest likelihood ratio of every band of frequencies counts; a threshold is what that exceeds with
RARE per flight of 60 s, shared among the bands; fourteen flights per air and manoeuvre, so that its tail is
extrapolated.
"""

import numpy as np

from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect, fly
from cosim.training import train_aircraft
from cosim.training.flights import AIR, FLIGHT_S, NOISE_SCALE, TOLERANCE, scenario
from cosim.training.threshold_fit import exceeded
from cosim.training.trainer import Trained, Training, over
from fdi.pitch_moment_glr import pitch_moment_glr

NAME = "pitch_moment_glr"
FLIGHTS, FIRST_SEED = 336, 36_000
RARE = 60.0 / 360e3  # of a false alarm in a flight: one in 100 hours of valid flight


def placed(index: int) -> int:
    """Return the flight of `train_aircraft` with manoeuvre and air of flight `index`: none is in severe air."""
    block = index // 8
    return index % 8 + 8 * (block % 3 + 4 * (block // 3))


def surveyed(index: int, first_seed: int = FIRST_SEED) -> list[float]:
    """Return the largest likelihood ratio of each band in one training flight."""
    wires, flight = sources(NAME), train_aircraft.arguments(placed(index), first_seed)
    if flight["manoeuvre"]["kind"] != "cruise":
        start = float(np.random.default_rng([first_seed, index, 1]).uniform(5.0, 45.0))
        flight["manoeuvre"] = flight["manoeuvre"] | {"start_s": start}
    frame = fly(scenario(**flight), dict.fromkeys(wires.values()))
    log = detect(frame, pitch_moment_glr, wires, train_aircraft.fitted(NAME, placed(index)), ("raw", "valid"))
    return np.where(log["valid"][:, None] > 0.5, log["raw"], 0.0).max(axis=0).tolist()


def limits(flown: list[list[float]]) -> list[Trained]:
    """Return the thresholds of the bands of frequencies from what `surveyed` found."""
    largest = np.array(flown)
    threshold = [exceeded(column, RARE / largest.shape[1]) for column in largest.T]
    return [Trained(NAME, "flight", {"threshold": threshold}, {"largest": np.round(largest.max(axis=0), 3).tolist()})]


def flights(first_seed: int, number: int) -> list[dict[str, int]]:
    """Return the arguments of `surveyed` of every flight."""
    return [{"index": k, "first_seed": first_seed} for k in range(number)]


TRAININGS = {"pitch_moment": Training("pitch_moment", FIRST_SEED, FLIGHTS, over(surveyed, flights), limits, {
    "probability_per_flight": RARE, "flight_s": FLIGHT_S, "air": list(AIR[:3]),
    "noise_scale": NOISE_SCALE, "tolerance": TOLERANCE,
})}  # fmt: skip
