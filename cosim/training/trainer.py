"""The trainer of the detectors' thresholds: fault-free flights, statistics, limits, what would change, what is stored.

A module of `cosim.training` holds one `Training`: its flights with the statistics found in them, and the limits that
follow. Everything else is the same for all detectors and stands here.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import fdi
from cosim.campaign.pool import work
from cosim.files import replace_text
from fdi.common import compact, tuning

FOLDER = Path(fdi.__file__).parent / "thresholds"


def significant(value: Any, digits: int = 4) -> Any:
    """Return plain data with its numbers to so many significant digits."""
    if isinstance(value, dict):
        return {k: significant(v, digits) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [significant(v, digits) for v in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


def decimals(value: Any, digits: int = 7) -> Any:
    """Return a number, or numbers, to so many digits behind the point."""
    return np.round(value, digits).tolist()


@dataclass(frozen=True)
class Trained:
    """One set of a detector's thresholds as trained."""

    detector: str  # its file in fdi/thresholds
    which: str  # the set in it, "": the file is one set
    fields: dict[str, Any]  # {PARAMS field: number or list, SI}
    found: dict[str, Any] = field(default_factory=dict)  # how: into the record "training"
    record: str = ""  # where the record stands in "training", "": it is the file's own
    rounded: Callable[[Any], Any] = decimals

    def stored(self) -> dict[str, Any]:
        """Return the fields as they are stored."""
        return {name: self.rounded(value) for name, value in self.fields.items()}


@dataclass(frozen=True)
class Training:
    """The training of some detectors: `collect` flies, `limits` makes of what it returns the sets of thresholds."""

    name: str  # `python -m cosim.training NAME`
    first_seed: int
    number: int | None  # of flights, None: as many as there are
    collect: Callable[..., Any]  # (first_seed, number, run) -> collected; `run(jobs)` returns the jobs' values in order
    limits: Callable[[Any], list[Trained]]
    about: dict[str, Any] = field(default_factory=dict)  # of the flights, into every record

    def train(self, *, first_seed: int | None = None, number: int | None = None, **how: Any) -> list[Trained]:
        """Fly the training set and return its sets of thresholds, with their records; `how` as in
        `cosim.campaign.pool.work`."""
        seed = self.first_seed if first_seed is None else first_seed
        flights = self.number if number is None else number
        made = self.limits(self.collect(seed, flights, partial(work, **how)))
        common = {"command": f"python -m cosim.training {self.name}", **self.about, "flights": flights,
                  "first_seed": seed}  # fmt: skip
        return [Trained(**(vars(t) | {"found": common | t.found})) for t in made]

    def changes(self, trained: list[Trained]) -> list[tuple]:
        """Return [(file, set, field, stored, trained)] of every threshold that `store` would write; of a row the entry
        that changes by the largest ratio."""
        out = []
        for t in trained:
            held = _read(t.detector)
            held = held[t.which] if t.which else held
            for name, value in t.stored().items():
                new, old = _numbers(value), _numbers(held.get(name, 0.0))
                old = dict.fromkeys(new, old[()]) if () in old else old
                pairs = ((old.get(key, 0.0), new.get(key, 0.0)) for key in {**old, **new})
                out.append((t.detector, t.which, name, *max(pairs, key=_ratio, default=(0.0, 0.0))))
        return out

    def store(self, trained: list[Trained]) -> None:
        """Write sets of thresholds, each with how it was found, beside what else their files hold."""
        for t in trained:
            data = _read(t.detector)
            held = data[t.which] if t.which else data
            held |= t.stored()
            records = data.get("training", {})
            if not t.record:  # of other trainings in the same file
                others = {k: v for k, v in records.items() if isinstance(v, dict) and "flights" in v}
                data["training"] = others | t.found
            else:
                data["training"] = records | {t.record: t.found}
            replace_text(FOLDER / f"{t.detector}.json", compact.text(data))
        tuning.forget()


def over(survey: Callable[..., Any], flights: Callable[[int, int], list[dict]]) -> Callable[..., list]:
    """Return the `collect` of a training that asks `survey`(**flight) of each of `flights`(first_seed, number)."""
    return lambda first_seed, number, run: run([(survey, flight) for flight in flights(first_seed, number)])


def _numbers(value, at=()):
    """Return {place: number} of nested plain data."""
    if not isinstance(value, dict | list):
        return {at: float(value)}
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    return {place: number for key, part in parts for place, number in _numbers(part, (*at, key)).items()}


def _ratio(pair):
    """Return by which share of the larger two numbers differ."""
    return abs(pair[1] - pair[0]) / max(abs(pair[0]), abs(pair[1]), 1e-300)


def _read(detector):
    return json.loads((FOLDER / f"{detector}.json").read_text(encoding="utf-8"))
