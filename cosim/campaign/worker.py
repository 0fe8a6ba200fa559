"""One run of a campaign, in a worker process: a scenario in, rows out; whatever goes wrong is a row too."""

import concurrent.futures as cf
import functools
import hashlib
import os
import pickle
import queue
import threading
import zlib
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, overload

from cosim.errors import TrimError
from cosim.judge.row import rows as judge_rows
from cosim.scenario import Scenario

FAILED = ("infeasible", "error", "crashed")  # statuses of a run without a flight
_lock = threading.Lock()
_timed = False  # whether this process has measured its detectors' cost per step


def run_id(scenario: Scenario) -> str:
    """Return the id of a run: 16 hex digits of the SHA-256 of its scenario, a user's files by name and digest."""
    return hashlib.sha256(scenario.portable_toml().encode()).hexdigest()[:16]


def fly(run: str, scenario: Scenario, achieved: bool) -> tuple[list[dict], list[dict]]:
    """Fly `scenario` as run `run`; return (rows, timing), of `FIELDS` (judge/row.py) and `TIMING`.

    An error of the flight is one row without a detector: status "infeasible" for a point without a steady flight,
    "error" for anything else. With `achieved` the twin flight is flown where a fault acts on an elevator.
    """
    if threading.current_thread() is threading.main_thread():
        return _fly(run, scenario, achieved)
    with _lock:  # two threads would otherwise each make one
        thread = _thread()
    return thread.submit(run, scenario, achieved).result()


def each(fly: Callable, jobs: list, achieved: bool) -> list[tuple[str, list[dict], list[dict]]]:
    """Return [(run, rows, timing)] of `jobs`, (run, Scenario or Pickled), each by `fly`."""
    return [(run, *fly(run, s.scenario() if isinstance(s, Pickled) else s, achieved)) for run, s in jobs]


def _fly(run, scenario, achieved):
    global _timed
    begin = core_s()
    try:
        from cosim.flight.simulate import simulate

        result = simulate(scenario, achieved=achieved, timed=not _timed)
    except TrimError as error:
        return [failed(run, "infeasible", str(error))], []
    except Exception as error:  # a crashed run is a row with its error, not the end of the campaign
        return [failed(run, "error", f"{type(error).__name__}: {error}")], []
    if result.status == "interrupted":
        raise KeyboardInterrupt
    rows, timing = judge_rows(run, result.to_dict()), _timing(run, result, _timed)
    timing[0]["core_s"] = core_s() - begin
    _timed = True
    return rows, timing


class _Thread:
    """Fly in one thread that never ends, one run after the other.

    When a thread ends that has flown, JSBSim 1.3 frees its thread-local logger without holding the interpreter's lock
    and the process aborts: a Dask worker's threads come and go.
    """

    def __init__(self):
        self._jobs: queue.SimpleQueue = queue.SimpleQueue()
        threading.Thread(target=self._work, name="flights", daemon=True).start()

    def submit(self, *job) -> cf.Future:
        """Return the Future of a run."""
        future: cf.Future = cf.Future()
        self._jobs.put((future, job))
        return future

    def _work(self):
        while True:
            future, job = self._jobs.get()
            try:
                future.set_result(_fly(*job))
            except BaseException as error:
                future.set_exception(error)


@functools.cache
def _thread():
    return _Thread()


def core_s() -> float:
    """Return the processor time that this process, and those that it has started and seen end, took so far [s]."""
    told = os.times()
    return told.user + told.system + told.children_user + told.children_system


def failed(run: str, status: str, error: str) -> dict:
    """Return the row of a run that has no result."""
    return {"run": run, "lane": 0, "status": status, "error": " ".join(error.split())}


def _timing(run, result, timed):
    whole = {"run": run, "wall_time_s": result.wall_time_s, "startup_s": result.extra["startup_s"]}
    if timed:
        return [whole]
    steps = {d["id"]: d["step_us"] for d in result.detectors}
    return [whole, *({"run": run, "id": name, "step_us": us} for name, us in steps.items())]


class Pickled(NamedTuple):
    """A scenario: its seed, by which runs are grouped, and the whole as a compressed pickle."""

    seed: int
    data: bytes

    def scenario(self) -> Scenario:
        """Return the Scenario."""
        return pickle.loads(zlib.decompress(self.data))


class Packed(Sequence[Scenario]):
    """A sequence of scenarios, each made anew when it is asked for; `held` are their Pickled."""

    def __init__(self, scenarios: Iterable[Scenario] = ()):
        self.held: list[Pickled] = []
        for scenario in scenarios:
            self.append(scenario)

    def append(self, scenario: Scenario) -> None:
        """Take one more."""
        self.held.append(Pickled(scenario.seed, zlib.compress(pickle.dumps(scenario), 1)))

    def __len__(self) -> int:
        return len(self.held)

    @overload
    def __getitem__(self, i: int) -> Scenario: ...
    @overload
    def __getitem__(self, i: slice) -> list[Scenario]: ...
    def __getitem__(self, i):
        return [p.scenario() for p in self.held[i]] if isinstance(i, slice) else self.held[i].scenario()
