"""Processes of one thread each, as a concurrent.futures.Executor, and calls that outlive the death of a worker."""

import concurrent.futures as cf
import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from cosim.errors import CampaignError

AHEAD = 4  # calls under way per worker: none waits for the parent, and little is lost with it
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # a worker is one core
START = {**dict.fromkeys(THREADS, "1"), "PYTHONSAFEPATH": "1"}  # a worker imports nothing from the current folder
Call = tuple[Any, Callable, tuple]  # key, function, arguments


def cores() -> int:
    """Return how many processes this process may keep busy."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def finished(
    calls: Iterable[Call], *, workers: int | None = None, executor: cf.Executor | None = None,
    died: Callable[[Call], None] | None = None,
) -> Iterator[tuple]:  # fmt: skip
    """Yield (key, function(*arguments)) of every call (key, function, arguments) as it finishes, in any order.

    `workers` processes, by default one per core, 0 works in this process; or any `executor`. `died` takes each call
    that was under way when a process died, without it that is a CampaignError; an error of a function is raised.
    """
    calls = iter(calls)
    count = cores() if workers is None else workers
    if executor is not None:
        yield from _sent(calls, executor, AHEAD * (workers or 16), died or _refuse)
    elif count == 0:
        yield from ((key, function(*arguments)) for key, function, arguments in calls)
    else:
        broken = True
        while broken:  # a pool in which a process died takes no more calls
            with pool(count) as here:
                broken = yield from _sent(calls, here, AHEAD * count, died or _refuse)


def alone(calls: Iterable[Call], executor: cf.Executor | None = None) -> Iterator[tuple]:
    """Yield (key, value) of calls, one after the other; the value of one whose process dies is the error."""
    todo = deque(calls)
    while todo:
        with contextlib.nullcontext(executor) if executor else pool(1) as here:
            while todo:
                key, function, arguments = todo.popleft()
                try:
                    value = here.submit(function, *arguments).result()
                except Exception as error:
                    if not _death(error):
                        raise
                    yield key, error
                    break
                yield key, value


def _sent(calls, executor, window, died):
    """Yield what an executor makes of the calls, `window` of them under way; return whether it is broken."""
    flying: dict[cf.Future, Call] = {}
    more, broken = True, False
    try:
        while flying or (more and not broken):
            while more and not broken and len(flying) < window:
                call = next(calls, None)
                if call is None:
                    more = False
                    break
                try:
                    flying[executor.submit(call[1], *call[2])] = call
                except cf.BrokenExecutor:
                    died(call)
                    broken = True
            for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                call = flying.pop(future)
                if future.cancelled():
                    raise CampaignError("the workers went away", place="campaign", remedy="Continue with --resume")
                if (error := future.exception()) is None:
                    yield call[0], future.result()
                elif _death(error):
                    died(call)
                    broken = broken or isinstance(error, cf.BrokenExecutor)
                else:
                    raise error
    finally:
        for future in flying:
            future.cancel()
    return broken


def _death(error):
    return isinstance(error, cf.BrokenExecutor) or type(error).__name__ == "KilledWorker"  # the latter is Dask's


def _refuse(call):
    raise CampaignError("a worker process died", place=str(call[0]), remedy="Was there enough memory?")


@contextlib.contextmanager
def pool(workers: int) -> Iterator[cf.Executor]:
    """Open a pool of `workers` fresh processes with one thread each; an error or Ctrl-C in this process ends them."""
    before = {name: os.environ.get(name) for name in START}
    os.environ.update(START)  # processes that are started inherit it
    made = cf.ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_start)
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
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


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
