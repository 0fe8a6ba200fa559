"""Designs and thresholds made anew: `python -m cosim.training NAME|all [--check] [--aircraft DIR]`."""

import argparse
import sys
from typing import Any

from rich.console import Console

from cosim.errors import CosimError, DesignError
from cosim.progress import Progress
from cosim.table import Row, Table
from cosim.training import NAMES, load
from cosim.training import designs as stored

ALL = "all"
out, err = Console(), Console(stderr=True)


def main(words: list[str] | None = None) -> int:
    """Make what the command line names, or compare it with what is stored; return the exit status.

    0: made, or as stored; 1: --check found a difference; 2: bad input.
    """
    parser = argparse.ArgumentParser("python -m cosim.training", description="Make designs and thresholds anew.")
    parser.add_argument("name", metavar="NAME", help=f"{ALL}, {', '.join(NAMES)}")
    parser.add_argument("--check", action="store_true", help="write nothing, compare with what is stored")
    parser.add_argument("--aircraft", metavar="DIR", help="everything for another aircraft, into its folder")
    asked = parser.parse_args(words)
    try:
        if asked.aircraft:
            return _another(asked.name, asked.aircraft, asked.check)
        names = list(NAMES) if asked.name == ALL else [asked.name]
        makers = [_designs if name == "designs" else _thresholds(name) for name in names]
        return max([make(asked.check) for make in makers])
    except CosimError as error:
        err.print(f"error: {error.line}", soft_wrap=True, highlight=False, markup=False)
        return 2
    except KeyboardInterrupt:
        return 130


def _tell(text: str) -> None:
    err.print(text, soft_wrap=True, highlight=False, markup=False)


def _designs(check: bool) -> int:
    """Make the stored designs unless only to be checked; return whether one does not belong to the aircraft."""
    for name in () if check else stored.DESIGNS:
        stored.build(name, progress=_tell)
    return _state({name: stored.check(name) for name in stored.DESIGNS})


def _thresholds(name: str) -> Any:
    """Return what trains `name` and returns 1 where --check finds a changed digit. Raises DesignError if unknown."""
    training = load(name)

    def make(check: bool) -> int:
        with Progress(f"training {name}", "flights", waiting="preparing", console=err) as progress:
            made = training.train(progress=progress)
        changes = [(*where, f"{old:.9g}", f"{new:.9g}") for *where, old, new in training.changes(made) if old != new]
        if not check:
            training.store(made)
        head = f"{name}: of each threshold that changes the entry that changes most"
        rows = Table(head, "file", "set", "threshold", "stored>", "trained>", rows=map(Row, changes))
        out.print(rows if changes else f"{name}: every number is as it was stored")
        return int(check and bool(changes))

    return make


def _another(name: str, aircraft: str, check: bool) -> int:
    """Make, unless only to be checked, designs and thresholds of another aircraft."""
    from cosim.training import aircraft_designs

    if name != ALL:
        raise DesignError(f"{name!r} with --aircraft", allowed=ALL, remedy="its parts are made together")
    if not check:
        with Progress("training", "jobs", waiting="preparing", console=err) as progress:
            aircraft_designs.make(aircraft, progress=progress, tell=_tell)
    return _state(aircraft_designs.check(aircraft))


def _state(problems: dict[str, str]) -> int:
    """Print what is wrong with each design; return 1 where something is."""
    for name, problem in problems.items():
        out.print(f"{name}: {problem or 'belongs to this aircraft'}", soft_wrap=True, highlight=False, markup=False)
    return int(any(problems.values()))


if __name__ == "__main__":
    sys.exit(main())
