"""Precompile the kernels of a run on all cores, in processes that compile one function after the other."""

import os
import queue
import subprocess
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress

from actuators import subprocess_env
from actuators.object_cache import PLAIN, Native

_WORK = """
import importlib, sys
for line in sys.stdin:
    module, _, path = line.strip().partition(":")
    found = importlib.import_module(module)
    for name in path.split("."):
        found = getattr(found, name)
    found.address
    print(flush=True)
"""


def cores() -> int:
    """Return how many processes this process may keep busy."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compile_ahead(wanted: Iterable[Native], progress: Callable[[int, int], None] | None = None) -> int:
    """Compile those of `wanted` that are not stored yet, in one process per core; return how many there were.

    `progress(done, total)` counts them. One alone, or all on a machine of one core, are left to their first use. What
    a process cannot compile is left too: the error then stands where it belongs.
    """
    missing = [] if PLAIN else [native for native in dict.fromkeys(wanted) if not native.ready()]
    workers = min(cores(), len(missing))
    if workers < 2 or missing[0].file() is None:
        return 0
    tell = progress or (lambda done, total: None)
    jobs: queue.SimpleQueue = queue.SimpleQueue()
    for native in sorted(missing, key=lambda native: -native.source.stat().st_size):  # what takes longest first
        jobs.put(native.place)
    done = [0]
    running: list[subprocess.Popen] = []
    threads = [threading.Thread(target=_feed, args=(jobs, running, done, tell, len(missing))) for _ in range(workers)]
    tell(0, len(missing))
    try:
        with suppress(RuntimeError):  # no further thread is to be had
            for thread in threads:
                thread.start()
        for thread in threads:
            while thread.is_alive():
                thread.join(0.1)  # without an end, a signal just before the wait would be heard after it
    except BaseException:  # interrupted: nobody waits for the rest
        with suppress(queue.Empty):
            while True:
                jobs.get_nowait()
        for worker in list(running):
            worker.kill()
        raise
    return len(missing)


def _feed(jobs, running, done, tell, total):
    """Give one process after the other job until none is left, or until no process is to be had."""
    command, env = subprocess_env.command(_WORK), subprocess_env.surroundings()
    with suppress(queue.Empty, OSError), subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=env, text=True
    ) as worker:
        running.append(worker)
        assert worker.stdin and worker.stdout
        while True:
            print(jobs.get_nowait(), file=worker.stdin, flush=True)
            if not worker.stdout.readline():
                return
            done[0] += 1
            tell(done[0], total)
