"""Precompile the kernels of a run on all cores, each in a process of its own."""

import os
import subprocess
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from actuators import subprocess_env
from actuators.object_cache import Native

_WORK = """
import importlib, sys
module, _, path = sys.argv[1].partition(":")
found = importlib.import_module(module)
for name in path.split("."):
    found = getattr(found, name)
found.address
"""


def cores() -> int:
    """Return how many processes this process may keep busy."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compile_ahead(wanted: Iterable[Native], progress: Callable[[int, int], None] | None = None) -> int:
    """Compile those of `wanted` that are not stored yet, as many at a time as there are cores; return how many there
    were.

    `progress(done, total)` counts them. One alone, or all on a machine of one core, are left to their first use. What
    a process cannot compile is left too: the error then stands where it belongs.
    """
    missing = [native for native in dict.fromkeys(wanted) if not native.ready()]
    workers = min(cores(), len(missing))
    if workers < 2 or missing[0].file() is None:
        return 0
    tell = progress or (lambda done, total: None)
    missing.sort(key=lambda native: -native.source.stat().st_size)  # what takes longest first
    running: list[subprocess.Popen] = []
    tell(0, len(missing))
    with ThreadPoolExecutor(workers) as pool:
        try:
            for done, _ in enumerate(pool.map(lambda native: _compile(native.place, running), missing), 1):
                tell(done, len(missing))
        except BaseException:  # interrupted: nobody waits for the rest
            pool.shutdown(wait=False, cancel_futures=True)
            for process in running:
                process.kill()
            raise
    return len(missing)


def _compile(place, running):
    """Compile the function at `place`, in a process that is among `running` from then on."""
    command, env = [*subprocess_env.command(_WORK), place], subprocess_env.surroundings()
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with suppress(OSError):
        process = subprocess.Popen(command, env=env, **quiet)  # type: ignore[call-overload]
        running.append(process)
        process.wait()
