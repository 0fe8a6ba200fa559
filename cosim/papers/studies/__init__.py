"""Studies: a question answered by many small independent flights, over two processes, their results kept in a folder.

    python -m cosim.papers.studies.lu17 ofc jam --seeds 20 -o FOLDER

A study is a list of Parts. A part names its jobs, each a function at the top of a module with plain keyword arguments
that returns plain data, and turns their values into tables. Every finished job is one line of FOLDER/results.jsonl,
under a digest of the code that made it: a killed study goes on where it ended, and results of two codes never mix.
"""

import argparse
import concurrent.futures as cf
import hashlib
import inspect
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cosim.campaign.pool import pool
from cosim.campaign.store import fingerprint
from cosim.files import replace_text


@dataclass(frozen=True)
class Part:
    """One question of a study."""

    name: str
    asks: str  # one line, with the cost on one core
    jobs: Callable  # (options) -> [(function, {argument: plain value})]
    tables: Callable  # (options, [value of each job]) -> [(title, columns, rows)]


class Results:
    """Values of finished jobs, in memory and in a folder (None: in memory only)."""

    def __init__(self, folder, digest):
        """Read what `folder` holds of code `digest`; results of other code are dropped."""
        self.values: dict[str, object] = {}
        self.path = Path(folder) / "results.jsonl" if folder else None
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lines = self.path.read_text(encoding="utf-8").splitlines() if self.path.exists() else []
        if lines and lines[0] == json.dumps({"code": digest}):
            for line in lines[1:]:
                try:
                    key, value = json.loads(line)
                except ValueError:  # the line that a kill cut short
                    continue
                self.values[key] = value
        kept = [json.dumps({"code": digest}), *(json.dumps([k, v]) for k, v in self.values.items())]
        replace_text(self.path, "".join(f"{line}\n" for line in kept))

    def add(self, key, value):
        """Keep the value of a job."""
        self.values[key] = value
        if self.path:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(json.dumps([key, value]) + "\n")


def key_of(job):
    """Return the text that tells a job from every other."""
    function, arguments = job
    return json.dumps([f"{function.__module__}.{function.__name__}", arguments], sort_keys=True)


def code_of(jobs):
    """Return the digest of all that decides about the values of `jobs`."""
    from actuators.block import closure

    files = {Path(inspect.getfile(function)).resolve() for function, _ in jobs}
    found = hashlib.sha256(json.dumps(fingerprint()).encode())
    for path in sorted({p for file in files for p in closure(file)}):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def work(jobs, *, folder=None, code=None, workers=2, progress=None):
    """Return the value of every job, from `folder` where it has been done; `progress(done, total)` counts them.

    `code` is the digest that the folder is for, by default that of these jobs; `workers` 0 works in this process.
    """
    jobs = [(function, json.loads(json.dumps(arguments))) for function, arguments in jobs]
    results = Results(folder, (code or code_of(jobs)) if folder else "")
    keys = [key_of(job) for job in jobs]
    todo = {key: job for key, job in zip(keys, jobs) if key not in results.values}
    done = lambda: progress(len(set(keys)) - len(todo), len(set(keys))) if progress else None  # noqa: E731
    done()
    if workers == 0:
        for key in list(todo):
            function, arguments = todo.pop(key)
            results.add(key, json.loads(json.dumps(function(**arguments))))
            done()
    elif todo:
        with pool(min(workers, len(todo))) as here:
            flying = {here.submit(_call, *job): key for key, job in todo.items()}
            for future in cf.as_completed(flying):
                key = flying[future]
                results.add(key, json.loads(future.result()))
                del todo[key]
                done()
    return [results.values[key] for key in keys]


def _call(function, arguments):
    return json.dumps(function(**arguments))


def parser(module, about, parts, *, seeds, folder):
    """Return the argument parser of a study module."""
    lines = "\n".join(f"  {p.name:<12} {p.asks}" for p in parts)
    made = argparse.ArgumentParser(
        prog=f"python -m {module}", description=about, epilog=f"parts:\n{lines}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = [p.name for p in parts]
    made.add_argument("parts", nargs="*", metavar="PART", help="which questions; default: all, one after the other")
    made.add_argument("--seeds", type=int, default=seeds, help=f"flights of each case (default {seeds})")
    made.add_argument("--noise", type=float, default=1.0, help="sensor noise over that of the set transport")
    made.add_argument("--workers", type=int, default=2, help="processes (default 2); 0: this one")
    made.add_argument("-o", "--output", metavar="FOLDER", default=folder, help=f"default {folder}; goes on there")
    made.set_defaults(known=names)
    return made


def main(module, about, parts, *, seeds, folder, argv=None):
    """Run the parts that the command line names and print their tables; return the exit status."""
    from rich.console import Console

    from cosim.cli.tables import escape, progress, table

    options = parser(module, about, parts, seeds=seeds, folder=folder).parse_args(argv)
    out, err = Console(width=None if sys.stdout.isatty() else 190), Console(stderr=True)
    unknown = [name for name in options.parts if name not in options.known]
    if unknown or options.seeds < 1 or options.workers < 0 or not 0.0 <= options.noise <= 100.0:
        said = f"no part {unknown[0]!r}" if unknown else "--seeds from 1, --workers from 0, --noise 0 to 100"
        err.print(f"error: {said}; parts: {', '.join(options.known)}", soft_wrap=True, highlight=False)
        return 2
    jobs = {part.name: part.jobs(options) for part in parts}
    code = code_of([job for some in jobs.values() for job in some])
    for part in parts:
        if options.parts and part.name not in options.parts:
            continue
        with progress(err, part.name, "flights", "preparing") as bar:
            values = work(jobs[part.name], folder=options.output, code=code, workers=options.workers, progress=bar)
        for title, columns, rows in part.tables(options, values):
            made = table(title, *map(escape, columns))
            for row in rows:
                made.add_row(*map(text, row))
            out.print(made)
    return 0


def text(value):
    """Return a table cell: short numbers, a dash for nothing."""
    from rich.markup import escape

    if value is None:
        return "-"
    if isinstance(value, float):
        return "-" if value != value else f"{value:.4g}"
    return escape(str(value))
