"""Compile what a flight needs before it flies, on every core, and say how far that is: a machine's first flight."""

import importlib
import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed

from actuators.block import Entry
from actuators.native import PLAIN, Native
from cosim.flight import detectors, tape
from cosim.flight.blocks import faults, hinge_model, law, manoeuvre, sensors
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES

FEW = 3  # compiled here: other processes take two seconds to begin


def functions(scenario: Scenario) -> dict[str, Native]:
    """Return {module: its compiled function} of every block that a flight of `scenario` steps, and of its tape."""
    used = dict.fromkeys((*scenario.elevator.technology.values(), "simple"))
    modules = [d.module for d in detectors.chosen(scenario)]  # what takes longest comes first
    modules += [m for name in used if name in TECHNOLOGIES for m in TECHNOLOGIES[name].modules() if m is not None]
    modules += [law, faults, sensors, manoeuvre, hinge_model]
    blocks = [m for m in modules if isinstance(getattr(m, "rollout", None), Entry)]
    return {**{m.__name__: m.rollout.native for m in blocks}, tape.__name__: tape.WALK}


def prepare(scenario: Scenario, tell: Callable[[int, int], None]) -> int:
    """Compile what is not compiled yet for `scenario`, `tell(i, n)` before each of n; return how many there were."""
    missing = [] if PLAIN else [name for name, native in functions(scenario).items() if not native.ready()]
    workers = min(len(missing), os.cpu_count() or 1)
    if len(missing) <= FEW or workers < 2:
        for i, name in enumerate(missing):
            tell(i + 1, len(missing))
            _compile(name)
        return len(missing)
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        tell(1, len(missing))
        for i, done in enumerate(as_completed([pool.submit(_compile, name) for name in missing])):
            done.result()
            tell(min(i + 2, len(missing)), len(missing))
    return len(missing)


def _compile(name):
    """Compile the function of a module and store its machine code."""
    module = importlib.import_module(name)
    native = module.WALK if module is tape else module.rollout.native
    _ = native.address
