"""Studies: a question answered by many small independent flights; `cosim study NAME QUESTION…` prints their tables.

A study is a module with `ABOUT` and `questions()`. A Question names its jobs (`cosim.campaign.jobs`) and makes tables
of their values; the jobs of a study share a folder, so that a killed one goes on where it ended.
"""

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from cosim.campaign.jobs import code_of, work
from cosim.errors import CosimError, did_you_mean

NAMES = ("aircraft_level", "ema", "ema_names", "hydraulic", "local", "manoeuvres")


@dataclass(frozen=True)
class Options:
    """What a study is asked with: flights of each case, sensor noise over that of the set `transport`."""

    seeds: int
    noise: float = 1.0


class Table(NamedTuple):
    """A printed table; a column named with a trailing > is right-aligned. Notes stand below."""

    title: str
    columns: Sequence[str]
    rows: list
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Question:
    """One question of a study."""

    name: str
    asks: str  # one line, with the cost on one core
    jobs: Callable  # (options) -> [(function, {argument: plain value})]
    tables: Callable  # (options, [value of each job]) -> [Table]
    seeds: int = 1  # flights of each case unless asked otherwise


def known(name: str) -> ModuleType:
    """Return the module of a study. Raises CosimError for one that does not exist."""
    if name not in NAMES:
        raise CosimError(f"there is no study {name!r}", allowed=", ".join(NAMES), remedy=did_you_mean(name, NAMES))
    return importlib.import_module(f"{__name__}.{name}")


def chosen(name: str, questions: Sequence[str] = ()) -> list[Question]:
    """Return those of study `name` that `questions` names, by default all. Raises CosimError for one it lacks."""
    there = {p.name: p for p in known(name).questions()}
    for question in questions:
        if question not in there:
            raise CosimError(f"study {name} has no question {question!r}", allowed=", ".join(there),
                             remedy=did_you_mean(question, there))  # fmt: skip
    return [there[question] for question in dict.fromkeys(questions)] or list(there.values())


def run_study(
    name: str,
    questions: Sequence[str] = (),
    *,
    seeds: int | None = None,
    noise: float = 1.0,
    folder: str | Path | None = None,
    workers: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Iterator[tuple[Question, list[Table]]]:
    """Yield each chosen Question with its tables as it is done; `progress(question, done, total)` counts its jobs."""
    asked = [(p, Options(seeds or p.seeds, noise)) for p in chosen(name, questions)]
    code = code_of([job for p in known(name).questions() for job in p.jobs(Options(1))])
    for question, options in asked:
        tell = None if progress is None else lambda done, total, question=question: progress(question.name, done, total)
        values = work(question.jobs(options), folder=folder, code=code, workers=workers, progress=tell)
        yield question, [Table(*t) for t in question.tables(options, values)]
