"""What a recorded flight costs: reading it into pandas, and running its detectors again."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from cosim.log import open_log
from cosim.replay import SPAN, replay
from cosim.replay.lanes import describe, fill, pieces, run

ROUNDS = 3  # the best counts
TOPIC = "/truth/aircraft"


def log_costs(path: str | Path) -> dict[str, Any]:
    """Return {minutes, values_mb, open_s, frames_s, topic_s, replay_s, replay_realtime, detectors_realtime,
    replay_us}.

    Reading: opening with all checksums, then every signal, or one topic, into pandas. `replay_realtime` is how many
    times faster than real time a whole replay is, with reading and comparing; `detectors_realtime` is that of the
    detectors' own steps, and `replay_us` {id: microseconds per step and lane}.
    """
    log = open_log(path)
    duration = log.n_ticks * log.dt_ns / 1e9
    size = sum(t.rows * len(t.fields) for t in log.topics.values()) * 8 / 1e6
    whole = _best(lambda: replay(path))
    steps = _steps(log)
    return {
        "minutes": duration / 60,
        "values_mb": size,
        "open_s": _best(lambda: open_log(path)),
        "frames_s": _best(log.frames),
        "topic_s": _best(lambda: log.frame(TOPIC)),
        "replay_s": whole,
        "replay_realtime": duration / whole,
        "detectors_realtime": log.dt_ns / 1e3 / sum(sum(costs) for costs in steps.values()),
        "replay_us": {name: float(np.mean(costs)) for name, costs in steps.items()},
    }


def _steps(log):
    """Return {id: [microseconds per tick of each lane]} on one span of the flight."""
    wired = describe(log)
    out: dict = {}
    for w, lane in zip(wired, fill(log, wired, 0, SPAN)):
        (piece,) = pieces(lane)
        cost = _best(lambda piece=piece: run(piece, log.dt_ns * 1e-9))
        out.setdefault(w.id, []).append(cost / len(lane.ticks) / w.every * 1e6)
    return out


def _best(call):
    seconds = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return min(seconds)
