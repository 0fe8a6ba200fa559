"""Send jobs to workers, take what comes back: a local pool that survives the death of a process, or any Executor."""

import concurrent.futures as cf
import contextlib
import multiprocessing
import os
import signal
from collections import deque
from concurrent.futures.process import BrokenProcessPool

from cosim.campaign.store import CampaignError
from cosim.campaign.worker import failed, fly

AHEAD = 4  # jobs in flight per worker: none waits for the parent, and little is lost with it
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # a worker is one core


def cores():
    """Return how many processes this process may keep busy."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def outcomes(jobs, *, workers=None, executor=None, achieved=True):
    """Yield (run, rows, timing) of every job (run, scenario) as it finishes, in any order.

    `executor`: any concurrent.futures.Executor (Dask: `client.get_executor()`); otherwise a pool of `workers`
    processes, by default one per core; 0 flies in this process. Raises CampaignError when the executor goes away.
    """
    if executor is not None:
        yield from _elsewhere(executor, jobs, AHEAD * (workers or 16), achieved)
    elif workers == 0:
        for run, scenario in jobs:
            yield run, *fly(run, scenario, achieved)
    else:
        yield from _local(deque(jobs), workers or cores(), achieved)


def _elsewhere(executor, jobs, window, achieved):
    todo = deque(jobs)
    flying: dict[cf.Future, str] = {}
    try:
        while todo or flying:
            while todo and len(flying) < window:
                run, scenario = todo.popleft()
                flying[executor.submit(fly, run, scenario, achieved)] = run
            for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                run = flying.pop(future)
                error = None if future.cancelled() else future.exception()
                if future.cancelled() or isinstance(error, cf.BrokenExecutor):
                    raise CampaignError("the workers went away", place="campaign", remedy="Continue with --resume")
                if error is not None:  # a worker that died under this run every time it was tried
                    yield run, [failed(run, "crashed", f"{type(error).__name__}: {error}")], []
                else:
                    yield run, *future.result()
    finally:
        for future in flying:
            future.cancel()


def _local(todo, workers, achieved):
    """Fly in processes; when one dies, all that was in flight is tried again, the second time each run alone."""
    hits: dict[str, int] = {}
    while todo:
        suspects = [job for job in todo if hits.get(job[0], 0) > 1]
        for job in suspects:
            todo.remove(job)
            yield from _alone(job, achieved)
        flying: dict[cf.Future, tuple] = {}
        with pool(workers) as here:
            try:
                while todo or flying:
                    while todo and len(flying) < AHEAD * workers:
                        job = todo.popleft()
                        flying[here.submit(fly, *job, achieved)] = job
                    for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                        result = future.result()
                        run, _ = flying.pop(future)
                        yield run, *result
            except BrokenProcessPool:
                for job in flying.values():
                    hits[job[0]] = hits.get(job[0], 0) + 1
                todo.extendleft(reversed(flying.values()))


def _alone(job, achieved):
    with pool(1) as here:
        try:
            yield job[0], *here.submit(fly, *job, achieved).result()
        except BrokenProcessPool as error:
            yield job[0], [failed(job[0], "crashed", f"its process died: {error}")], []


@contextlib.contextmanager
def pool(workers):
    """Open a pool of fresh processes with one thread each; an error or Ctrl-C in this process ends them."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    made = cf.ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_start)
    try:
        yield made
    except BaseException:
        processes = list((made._processes or {}).values())
        made.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        raise
    finally:
        made.shutdown(cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _start():
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
