"""Studies: a question answered by many small independent flights; `cosim study NAME PART…` prints their tables.

A study is a module with `ABOUT` and `parts()`. A Part names its jobs (`cosim.campaign.jobs`) and turns their values
into tables; the jobs of a study share a folder, so that a killed one goes on where it ended.
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
class Part:
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


def chosen(name: str, parts: Sequence[str] = ()) -> list[Part]:
    """Return the Parts of study `name` that `parts` names, by default all. Raises CosimError for one it lacks."""
    there = {p.name: p for p in known(name).parts()}
    for part in parts:
        if part not in there:
            raise CosimError(f"study {name} has no part {part!r}", allowed=", ".join(there),
                             remedy=did_you_mean(part, there))  # fmt: skip
    return [there[part] for part in dict.fromkeys(parts)] or list(there.values())


def run_study(
    name: str,
    parts: Sequence[str] = (),
    *,
    seeds: int | None = None,
    noise: float = 1.0,
    folder: str | Path | None = None,
    workers: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Iterator[tuple[Part, list[Table]]]:
    """Yield each of the chosen Parts with its tables as it is done; `progress(part, done, total)` counts its jobs."""
    asked = [(p, Options(seeds or p.seeds, noise)) for p in chosen(name, parts)]
    code = code_of([job for p in known(name).parts() for job in p.jobs(Options(1))])
    for part, options in asked:
        tell = None if progress is None else lambda done, total, part=part: progress(part.name, done, total)
        values = work(part.jobs(options), folder=folder, code=code, workers=workers, progress=tell)
        yield part, [Table(*t) for t in part.tables(options, values)]
