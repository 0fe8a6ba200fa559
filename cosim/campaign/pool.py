"""Send jobs to workers, take what comes back: a local pool that survives the death of a process, or any Executor."""

import concurrent.futures as cf
import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from cosim.campaign.worker import each, failed, fly
from cosim.errors import CampaignError

AHEAD = 4  # jobs in flight per worker: none waits for the parent, and little is lost with it
TOGETHER = 16  # runs with one seed that fly in one process: a campaign of a few seeds still keeps every core busy
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # a worker is one core
# what a worker starts with; it gets the path of this process, but would import from the current folder before that
START = {**dict.fromkeys(THREADS, "1"), "PYTHONSAFEPATH": "1"}


def cores() -> int:
    """Return how many processes this process may keep busy."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def outcomes(
    jobs: Any, *, workers: int | None = None, executor: Any = None, achieved: bool = True, together: int = TOGETHER
) -> Iterator[Any]:
    """Yield (run, rows, timing) of every job (run, scenario) as it finishes, in any order; see `finished`.

    Up to `together` runs with one seed fly one after the other in a process, so that those that differ in their fault
    share the flight without it and the design of the law. A run whose process dies under it every time it is tried is
    a row "crashed".
    """
    groups = _groups(jobs, together)
    again: list[tuple] = []

    def crashed(n, text):
        (run, _), *more = groups[n]
        again.extend(groups[n] if more else ())
        return [] if more else [(run, [failed(run, "crashed", text)], [])]

    calls = ((n, each, (fly, group, achieved)) for n, group in enumerate(groups))
    for _, found in finished(calls, workers=workers, executor=executor, crashed=crashed):
        yield from found
    if again:
        yield from outcomes(again, workers=workers, executor=executor, achieved=achieved, together=1)


def _groups(jobs, most):
    """Return lists of at most `most` jobs with one seed, in the order of their first."""
    found: dict[Any, list] = {}
    for n, job in enumerate(jobs):
        found.setdefault(getattr(job[1], "seed", (n,)), []).append(job)
    return [same[i : i + most] for same in found.values() for i in range(0, len(same), most)]


def finished(calls: Any, *, workers: int | None = None, executor: Any = None, crashed: Any = None) -> Iterator[Any]:
    """Yield (key, function(*arguments)) of every call (key, function, arguments) as it finishes, in any order.

    `executor`: any concurrent.futures.Executor (Dask: `client.get_executor()`); otherwise a pool of `workers`
    processes, by default one per core; 0 works in this process. `crashed(key, text)` is the value of a call that kills
    its process every time it is tried; without it the error is raised. Raises CampaignError when the executor goes.
    """
    if executor is not None:
        yield from _elsewhere(executor, calls, AHEAD * (workers or 16), crashed)
    elif workers == 0:
        for key, function, arguments in calls:
            yield key, function(*arguments)
    else:
        yield from _local(deque(calls), workers or cores(), crashed)


def _elsewhere(executor, calls, window, crashed):
    """Work on an executor. A call that it gives up because workers died under it may have had bad luck, as Dask blames
    every call that waited there: it is tried once more when nothing else is under way."""
    todo, tried = deque(calls), set()
    suspects: deque[tuple] = deque()
    flying: dict[cf.Future, tuple] = {}
    try:
        while todo or flying or suspects:
            if not todo and not flying:
                todo.append(suspects.popleft())
            while todo and len(flying) < window:
                call = todo.popleft()
                flying[executor.submit(call[1], *call[2])] = call
            for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                call = flying.pop(future)
                error = None if future.cancelled() else future.exception()
                if future.cancelled() or isinstance(error, cf.BrokenExecutor):
                    raise CampaignError("the workers went away", place="campaign", remedy="Continue with --resume")
                if error is None:
                    yield call[0], future.result()
                elif type(error).__name__ == "KilledWorker" and call[0] not in tried:
                    tried.add(call[0])
                    suspects.append(call)
                elif crashed is None:
                    raise error
                else:  # a worker that died under this call every time it was tried
                    yield call[0], crashed(call[0], f"{type(error).__name__}: {error}")
    finally:
        for future in flying:
            future.cancel()


def _local(todo, workers, crashed):
    """Work in processes; when one dies, all that was in flight is tried again, the second time each call alone."""
    hits: dict[object, int] = {}
    while todo:
        suspects = [call for call in todo if hits.get(call[0], 0) > 1]
        for call in suspects:
            todo.remove(call)
            yield _alone(call, crashed)
        flying: dict[cf.Future, tuple] = {}
        with pool(workers) as here:
            try:
                while todo or flying:
                    while todo and len(flying) < AHEAD * workers:
                        call = todo[0]  # stays there where the pool is found broken only now
                        flying[here.submit(call[1], *call[2])] = call
                        todo.popleft()
                    for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                        result = future.result()
                        yield flying.pop(future)[0], result
            except BrokenProcessPool:
                for call in flying.values():
                    hits[call[0]] = hits.get(call[0], 0) + 1
                todo.extendleft(reversed(flying.values()))


def _alone(call, crashed):
    key, function, arguments = call
    with pool(1) as here:
        try:
            return key, here.submit(function, *arguments).result()
        except BrokenProcessPool as error:
            if crashed is None:
                raise
            return key, crashed(key, f"its process died: {error}")


@contextlib.contextmanager
def pool(workers: int | None) -> Iterator[cf.Executor]:
    """Open a pool of `workers` fresh processes with one thread each, None for one per core, 0 for a thread of this
    process; an error or Ctrl-C in this process ends them."""
    if workers == 0:
        with cf.ThreadPoolExecutor(1) as thread:
            yield thread
        return
    with _surroundings():  # before the executor: its first lock starts a process, too
        yield from _processes(cores() if workers is None else workers)


@contextlib.contextmanager
def _surroundings():
    """Hold START in the environment, which processes that are started inherit."""
    before = {name: os.environ.get(name) for name in START}
    os.environ.update(START)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _processes(workers):
    try:
        made = cf.ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_start)
    except OSError as error:  # of a semaphore, which needs shared memory
        said = f"the system gives no locks between processes (in /dev/shm on Linux): {error.strerror}"
        remedy = "Mount /dev/shm, or fly in one process (workers=0)"
        raise CampaignError(said, place="campaign", remedy=remedy) from None
    try:
        yield made
    except BaseException:
        processes, manager = list((made._processes or {}).values()), getattr(made, "_executor_manager_thread", None)
        made.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        if manager:  # or it closes a pipe that the interpreter's end still writes to
            manager.join(10.0)
        raise
    finally:
        made.shutdown(cancel_futures=True)


def _start():
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    from cosim.flight.faults.fault_free_reference import WAITS_FOR_PARENT

    threading.Thread(target=_end_with_parent, name=WAITS_FOR_PARENT, daemon=True).start()


def _end_with_parent():
    """End this process when the one that started it has ended, killed perhaps: nobody would ever send it work."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
