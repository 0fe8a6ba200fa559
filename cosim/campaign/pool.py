"""Processes of one thread each, as a concurrent.futures.Executor, and calls that outlive the death of a worker."""

import concurrent.futures as cf
import contextlib
import itertools
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from actuators.kernels import cores
from cosim.errors import CampaignError

AHEAD = 4  # calls under way per worker: none waits for the parent, and little is lost with it
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # a worker is one core
START = {**dict.fromkeys(THREADS, "1"), "PYTHONSAFEPATH": "1"}  # a worker imports nothing from the current folder
Call = tuple[Any, Callable, tuple]  # key, function, arguments


def finished(
    calls: Iterable[Call], *, workers: int | None = None, executor: cf.Executor | None = None, ahead: int = AHEAD,
    died: Callable[[Call, Exception], None] | None = None,
) -> Iterator[tuple]:  # fmt: skip
    """Yield (key, function(*arguments)) of every call (key, function, arguments) as it finishes, in any order.

    `workers` processes, by default one per core, 0 works in this process; or any `executor`. `ahead` calls a worker are
    under way. `died` takes each call that was under way when a process died, and the error; without it that is a
    CampaignError. An error of a function is raised.
    """
    calls, count = iter(calls), cores() if workers is None else workers
    if executor is None and count == 0:
        yield from ((key, function(*arguments)) for key, function, arguments in calls)
        return
    left, window = True, ahead * (count if executor is None else workers or 16)
    while left:  # a pool in which a process died takes no more calls
        with contextlib.nullcontext(executor) if executor else pool(count) as here:
            left = yield from _sent(calls, here, window, died or _refuse)


def work(
    jobs: Sequence[tuple[Callable, dict]], *, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:  # fmt: skip
    """Return the value of every job (function, {argument: plain value}), in order; progress(done, total) counts them.
    The function stands at the top of a module and returns plain data. `workers` as in `finished`."""
    values: dict[int, Any] = {}
    for n, value in finished(((n, _called, job) for n, job in enumerate(jobs)), workers=workers):
        values[n] = value
        if progress:
            progress(len(values), len(jobs))
    return [values[n] for n in range(len(jobs))]


def _called(function, arguments):
    return function(**arguments)


def _sent(calls, executor, window, died):
    """Yield what an executor makes of the calls, `window` of them under way; return whether it broke before the end."""
    flying: dict[cf.Future, Call] = {}
    broken = False
    try:
        while True:
            for call in itertools.islice(calls, 0 if broken else window - len(flying)):
                try:
                    flying[executor.submit(call[1], *call[2])] = call
                except cf.BrokenExecutor as gone:
                    died(call, gone)
                    broken = True
            if not flying:
                return broken
            for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                call = flying.pop(future)
                if future.cancelled():
                    raise CampaignError("the workers went away", place="campaign", remedy="Continue with --resume")
                error = future.exception()
                broken = broken or isinstance(error, cf.BrokenExecutor)
                if isinstance(error, cf.BrokenExecutor) or type(error).__name__ == "KilledWorker":  # of Dask
                    died(call, error)
                else:
                    yield call[0], future.result()
    finally:
        for future in flying:
            future.cancel()


def _refuse(call, error):
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
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent():
    """End this process when the one that started it has ended, killed perhaps: nobody would ever send it work."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
