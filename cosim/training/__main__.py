"""Designs and thresholds made anew: `python -m cosim.training NAME|all [--check] [--aircraft DIR]`."""

import argparse
import shutil
import sys
from typing import Any

from rich.console import Console

from cosim.errors import CosimError, DesignError
from cosim.files import replace_text
from cosim.flight.detection import stored_designs
from cosim.progress import Progress
from cosim.scenario.aircraft import DEFAULT, load_aircraft
from cosim.table import Row, Table
from cosim.training import NAMES, designs, load, trainer
from cosim.training.train_aircraft import another
from fdi.common import tuning

ALL = "all"
ENGINES = (1, 2, 4)  # that the four places of the detectors' force model can stand for
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
        names = NAMES if asked.name == ALL else (asked.name,)
        trainings = {name: load(name) for name in names if name != "designs"}
        if "designs" in names and not asked.check:
            designs.make(DEFAULT, _tell)
        wrong = _state(designs.check()) if "designs" in names else 0
        return max([wrong, *(_thresholds(name, training, asked.check) for name, training in trainings.items())])
    except CosimError as error:
        err.print(f"error: {error.line}", soft_wrap=True, highlight=False, markup=False)
        return 2
    except KeyboardInterrupt:
        return 130


def _tell(text: str) -> None:
    err.print(text, soft_wrap=True, highlight=False, markup=False)


def _trained(name: str, training: Any, label: str, **where: Any) -> dict[str, dict[str, Any]]:
    """Fly a training; `label` stands beside its progress."""
    with Progress(f"training {label}", "flights", waiting="preparing", console=err) as progress:
        return trainer.trained(name, training, progress=progress, **where)


def _thresholds(name: str, training: Any, check: bool) -> int:
    """Train and store thresholds, or only compare; return 1 where --check finds a changed digit."""
    made = _trained(name, training, name)
    changes = list(trainer.changes(made))
    if not check:
        trainer.store(made)
    rows = [Row((file, threshold, f"{old}", f"{new}")) for file, threshold, old, new in changes]
    out.print(Table(f"{name}: what changes", "file", "threshold", "stored>", "trained>", rows=rows) if rows else
              f"{name}: every number is as it was stored")  # fmt: skip
    return int(check and bool(changes))


def _another(name: str, aircraft: str, check: bool) -> int:
    """Make, unless only to be checked, designs and thresholds of another aircraft, into its folder."""
    own = load_aircraft(aircraft)
    if name != ALL:
        raise DesignError(f"{name!r} with --aircraft", allowed=ALL, remedy="its parts are made together")
    if own.own_designs is None:
        raise DesignError("its designs are those of fdi/", place=f"--aircraft {aircraft}",
                          remedy="`python -m cosim.training all` makes them")  # fmt: skip
    if own.engines not in ENGINES:
        allowed = "1, 2 or 4: the places of the force model"
        raise DesignError(f"{own.engines} engines", place=f"--aircraft {aircraft}", allowed=allowed)
    if not check:
        designs.make(aircraft, _tell)
        thresholds = own.folder / "thresholds"
        shutil.rmtree(thresholds, ignore_errors=True)  # no flight of the training knows what the last one found
        thresholds.mkdir()
        training = another(str(own.folder))
        trainer.store(_trained(f"all --aircraft {own.name}", training, own.name, into=thresholds), thresholds)
        about = {"aircraft_sha256": stored_designs.digest(own)}
        replace_text(own.folder / "designs" / stored_designs.FILE, tuning.text(about))
    return _state(designs.check(aircraft))


def _state(problems: dict[str, str]) -> int:
    """Print what is wrong with each design; return 1 where something is."""
    for name, problem in problems.items():
        out.print(f"{name}: {problem or 'belongs to this aircraft'}", soft_wrap=True, highlight=False, markup=False)
    return int(any(problems.values()))


if __name__ == "__main__":
    sys.exit(main())
