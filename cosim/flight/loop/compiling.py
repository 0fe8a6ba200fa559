"""Compilation before a machine's first flight, on every core, with progress."""

from collections.abc import Callable
from contextlib import nullcontext
from types import ModuleType

from actuators.block import Entry
from actuators.kernels import Native, compile_ahead
from actuators.registry import SHIPPED
from cosim.flight.blocks import faults, hinge_model, law, manoeuvre, sensors
from cosim.flight.detection import detectors
from cosim.flight.loop import tape
from cosim.flight.plant import gusts
from cosim.progress import Compiling
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES
from fdi import registry

LOOP = (law, faults, sensors, manoeuvre, hinge_model, gusts)  # blocks that are neither detectors nor of an actuator


def shipped() -> dict[str, ModuleType]:
    """Return {module name: module} of every block that ships: of the detectors, the technologies, the loop."""
    return _blocks(map(registry.module, registry.DEFAULT), [t.name for t in SHIPPED])


def every() -> list[Native]:
    """Return the compiled functions of every block that ships, and of the tape."""
    return [*(m.rollout.native for m in shipped().values()), tape.WALK]


def _blocks(detectors, technologies):
    """Return {module name: module} of what is a block: what takes longest comes first; users' classes are none."""
    modules = [*detectors, *(m for name in technologies for m in TECHNOLOGIES[name].modules()), *LOOP]
    return {m.__name__: m for m in modules if isinstance(m, ModuleType) and isinstance(m.rollout, Entry)}


def functions(scenario: Scenario) -> dict[str, Native]:
    """Return {module: its compiled function} of every block that a flight of `scenario` steps, and of its tape."""
    used = dict.fromkeys((*scenario.elevator.technology.values(), "simple"))
    blocks = _blocks((d.module for d in detectors.chosen(scenario)), used)
    return {**{name: m.rollout.native for name, m in blocks.items()}, tape.__name__: tape.WALK}


def prepare(scenario: Scenario, tell: Callable[[int, int], None] | None = None) -> int:
    """Compile what is not compiled yet for `scenario`, `tell(done, n)` as it goes on; return how many there were.
    Without `tell` it is shown on standard error, or in the notebook.

    One function alone is left to its first use.
    """

    with nullcontext(tell) if tell else Compiling() as say:
        return compile_ahead(functions(scenario).values(), say)
