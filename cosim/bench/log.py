"""What a recorded flight costs: reading it into pandas, and running its detectors again."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cosim.judge.column_store import SPAN
from cosim.log import open_log
from cosim.replay import replay
from cosim.replay.detector_replay import describe, fill, pieces, replay_lane

ROUNDS = 3  # the best counts
TOPIC = "/truth/aircraft"


def log_costs(path: str | Path) -> dict[str, Any]:
    """Return {minutes, values_mb, open_s, frames_s, topic_s, parquet_s, replay_s, replay_cpu_s, replay_realtime,
    detectors_realtime, replay_us}.

    Reading: opening with all checksums, then every signal, or one topic, into pandas; `parquet_s` is what pyarrow takes
    for the same numbers from Parquet, a file per topic. Times of reading are the processor's, so that a busy machine
    blurs them less; `replay_s` is the clock's, with every core. `replay_realtime` is how many
    times faster than real time a whole replay is, with reading and comparing; `detectors_realtime` is that of the
    detectors' own steps, and `replay_us` {id: microseconds per step and lane}.
    """
    log = open_log(path)
    duration = log.n_ticks * log.dt_ns / 1e9
    size = sum(t.rows * len(t.fields) for t in log.topics.values()) * 8 / 1e6
    whole, on_all = min(taken(lambda: replay(path)) for _ in range(ROUNDS))
    steps = _steps(log)
    return {
        "minutes": duration / 60, "values_mb": size, "open_s": _best(lambda: open_log(path)),
        "frames_s": _best(lambda: [log.frame(name) for name in log.topics]),
        "topic_s": _best(lambda: log.frame(TOPIC)), "parquet_s": _parquet(log),
        "replay_s": whole, "replay_cpu_s": on_all, "replay_realtime": duration / whole,
        "detectors_realtime": log.dt_ns / 1e3 / sum(sum(costs) for costs in steps.values()),
        "replay_us": {name: float(np.mean(costs)) for name, costs in steps.items()},
    }  # fmt: skip


def _steps(log):
    """Return {id: [microseconds per tick of each lane]} on one span of the flight."""
    wired = describe(log)
    out: dict = {}
    for w, lane in zip(wired, fill(log, wired, 0, SPAN)):
        (piece,) = pieces(lane)
        cost = _best(lambda piece=piece: replay_lane(piece, log.dt_ns * 1e-9))
        out.setdefault(w.id, []).append(cost / len(lane.ticks) / w.every * 1e6)
    return out


def _parquet(log):
    """Return the seconds that pyarrow takes to read every topic from Parquet into pandas."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    taken = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for name in log.topics:
            file = Path(folder) / "topic.parquet"
            pq.write_table(pa.Table.from_pandas(log.frame(name)), file)
            taken += _best(lambda file=file: pq.read_table(file).to_pandas())
    return taken


def _best(call):
    """Return the least seconds of the processor that a call takes."""
    return min(taken(call)[1] for _ in range(ROUNDS))


def taken(call: Callable[[], Any]) -> tuple[float, float]:
    """Return (seconds of the clock, seconds of the processor in all threads)."""
    begin, busy = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - begin, time.process_time() - busy
