"""Do many small independent jobs in processes of their own; what is done is kept, so that a killed one goes on.

A job is (function, {argument: plain value}): the function stands at the top of a module and returns plain data. Each
finished job is one line of `results.jsonl` with a digest of its own, below a first line with one of the code that
decides about the values: results of two versions never mix, and what is damaged is done again.
"""

import contextlib
import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from actuators.source_hash import closure
from cosim.campaign.pool import finished
from cosim.campaign.store import fingerprint
from cosim.errors import OutputError
from cosim.files import FULL, SPACE, regular, replace_text

FILE = "results.jsonl"
Job = tuple[Callable, dict]


def work(
    jobs: Sequence[Job], *, folder: str | Path | None = None, code: str | None = None, workers: int | None = None,
    progress: Callable[[int, int], None] | None = None, read: Callable[[Any], Any] = lambda value: value,
) -> list[Any]:  # fmt: skip
    """Return the value of every job, in order, from `folder` where it has been done (None: nothing is kept).

    `read` makes of a value what is returned; what it refuses of the folder (ValueError) is done again. `code` is the
    digest that the folder is for, by default that of these jobs; `workers` processes, by default one per core, 0 works
    in this process; `progress(done, total)` counts. An error in a job ends the work.
    """
    jobs = [(function, json.loads(json.dumps(arguments))) for function, arguments in jobs]
    path = Path(folder) / FILE if folder else None
    values = _held(path, code or code_of(jobs), read) if path else {}
    keys = [_key(job) for job in jobs]
    todo = {key: job for key, job in zip(keys, jobs) if key not in values}
    total = len(set(keys))
    tell = progress or (lambda done, total: None)
    tell(total - len(todo), total)
    calls = ((key, functools.partial(_call, *job), ()) for key, job in todo.items())
    for done, (key, value) in enumerate(finished(calls, workers=workers), start=total - len(todo) + 1):
        values[key] = json.loads(value)
        if path:
            _append(path, _line(key, values[key]))
        tell(done, total)
    return [read(values[key]) for key in keys]


def code_of(jobs: Sequence[Job]) -> str:
    """Return the digest of all that decides about the values of `jobs`."""
    files = {Path(inspect.getfile(function)).resolve() for function, _ in jobs}
    found = hashlib.sha256(json.dumps(fingerprint()).encode())
    for path in sorted({p for file in files for p in closure(file)}):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def stored(folder: str | Path) -> tuple[str, dict[str, Any]]:
    """Return (digest of the code, {key: value}) of what `folder` holds, without what is damaged; ("", {}) of nothing.
    Raises OutputError for a file of results that cannot be read."""
    code, found = "", {}
    for told in _lines(Path(folder) / FILE):
        if isinstance(told, dict):
            code = told["code"]
        elif told is not None and isinstance(told[0], str):
            found[told[0]] = told[1]
    return (code, found) if isinstance(code, str) and code else ("", {})


def own(path: Path) -> None:
    """Raise OutputError where a file of results at `path` holds something, and not one line of it is of jobs."""
    lines = list(_lines(path))
    if lines and not any(lines):
        raise OutputError("holds something else", place=str(path), remedy="Choose another folder")


def _lines(path):
    """Yield each line of a file of results as {"code": digest} or [key, value, digest], None for one that is neither:
    one that a kill cut short, or damage."""
    regular(path, OutputError)
    text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
    for line in filter(None, text.splitlines()):
        ours = None
        with contextlib.suppress(ValueError, TypeError, RecursionError):
            told = json.loads(line)
            if set(told) == {"code"} if isinstance(told, dict) else told[2:] == [_digest(*told[:2])]:
                ours = told
        yield ours


def keep(folder: str | Path, digest: str, values: Mapping[str, Any]) -> None:
    """Write {key: value} as the results of the code with `digest`; see `stored`."""
    lines = [json.dumps({"code": digest}), *(_line(key, value) for key, value in values.items())]
    replace_text(Path(folder) / FILE, "".join(f"{line}\n" for line in lines))


def _line(key, value):
    return json.dumps([key, value, _digest(key, value)])


def _digest(key, value):
    return hashlib.sha256(json.dumps([key, value]).encode()).hexdigest()[:12]


def _held(path, digest, read):
    """Return {key: value} of what is done by the code with `digest`, which alone stays in the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    own(path)
    code, found = stored(path.parent)
    values = {}
    for key, value in found.items() if code == digest else ():
        with contextlib.suppress(ValueError):
            read(value)
            values[key] = value
    keep(path.parent, digest, values)
    return values


def _append(path, line):
    try:
        with open(path, "a", encoding="utf-8") as file:
            file.write(line + "\n")
    except OSError as error:
        remedy = SPACE if error.errno in FULL else "What is done is kept: start again"
        raise OutputError(f"cannot be written: {error.strerror}", place=str(path), remedy=remedy) from None


def _key(job):
    """Return the text that tells a job from every other; paths of a user's `files` are not in it, their digest is."""
    function, arguments = job
    arguments = {k: v for k, v in arguments.items() if k != "files"}
    return json.dumps([f"{function.__module__}.{function.__name__}", arguments], sort_keys=True)


def _call(function, arguments):
    return json.dumps(function(**arguments))
