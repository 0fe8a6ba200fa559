"""What a tick costs, as a ratio to JSBSim alone in the same process.

The cases take turns, one chunk of the log each: the ratio of a case is the median over the turns of its processor time
to that of its yardstick in the same turn, its spread the interquartile range over that median. Processor time, so that
a busy machine blurs the figures less; it fills caches all the same.
"""

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from cosim.log.writer import ROWS
from cosim.scenario import Scenario, load_scenario

TURNS = 5  # of a round: 5 s of flight of every case
ELEVEN = (  # what "all detectors" means, whatever is added
    *("rfafe", "rfafe_airframe", "lpv_smo", "control_redundancy", "iotsekf", "rtsekf", "rtsekf_flight"),
    *("ema_kalman", "ema_kalman_flight", "position_monitor", "ofc_monitor"),
)
B747 = {"ic/h-sl-ft": 20000.0, "ic/vc-kts": 290.0, "ic/gamma-deg": 0.0, "propulsion/set-running": -1}
QUIET = ("detectors.enabled=[]", "elevator.feedback=measured")
CASES = (  # name, what is set, log
    ("lockstep", QUIET, False),  # four actuators, sensors, law
    ("lockstep, log", QUIET, True),
    ("detectors", (f"detectors.enabled={list(ELEVEN)}",), False),  # the eleven
    ("detectors, log", (f"detectors.enabled={list(ELEVEN)}",), True),
    ("every shipped detector", (), False),
)


def measure(folder: Path, rounds: int, progress: Callable[[int], None]) -> tuple[list[dict], dict[str, float]]:
    """Return (rows {name, us_per_tick, against, ratio, spread}, {"lockstep", "with_detectors": factor of real time}).

    `folder` takes the logs; `progress(k)` is called after every round.
    """
    from cosim.flight.plant.plant import Plant, bare_model
    from cosim.flight.plant.point import FlightPoint

    length = f"duration_s={(rounds * TURNS + 2) * ROWS / 200:g}"
    scenario = load_scenario("liquid-ofc", [length])
    flown = Plant(FlightPoint.of(scenario), scenario.dt)
    flown.trim()
    with ExitStack() as open_logs:
        cases = [
            ("B747", bare_model(Path("B747"), scenario.dt, B747)[0], None),  # the jsbsim wheel's own, run() only
            ("bare", flown.run, 0),  # our aircraft, run() only
        ]
        for name, given, logged in CASES:
            path = folder / f"{len(cases)}.mcap" if logged else None
            cases.append((name, flying(load_scenario("liquid-ofc", [length, *given]), path, open_logs)[0], 1))
        for _, call, _ in cases:  # caches warm, kernels loaded
            timed(call)
        times = np.empty((rounds * TURNS, len(cases)))
        for k in range(len(times)):
            for i, (_, call, _) in enumerate(cases):
                times[k, i] = timed(call)
            if k % TURNS == TURNS - 1:
                progress(k // TURNS + 1)
    rows = [_row(name, times[:, i], against, times, cases) for i, (name, _, against) in enumerate(cases)]
    at = {name: i for i, (name, _, _) in enumerate(cases)}
    for name in ("lockstep", "detectors"):
        more = times[:, at[f"{name}, log"]] - times[:, at[name]]
        rows.append(_row(f"the log of {name} alone", more, at["bare"], times, cases))
    cost = {row["name"]: row["us_per_tick"] for row in rows}
    named = {"lockstep": "lockstep, log", "with_detectors": "detectors, log"}
    return rows, {key: scenario.dt * 1e6 / cost[name] for key, name in named.items()}


def flying(scenario: Scenario, path: Path | None = None, open_logs: Any = None) -> tuple[Callable[[], None], Any]:
    """Return (what flies one tick of a scenario, its loop), logged to `path` unless that is None."""
    from cosim.flight.build import build
    from cosim.flight.loop.recorder import open_writer

    setup = build(scenario)
    tape = setup.loop.tape(*([open_logs.enter_context(open_writer(setup, path))] if path else []))
    count = iter(range(10**9))
    return lambda: tape.run(next(count)), setup.loop


def timed(call: Callable[[], None]) -> float:
    """Return microseconds of the processor per call, over one chunk of the log."""
    begin = time.thread_time()
    for _ in range(ROWS):
        call()
    return (time.thread_time() - begin) / ROWS * 1e6


def _row(name, taken, against, times, cases):
    row = {"name": name, "us_per_tick": float(np.median(taken)), "against": None, "ratio": None, "spread": None}
    if against is None:
        return row
    low, middle, high = np.percentile(taken / times[:, against], (25, 50, 75))
    return row | {"against": cases[against][0], "ratio": float(middle), "spread": float((high - low) / middle)}
