"""Do many small independent jobs in processes of their own; what is done is kept, so that a killed study goes on.

A job is (function, {argument: plain value}): the function stands at the top of a module and returns plain data. Each
finished job is one line of `results.jsonl`, below a first line with a digest of the code that decides about the values:
results of two versions never mix.
"""

import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from actuators.sources import closure
from cosim.campaign.pool import finished
from cosim.campaign.store import fingerprint
from cosim.errors import OutputError
from cosim.files import regular, replace_text

FILE = "results.jsonl"
Job = tuple[Callable, dict]


def work(
    jobs: Sequence[Job],
    *,
    folder: str | Path | None = None,
    code: str | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """Return the value of every job, in order, from `folder` where it has been done (None: nothing is kept).

    `code` is the digest that the folder is for, by default that of these jobs; `workers` processes, by default one per
    core, 0 works in this process; `progress(done, total)` counts. An error in a job ends the work.
    """
    jobs = [(function, json.loads(json.dumps(arguments))) for function, arguments in jobs]
    results = _Results(folder, (code or code_of(jobs)) if folder else "")
    keys = [_key(job) for job in jobs]
    todo = {key: job for key, job in zip(keys, jobs) if key not in results.values}
    total = len(set(keys))
    tell = progress or (lambda done, total: None)
    tell(total - len(todo), total)
    calls = ((key, functools.partial(_call, *job), ()) for key, job in todo.items())
    for done, (key, value) in enumerate(finished(calls, workers=workers), start=total - len(todo) + 1):
        results.add(key, json.loads(value))
        tell(done, total)
    return [results.values[key] for key in keys]


def code_of(jobs: Sequence[Job]) -> str:
    """Return the digest of all that decides about the values of `jobs`."""
    files = {Path(inspect.getfile(function)).resolve() for function, _ in jobs}
    found = hashlib.sha256(json.dumps(fingerprint()).encode())
    for path in sorted({p for file in files for p in closure(file)}):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


class _Results:
    """Values of finished jobs, in memory and in a folder (None: in memory only)."""

    def __init__(self, folder, digest):
        self.values: dict[str, object] = {}
        self.path = Path(folder) / FILE if folder else None
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        regular(self.path, OutputError)
        lines = self.path.read_text(encoding="utf-8", errors="replace").splitlines() if self.path.exists() else []
        if lines and lines[0] == json.dumps({"code": digest}):
            for line in lines[1:]:
                try:
                    key, value = json.loads(line)
                    self.values[str(key)] = value
                except (ValueError, TypeError, RecursionError):  # the line that a kill cut short, or damage
                    continue
        kept = [json.dumps({"code": digest}), *(json.dumps([k, v]) for k, v in self.values.items())]
        replace_text(self.path, "".join(f"{line}\n" for line in kept))

    def add(self, key, value):
        """Keep the value of a job."""
        self.values[key] = value
        if self.path:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(json.dumps([key, value]) + "\n")


def _key(job):
    """Return the text that tells a job from every other."""
    function, arguments = job
    return json.dumps([f"{function.__module__}.{function.__name__}", arguments], sort_keys=True)


def _call(function, arguments):
    return json.dumps(function(**arguments))
