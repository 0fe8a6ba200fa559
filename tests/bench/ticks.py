"""What a tick costs, as a ratio to JSBSim alone in the same process: `python tests/bench/ticks.py [ROUNDS]`.

The cases take turns, one chunk of the log each. The ratio of a case is the median over the turns of its processor time
to that of the bare aircraft in the same turn, its spread the interquartile range over that median.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from cosim.flight.build import build
from cosim.flight.loop.recorder import open_writer
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.flight.tick import order
from cosim.scenario import load_scenario

TICKS = 200  # of a turn
TURNS = 5  # of a round
QUIET = ("detectors.enabled=[]", "elevator.feedback=measured")
CASES = (  # name, what is set, log
    ("lockstep", QUIET, False), ("lockstep, log", QUIET, True), ("detectors", (), False), ("detectors, log", (), True),
)  # fmt: skip


def timed(call: Callable[[], None]) -> float:
    """Return microseconds of the processor per call, over TICKS calls."""
    begin = time.thread_time()
    for _ in range(TICKS):
        call()
    return (time.thread_time() - begin) / TICKS * 1e6


def measure(folder: Path, rounds: int) -> list[tuple[str, float, float, float]]:
    """Return [(case, microseconds per tick, ratio to the bare aircraft, spread)]; `folder` takes the logs."""
    length = f"duration_s={(rounds * TURNS + 2) * TICKS / 200:g}"
    scenario = load_scenario("liquid-ofc", [length])
    plant = Plant(FlightPoint.of(scenario), scenario.dt)
    plant.trim()
    calls = {"bare": plant.run}
    with ExitStack() as logs:
        for name, keys, logged in CASES:
            setup = build(load_scenario("liquid-ofc", [length, *keys]))
            sinks = [logs.enter_context(open_writer(setup, folder / f"{len(calls)}.mcap"))] if logged else []
            tape, count = order(setup.loop, *sinks), iter(range(10**9))
            calls[name] = lambda tape=tape, count=count: tape.run(next(count))
        for call in calls.values():  # caches warm, kernels loaded
            timed(call)
        times = np.array([[timed(call) for call in calls.values()] for _ in range(rounds * TURNS)])
    ratio = times / times[:, :1]
    low, middle, high = np.percentile(ratio, (25, 50, 75), axis=0)
    return list(zip(calls, np.median(times, axis=0), middle, (high - low) / middle))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        for name, cost, ratio, spread in measure(Path(place), int(sys.argv[1]) if len(sys.argv) > 1 else 15):
            print(f"{name:16}{cost:8.1f} us  {ratio:6.2f} x bare  +- {spread:.0%}")
