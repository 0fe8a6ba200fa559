"""Do many small independent jobs in processes of their own; what is done is kept, so that a killed one goes on.

A job is (function, {argument: plain value}): the function stands at the top of a module and returns plain data.
"""

import contextlib
import hashlib
import inspect
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cosim.campaign.pool import finished
from cosim.campaign.store import fingerprint

Job = tuple[Callable, dict]


def work(
    jobs: Sequence[Job], *, folder: str | Path | None = None, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:  # fmt: skip
    """Return the value of every job, in order, from `folder` where it has been done (None: nothing is kept).

    A finished job is a line of results-<digest of the code>.jsonl. `workers` processes, by default one per core, 0
    works in this process; `progress(done, total)` counts. An error in a job ends the work.
    """
    keys = [json.dumps([f"{f.__module__}.{f.__name__}", arguments], sort_keys=True) for f, arguments in jobs]
    path = Path(folder) / f"results-{code_of(jobs)}.jsonl" if folder else Path(os.devnull)
    values = dict(_whole_lines(path))
    todo = {key: job for key, job in zip(keys, jobs) if key not in values}
    done, total = len(set(keys)) - len(todo), len(set(keys))
    path.parent.mkdir(parents=True, exist_ok=True)
    for key, value in finished(((key, _call, job) for key, job in todo.items()), workers=workers):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps([key, value]) + "\n")
        values[key], done = value, done + 1
        if progress:
            progress(done, total)
    return [values[key] for key in keys]


def code_of(jobs: Sequence[Job]) -> str:
    """Return the digest of all that decides about the values of `jobs`."""
    folders = {Path(inspect.getfile(function)).resolve().parent for function, _ in jobs}
    digest = hashlib.sha256(json.dumps(fingerprint()).encode())
    for path in sorted({p for folder in folders for p in (*folder.glob("*.py"), *folder.parent.glob("*.py"))}):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _whole_lines(path):
    """Yield (key, value) of the whole lines of a file of results; a kill may have cut the last one short."""
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        with contextlib.suppress(ValueError):
            yield json.loads(line)


def _call(function, arguments):
    return json.loads(json.dumps(function(**arguments)))  # as it comes out of the file
