"""Fly many small jobs in processes of their own; what is done is kept in a file, so that a killed study goes on.

A job is a tuple of words and numbers, its result what JSON can hold. The file holds one line per job below a first line
with the digest of everything that flies: results of two versions of the code never mix.
"""

import concurrent.futures as cf
import json
from pathlib import Path

from cosim.campaign.pool import pool
from cosim.campaign.store import fingerprint

AHEAD = 4  # jobs per worker that wait


def many(function, jobs, *, out=None, workers=2, progress=None):
    """Return {job: function(*job)} of all `jobs`; `function` is importable, `workers` 0 flies in this process.

    `out` is the file of results (None: they are kept nowhere); `progress(done, total)` counts.
    """
    jobs, done = list(dict.fromkeys(jobs)), {}
    path = None if out is None else Path(out)
    if path is not None:
        done = _read(path, jobs)
    todo = [job for job in jobs if job not in done]
    results = _flown(function, todo, workers)
    for job, result in results:
        done[job] = result
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps([job, result]) + "\n")
        if progress:
            progress(len(done), len(jobs))
    return {job: done[job] for job in jobs}


def _flown(function, todo, workers):
    if workers == 0 or len(todo) < 2:
        for job in todo:
            yield job, function(*job)
        return
    todo = list(reversed(todo))
    flying: dict = {}
    with pool(workers) as here:
        while todo or flying:
            while todo and len(flying) < AHEAD * workers:
                job = todo.pop()
                flying[here.submit(function, *job)] = job
            for future in cf.wait(flying, return_when=cf.FIRST_COMPLETED).done:
                yield flying.pop(future), future.result()


def _read(path, jobs):
    """Return the results of `jobs` in the file; start it anew when it is missing or of other code."""
    digest = fingerprint()["digest"]
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    wanted = set(jobs)
    if lines and json.loads(lines[0]) == digest:
        held = {}
        for line in lines[1:]:
            try:
                job, result = json.loads(line)
            except ValueError:
                continue  # the line that a kill cut short
            held[tuple(job)] = result
        return {job: held[job] for job in wanted & set(held)}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(digest) + "\n", encoding="utf-8")
    return {}
