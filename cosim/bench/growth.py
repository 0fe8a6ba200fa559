"""How the cost of a flight grows with blocks, rate and length: points, and the straight line through them."""

import subprocess
import sys
import time
from typing import Any

import numpy as np

from actuators import subprocess_env
from cosim.bench.ticks import ELEVEN, QUIET, flying, timed
from cosim.scenario import load_scenario

COUNTS = (0, 2, 4, 6, 8, 11)  # detectors
RATES = (50, 100, 200, 400, 800)  # [Hz]
LENGTHS = (10, 20, 40, 80)  # [s]
TICKS_S = 40.0  # of a flight whose ticks are timed
_WORKER = """
import resource, sys
from cosim.campaign.worker import fly
from cosim.scenario import load_scenario
for seed in (1, 2):
    rows, _ = fly("bench", load_scenario("liquid-ofc", [f"seed={seed}"]), True)
    assert rows[0]["status"] == "completed"
print(max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))
"""
# the peak of a process that this one starts would be at least what this one holds: a small one starts it
_BETWEEN = "import subprocess, sys; subprocess.run([sys.executable, '-P', '-c', sys.argv[1]], check=True)"


def growth(turns: int = 5) -> list[dict[str, Any]]:
    """Return [{over, unit, points [(x, y)], slope, offset, off}] over blocks, rate and length; `turns` of each count.

    y = offset + slope x by least squares; `off` is the largest distance of a point from the line over the largest y.
    """
    return [
        _line("blocks of a tick", "µs per tick", [_blocks(count, turns) for count in COUNTS]),
        _line("rate, Hz", "ms per flown second", [(rate, _rate(rate, turns)) for rate in RATES]),
        _line("length, s", "s per flight, with its build", [(length, _length(length)) for length in LENGTHS]),
    ]


def _line(over, unit, points):
    x, y = np.array(points, float).T
    slope, offset = np.polyfit(x, y, 1)
    off = np.abs(offset + slope * x - y).max() / np.abs(y).max()
    return {"over": over, "unit": unit, "points": points, "slope": float(slope), "offset": float(offset),
            "off": float(off)}  # fmt: skip


def _blocks(count, turns):
    scenario = load_scenario(
        "liquid-ofc", [f"duration_s={TICKS_S}", f"detectors.enabled={list(ELEVEN[:count])}", QUIET[1]]
    )
    tick, loop = flying(scenario)
    stepped = 5 + len(loop.detectors) + len(loop.servos) + len(loop.actuators)
    return stepped, _microseconds(tick, turns)


def _rate(rate, turns):
    tick, _ = flying(load_scenario("liquid-ofc", [f"duration_s={TICKS_S}", f"rate_hz={rate}", *QUIET]))
    return _microseconds(tick, turns) * rate / 1e3


def _microseconds(tick, turns):
    timed(tick)
    return float(np.median([timed(tick) for _ in range(turns)]))


def _length(length):
    from cosim.flight.simulate import simulate

    scenario = load_scenario("cruise", [f"duration_s={length}", "detectors.enabled=[]"])
    begin = time.process_time()
    simulate(scenario, timed=False)
    return time.process_time() - begin


def worker_mb() -> float | None:
    """Return the peak resident memory [MB] of a campaign's worker after two flights, None where nobody tells."""
    if sys.platform == "win32":
        return None
    args, env = [*subprocess_env.command(_BETWEEN), _WORKER], subprocess_env.surroundings()
    told = subprocess.run(args, env=env, stdout=subprocess.PIPE, check=True, text=True).stdout
    return int(told) * (1 if sys.platform == "darwin" else 1024) / 1e6
