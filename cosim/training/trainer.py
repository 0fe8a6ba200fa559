"""The trainer of the detectors' thresholds: it flies, asks what is found in each flight, fits limits and stores them.

A module of `cosim.training` declares what is a detector's own, as a `Training`: flights, the statistics in one of them,
the limits that follow from those of all. The rest stands here.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import fdi
from cosim.campaign.pool import work
from cosim.files import replace_text
from fdi.common import tuning

FOLDER = Path(fdi.__file__).parent / "thresholds"
RECORD = "training"  # in a file: how its numbers were found
# {detector: ({set in its file: {PARAMS field: number or list, SI}}, how they were found)}
Limits = dict[str, tuple[dict[str, dict[str, Any]], dict[str, Any]]]


def significant(value: Any, digits: int = 4) -> Any:
    """Return plain data with its numbers to so many significant digits."""
    if isinstance(value, dict):
        return {k: significant(v, digits) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [significant(v, digits) for v in value]
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value


def decimals(fields: dict[str, Any], digits: int = 7) -> dict[str, Any]:
    """Return {field: number or list} to so many digits behind the point."""
    return {name: np.round(value, digits).tolist() for name, value in fields.items()}


@dataclass(frozen=True)
class Training:
    """The training of some detectors."""

    first_seed: int
    number: int | None  # of flights, None: as many as there are
    flights: Callable[[int, Any], list[dict[str, Any]]]  # (first seed, number) -> arguments of each `survey`
    survey: Callable[..., Any]  # (**arguments) -> what is found in a flight, plain data
    limits: Callable[[list], Limits]  # of what is found in all flights
    about: dict[str, Any]  # of the flights, into every record


def trained(name: str, of: Training, *, into: Path | None = None, **how: Any) -> dict[str, dict[str, Any]]:
    """Fly a training and return {detector: what its file in the folder `into`, by default FOLDER, then holds}.

    `how` is as in `cosim.campaign.pool.work`.
    """
    flights = of.flights(of.first_seed, of.number)
    limits = of.limits(work([(of.survey, flight) for flight in flights], **how))
    record = {"command": f"python -m cosim.training {name}", **of.about, "flights": len(flights),
              "first_seed": of.first_seed}  # fmt: skip
    out = {}
    for detector, (sets, found) in limits.items():
        held = _read(detector, into)
        own = {which: held.get(which, {}) | fields for which, fields in sets.items()}
        out[detector] = held | own | {RECORD: record | found}
    return out


def changes(made: dict[str, dict[str, Any]], folder: Path | None = None) -> Iterator[tuple[str, str, Any, Any]]:
    """Yield (file, threshold, stored, trained) of every number that changes, None where there is none."""
    for detector, held in made.items():
        old, new = dict(_numbers(_read(detector, folder))), dict(_numbers(held))
        for name in {**old, **new}:
            if old.get(name) != new.get(name) and not name.startswith(RECORD):
                yield detector, name, old.get(name), new.get(name)


def store(made: dict[str, dict[str, Any]], folder: Path | None = None) -> None:
    """Write what `trained` returned."""
    for detector, data in made.items():
        replace_text((folder or FOLDER) / f"{detector}.json", tuning.text(data))


def _numbers(value, at=()):
    """Yield (place, number) of nested plain data."""
    if not isinstance(value, dict | list):
        yield " ".join(at), value
        return
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield from _numbers(part, (*at, str(key)))


def _read(detector, folder):
    file = (folder or FOLDER) / f"{detector}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
