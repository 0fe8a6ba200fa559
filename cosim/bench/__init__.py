"""What a tick costs: bare aircraft, lockstep, detectors live and in batch, start-up, memory.

Machines and their other work differ, so a cost is given beside a ratio to something flown in the same process, in turn
with it (cosim/bench/ticks.py).
"""

import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from actuators import subprocess_env
from cosim.bench.log import log_costs, taken
from cosim.bench.ticks import measure
from cosim.flight.loop.compiling import prepare
from cosim.flight.plant.property_pointers import crossing
from cosim.replay.detector_replay import BLOCK_BYTES
from cosim.scenario import load_scenario

ROUNDS = 15
SAMPLE_TICKS = 2000  # of inputs recorded for the detectors
MEMORY_FLIGHT_S, SHORT_S = 600, 10
LONG = "long.mcap"  # the flight of that length


def bench(
    *, rounds: int = ROUNDS, memory: bool = True, progress: Callable[[int, int], None] | None = None
) -> dict[str, Any]:
    """Return {cases: [{name, us_per_tick, against, ratio, spread}], realtime_factor, detectors, startup_s, peak_mb}.

    `per_flown_second` {log_kb, memory_kb} are what a log and the memory of `run` grow by. `recorded` are the costs
    of the ten-minute log (cosim.bench.log), `worker_mb` the memory of a campaign's worker. `memory=False` leaves out
    that flight and the worker's (None). `progress(done, total)` is called between the parts.
    """
    done = progress or (lambda done, total: None)
    total = rounds + 4
    with tempfile.TemporaryDirectory() as folder:
        scenario = load_scenario("liquid-ofc")
        prepare(scenario)  # what is not compiled is not waited for everywhere: checksums would be zlib's
        cases, rate = measure(Path(folder), rounds, lambda k: done(k, total))
        costs = _detectors(scenario)
        done(rounds + 1, total)
        startup = _startup(folder)
        done(rounds + 2, total)
        log = Path(folder) / LONG
        peak = _flight_mb(log, MEMORY_FLIGHT_S) if memory else None
        short = _flight_mb(Path(folder) / "short.mcap", SHORT_S) if memory else None
        per_second = {
            "log_kb": log.stat().st_size / 1e3 / MEMORY_FLIGHT_S if log.exists() else None,
            "memory_kb": (peak - short) * 1e3 / (MEMORY_FLIGHT_S - SHORT_S) if peak and short else None,
        }
        recorded = log_costs(log) if memory else None
        done(rounds + 3, total)
        worker = worker_mb() if memory else None
        done(total, total)
    return {
        "cases": cases, "realtime_factor": rate, "border": "by address" if crossing() else "by Python's calls",
        "detectors": costs, "startup_s": startup["run_s"], "startup": startup, "peak_mb": peak,
        "per_flown_second": per_second, "worker_mb": worker, "recorded": recorded, "memory_flight_s": MEMORY_FLIGHT_S,
        "cores": os.cpu_count(),
    }  # fmt: skip


def _detectors(scenario):
    """Return [{id, level, lanes, live_us, batch_us}]: cost per step and lane on inputs recorded in flight."""
    from cosim.flight.build import build
    from cosim.flight.tick import tick
    from fdi import registry

    length = f"duration_s={SAMPLE_TICKS / scenario.rate_hz:g}"
    setup = build(load_scenario("liquid-ofc", ["faults.0.start_s=2", length]))
    found = setup.loop.detectors
    starts = [d.x.copy() for d in found]
    inputs = [np.zeros((len(d.x), SAMPLE_TICKS), d.module.INPUTS) for d in found]
    for k in range(SAMPLE_TICKS):
        tick(setup.loop, k)
        for d, u in zip(found, inputs):
            u[:, k] = d.u[:, 0]
    return [
        {"id": d.name, "level": registry.record(d.name).level, "lanes": len(x), **_step_cost(d, x, u, setup.loop.dt)}
        for d, x, u in zip(found, starts, inputs)
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

    return {f"{call.__name__}_us": min(taken(call)[0] for _ in range(3)) / u.size * 1e6 for call in (live, batch)}


def _command(*args):
    return [sys.executable, "-P", "-m", "cosim.cli", *args]


# `cosim run`, ended when its first tick is done
_FIRST = """
import os, sys
from cosim.flight.loop.schedule import Tape
run = Tape.run
def first(tape, k):
    run(tape, k)
    os._exit(0)
Tape.run = first
sys.argv = ["cosim", "run", *sys.argv[1:]]
from cosim.cli import main
main()
"""


def _startup(folder):
    """Return seconds of whole processes, least of three: interpreter, import, help, the default flight until its first
    tick is flown, a `run` of one second, and the default flight of 30 s from start to report; of the clock and, as
    `*_cpu_s`, of the processor.

    The bytecode of every module is there, as it is where a package is installed, even where the environment has none
    written (PYTHONDONTWRITEBYTECODE).
    """
    log = str(Path(folder) / "start.mcap")
    cases = {
        "python": subprocess_env.command("pass"), "import": subprocess_env.command("import cosim"),
        "help": _command("--help"), "first_tick": [*subprocess_env.command(_FIRST), "-o", log],
        "run": _command("run", "cruise", "--json", "--set", "duration_s=1", "-o", log),
        "flight": _command("run", "-o", log),
    }  # fmt: skip
    env = {name: value for name, value in subprocess_env.surroundings().items() if name != "PYTHONDONTWRITEBYTECODE"}
    env["PYTHONPYCACHEPREFIX"] = str(Path(folder) / "bytecode")
    told: dict[str, Any] = {}
    for name, args in cases.items():
        _seconds(args, env)  # writes the bytecode
        told[name] = np.min([_seconds(args, env) for _ in range(3)], axis=0).tolist()
    return {f"{name}_s": wall for name, (wall, _) in told.items()} | {
        f"{name}_cpu_s": busy for name, (_, busy) in told.items()
    }


def _seconds(args, env):
    """Return (seconds of the clock, of the processor) of a process."""
    begin, before = time.perf_counter(), os.times()
    subprocess.run(args, check=True, capture_output=True, env=env)
    after = os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - begin, busy


# of a process that this one starts the peak would be at least what this one holds: a small one starts it
_PEAK = """
import resource, subprocess, sys
outcome = subprocess.run(sys.argv[1:], stdout=subprocess.PIPE, check=True).stdout
sys.stdout.buffer.write(outcome)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
_WORKER = """
from cosim.campaign.worker import fly
from cosim.scenario import load_scenario
for seed in (1, 2):
    rows = fly("bench", load_scenario("liquid-ofc", [f"seed={seed}"]), True).rows
    assert rows[0]["status"] == "completed"
print()
"""


def _peak_mb(args):
    """Return (what a process says, the peak resident memory [MB] of it and of those that it starts)."""
    call, env = [*subprocess_env.command(_PEAK), *args], subprocess_env.surroundings()
    told = subprocess.run(call, env=env, stdout=subprocess.PIPE, check=True, text=True).stdout
    outcome, peak = told.splitlines()
    return outcome, int(peak) * (1 if sys.platform == "darwin" else 1024) / 1e6


def _flight_mb(log, duration_s):
    """Return the peak resident memory [MB] of a process that flies and logs so long with every detector."""
    if sys.platform == "win32":
        return None
    outcome, peak = _peak_mb(_command("run", "cruise", "--json", "--set", f"duration_s={duration_s}", "-o", str(log)))
    if json.loads(outcome)["status"] != "completed":
        raise RuntimeError(f"the flight of {duration_s} s did not complete")
    return peak


def worker_mb() -> float | None:
    """Return the peak resident memory [MB] of a campaign's worker after two flights, None where nobody tells."""
    return None if sys.platform == "win32" else _peak_mb(subprocess_env.command(_WORKER))[1]
