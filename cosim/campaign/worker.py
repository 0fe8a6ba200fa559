"""What a worker process does: fly scenarios one after the other; whatever goes wrong with one is a row."""

import concurrent.futures as cf
import functools
import hashlib
import os
import pickle
import queue
import threading
import zlib
from collections.abc import Iterator
from typing import Any, NamedTuple

from cosim.errors import TrimError
from cosim.judge.row import rows as judge_rows
from cosim.scenario import Scenario

FAILED = ("infeasible", "error", "crashed")  # statuses of a run without a flight
_timed = False  # whether this process has measured its detectors' cost per step


class Signals(NamedTuple):
    """Which signals of each flight are written, and at which rate [1/s]."""

    words: tuple[str, ...]
    rate_hz: float


class Flown(NamedTuple):
    """What came of a run: its rows (judge/row.py), timings, and the Parquet file of its signals, b"" without."""

    run: str
    rows: list[dict]
    timing: list[dict]
    signals: bytes = b""


class Packed:
    """Scenarios as compressed pickles, with their seeds: a hundred thousand fit into memory."""

    def __init__(self) -> None:
        self.seeds: list[int] = []
        self.packed: list[bytes] = []

    def append(self, scenario: Scenario) -> None:
        """Take one more."""
        self.seeds.append(scenario.seed)
        self.packed.append(zlib.compress(pickle.dumps(scenario), 1))

    def __len__(self) -> int:
        return len(self.packed)

    def __getitem__(self, i: int) -> Scenario:
        return pickle.loads(zlib.decompress(self.packed[i]))

    def __iter__(self) -> Iterator[Scenario]:
        return (self[i] for i in range(len(self)))


def run_id(scenario: Scenario) -> str:
    """Return the id of a run: 16 hex digits of the SHA-256 of its scenario, a user's parts by name and digest."""
    return hashlib.sha256(scenario.portable_toml().encode()).hexdigest()[:16]


def fly_packed(group: list[tuple[str, bytes]], signals: Signals | None) -> list[Flown]:
    """Return what came of each (run, packed scenario) of `group`."""
    return [fly(run, pickle.loads(zlib.decompress(data)), signals) for run, data in group]


def fly(run: str, scenario: Scenario, signals: Signals | None = None) -> Flown:
    """Fly `scenario` as run `run`.

    An error of the flight is one row without a detector: status "infeasible" for a point without a steady flight,
    "error" for anything else. A run whose fault acts on an elevator flies without it, too.
    """
    if threading.current_thread() is threading.main_thread():
        return _fly(run, scenario, signals)
    future: cf.Future = cf.Future()
    _flights().put((future, (run, scenario, signals)))
    return future.result()


def failed(run: str, status: str, error: str) -> dict:
    """Return the row of a run that has no result."""
    return {"run": run, "lane": 0, "status": status, "error": " ".join(error.split())}


def _fly(run, scenario, signals):
    global _timed
    begin = _core_s()
    try:
        from cosim.flight.simulate import simulate

        result = simulate(scenario, achieved=True, timed=not _timed)
        if result.status == "interrupted":
            raise KeyboardInterrupt
        written = _signals(scenario, signals) if signals else b""
    except TrimError as error:
        return Flown(run, [failed(run, "infeasible", str(error))], [])
    except Exception as error:  # a failed run is a row with its error, not the end of the campaign
        return Flown(run, [failed(run, "error", f"{type(error).__name__}: {error}")], [])
    timing: list[dict[str, Any]] = [
        {"run": run, "wall_time_s": result.wall_time_s, "startup_s": result.extra["startup_s"],
         "core_s": _core_s() - begin}
    ]  # fmt: skip
    if not _timed:
        steps = {d["id"]: d["step_us"] for d in result.detectors}
        timing += [{"run": run, "id": name, "step_us": us} for name, us in steps.items()]
    _timed = True
    return Flown(run, judge_rows(run, result.to_dict()), timing, written)


def _signals(scenario, signals):
    from cosim.campaign.signals import parquet

    return parquet(scenario, *signals)


def _core_s():
    """Return the processor time that this process, and those that it has started and seen end, took so far [s]."""
    return sum(os.times()[:4])


@functools.cache
def _flights():
    """Return the queue of a thread that flies and never ends: when a thread ends that has flown, JSBSim 1.3 frees its
    thread-local logger without the interpreter's lock and the process aborts; threads of a Dask worker come and go."""
    jobs: queue.SimpleQueue = queue.SimpleQueue()

    def work():
        while True:
            future, job = jobs.get()
            try:
                future.set_result(_fly(*job))
            except BaseException as error:
                future.set_exception(error)

    threading.Thread(target=work, name="flights", daemon=True).start()
    return jobs
