"""What a tick costs: bare aircraft, lockstep, detectors live and in batch, start-up, memory.

Machines and their other work differ, so a cost is given beside a ratio to something flown in the same process,
interleaved: the ratio of a case is the median over the rounds of its time to that of its yardstick, the spread is the
interquartile range over the median.
"""

import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from cosim.bench.log import log_costs
from cosim.replay.lanes import BLOCK_BYTES
from cosim.scenario import load_scenario

ROUNDS = 15
TICKS = 1000  # of a round: 5 s of flight
SAMPLE_TICKS = 2000  # of inputs recorded for the detectors
MEMORY_FLIGHT_S = 600
LONG = "long.mcap"  # the flight of that length


def bench(*, rounds=ROUNDS, memory=True, progress=None):
    """Return {cases: [{name, us_per_tick, against, ratio, spread}], realtime_factor, detectors, startup_s, peak_mb}.

    `recorded` are the costs of the ten-minute log (cosim.bench.log). `memory=False` leaves that flight out (both
    None). `progress(done, total)` is called between the parts.
    """
    done = progress or (lambda done, total: None)
    total = rounds + 3
    with tempfile.TemporaryDirectory() as folder:
        scenario = load_scenario("liquid-ofc", [f"duration_s={(rounds + 2) * TICKS / 200:g}"])
        cases, rate = _cases(scenario, Path(folder), rounds, lambda k: done(k, total))
        costs = _detectors(scenario)
        done(rounds + 1, total)
        startup = _startup(folder)
        done(rounds + 2, total)
        peak = _peak_mb(folder) if memory else None
        recorded = log_costs(Path(folder) / LONG) if memory else None
        done(total, total)
    return {
        "cases": cases,
        "realtime_factor": rate,
        "detectors": costs,
        "startup_s": startup["run_s"],
        "startup": startup,
        "peak_mb": peak,
        "recorded": recorded,
        "memory_flight_s": MEMORY_FLIGHT_S,
        "cores": os.cpu_count(),
    }


def _cases(scenario, folder, rounds, progress):
    """Time every case in turn, round after round; return their rows and the factors over real time."""
    from cosim.flight.plant.plant import Plant, reference_run
    from cosim.flight.plant.point import FlightPoint

    flown = Plant(FlightPoint.of(scenario), scenario.dt)
    flown.trim()
    none = load_scenario(
        "liquid-ofc", ["detectors.enabled=[]", "elevator.feedback=measured", f"duration_s={scenario.duration_s}"]
    )
    yard, bare = reference_run(scenario.dt), flown.run
    step, close = _lockstep(none, folder / "none.mcap")
    step_all, close_all = _lockstep(scenario, folder / "all.mcap")
    cases = [
        ("B747", yard, None),  # the one that the jsbsim wheel ships, run() only
        ("bare", bare, 0),  # our aircraft, run() only
        ("lockstep", step, 1),  # four actuators, sensors, law, log
        ("detectors", step_all, 1),  # the same with every detector
    ]
    for _, call, _ in cases:  # caches warm, kernels loaded
        _time(call, TICKS)
    times = np.empty((rounds, len(cases)))
    for k in range(rounds):
        for i, (_, call, _) in enumerate(cases):
            times[k, i] = _time(call, TICKS)
        progress(k + 1)
    close(), close_all()
    rows = []
    for i, (name, _, against) in enumerate(cases):
        row = {
            "name": name,
            "us_per_tick": float(np.median(times[:, i])),
            "against": None,
            "ratio": None,
            "spread": None,
        }
        if against is not None:
            ratio = times[:, i] / times[:, against]
            low, middle, high = np.percentile(ratio, (25, 50, 75))
            row |= {"against": cases[against][0], "ratio": float(middle), "spread": float((high - low) / middle)}
        rows.append(row)
    factors = {name: scenario.dt * 1e6 / rows[i]["us_per_tick"] for name, i in (("lockstep", 2), ("with_detectors", 3))}
    return rows, factors


def _time(call, n):
    """Return microseconds per call of n calls."""
    begin = time.perf_counter()
    for _ in range(n):
        call()
    return (time.perf_counter() - begin) / n * 1e6


def _lockstep(scenario, path):
    """Return (a function that flies one logged tick, a function that ends the log)."""
    from cosim.flight.build import build
    from cosim.flight.recorder import open_writer
    from cosim.flight.tick import tick

    setup = build(scenario)
    writer = open_writer(setup, path)
    writer.__enter__()
    count = iter(range(10**9))
    return lambda: tick(setup.loop, next(count), writer.append), lambda: writer.__exit__(None, None, None)


def _detectors(scenario):
    """Return [{id, level, lanes, live_us, batch_us}]: cost per step and lane on inputs recorded in flight."""
    from cosim.flight.build import build
    from cosim.flight.tick import tick
    from fdi import registry

    setup = build(
        load_scenario("liquid-ofc", ["faults.0.start_s=2", f"duration_s={SAMPLE_TICKS / scenario.rate_hz:g}"])
    )
    found = setup.loop.detectors
    starts = [d.x.copy() for d in found]
    inputs = [np.zeros((len(d.x), SAMPLE_TICKS), d.module.INPUTS) for d in found]
    for k in range(SAMPLE_TICKS):
        tick(setup.loop, k, _nothing)
        for d, u in zip(found, inputs):
            u[:, k] = d.u[:, 0]
    return [
        {
            "id": d.name,
            "level": registry.record(d.name).level,
            "lanes": len(start),
            **_step_cost(d, start, u, setup.loop.dt),
        }
        for d, start, u in zip(found, starts, inputs)
    ]


def _step_cost(d, start, u, tick):
    """Return {live_us, batch_us} per step and lane of detector block `d` on inputs u (lane, tick).

    The batch goes lane by lane in blocks that stay in the processor's cache, as a replay does: a log of whole states
    of all lanes at once would time the memory.
    """
    block = max(1, BLOCK_BYTES // d.module.STATE.itemsize)
    log, one = np.zeros((1, block), d.module.STATE), np.zeros((len(start), 1), d.module.STATE)
    columns = list(np.ascontiguousarray(u.T).view(float).reshape(u.shape[1], len(start), -1))  # all lanes, tick by tick
    blocks = [(i, np.ascontiguousarray(u[i : i + 1, k : k + block])) for i in range(len(u)) for k in
              range(0, u.shape[1], block)]
    dt, rollout, x = tick * d.every, d.module.rollout, start.copy()
    given = np.zeros((len(start), 1), d.module.INPUTS)
    now, step = given.view(float).reshape(len(start), -1), functools.partial(rollout, x, given, d.p, dt, one)

    def batch():
        state = start.copy()
        for i, part in blocks:
            rollout(state[i : i + 1], part, d.p[i : i + 1], dt, log[:, : part.shape[1]])

    def live():
        for column in columns:
            now[:] = column
            step()

    return {f"{name}_us": min(_once(call) for _ in range(3)) / u.size * 1e6 for name, call in
            (("live", live), ("batch", batch))}


def _nothing(v):
    pass


def _once(call):
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def _command(*args):
    return [sys.executable, "-m", "cosim.cli", *args]


def _startup(folder):
    """Return wall seconds of whole processes, best of three: interpreter, import, help, a `run` of one second."""
    cases = {
        "python_s": [sys.executable, "-c", "pass"],
        "import_s": [sys.executable, "-c", "import cosim"],
        "help_s": _command("--help"),
        "run_s": _command("run", "cruise", "--json", "--set", "duration_s=1", "-o", str(Path(folder) / "start.mcap")),
    }
    return {name: min(_seconds(args) for _ in range(3)) for name, args in cases.items()}


def _seconds(args):
    return _once(lambda: subprocess.run(args, check=True, capture_output=True))


# of a process that this one starts, its peak would be at least what this one holds when it forks
_PEAK = """
import resource, subprocess, sys
outcome = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, check=True).stdout
sys.stdout.buffer.write(outcome)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def _peak_mb(folder):
    """Return the peak resident memory [MB] of a process that flies and logs ten minutes with every detector."""
    if sys.platform == "win32":
        return None
    log = str(Path(folder) / LONG)
    args = _command("run", "cruise", "--json", "--set", f"duration_s={MEMORY_FLIGHT_S}", "-o", log)
    told = subprocess.run([sys.executable, "-c", _PEAK, *args], stdout=subprocess.PIPE, check=True, text=True).stdout
    outcome, peak = told.splitlines()
    if json.loads(outcome)["status"] != "completed":
        raise RuntimeError("the ten-minute flight did not complete")
    return int(peak) * (1 if sys.platform == "darwin" else 1024) / 1e6
