"""How the cost of a flight grows with blocks, rate and length, a line each: `python tests/helpers/growth.py`."""

import time
from typing import Any

import numpy as np

from cosim.bench.ticks import ELEVEN, QUIET, flying, timed
from cosim.scenario import load_scenario

COUNTS = (0, 2, 4, 6, 8, 11)  # detectors
RATES = (50, 100, 200, 400, 800)  # [Hz]
LENGTHS = (10, 20, 40, 80)  # [s]
TICKS_S = 40.0  # of a flight whose ticks are timed


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


if __name__ == "__main__":
    for line in growth():
        points = ", ".join(f"{x:g}: {y:.3g}" for x, y in line["points"])
        what = f"{line['offset']:.3g} + {line['slope']:.4g} each {line['unit']}, off {100 * line['off']:.0f} %"
        print(f"{line['over']}: {what}; {points}")
