"""Compile what a flight needs before it flies, on every core, and say how far that is: a machine's first flight."""

from collections.abc import Callable
from types import ModuleType

from actuators import block
from actuators.ahead import compile_ahead
from actuators.block import Entry
from actuators.native import PLAIN, Native
from cosim.flight import detectors, tape
from cosim.flight.blocks import faults, hinge_model, law, manoeuvre, sensors
from cosim.log import chunk
from cosim.scenario import Scenario
from cosim.scenario.catalog import TECHNOLOGIES


def functions(scenario: Scenario) -> dict[str, Native]:
    """Return {module: its compiled function} of every block that a flight of `scenario` steps, of its tape, and of
    what reads its log and replays it; none where nothing is compiled (NUMBA_DISABLE_JIT=1).
    """
    if PLAIN:
        return {}
    used = dict.fromkeys((*scenario.elevator.technology.values(), "simple"))
    own = [d.module for d in detectors.chosen(scenario)]
    modules = [m for m in own if isinstance(m, ModuleType)]  # what takes longest comes first; guests elsewhere
    modules += [m for name in used if name in TECHNOLOGIES for m in TECHNOLOGIES[name].modules() if m is not None]
    modules += [law, faults, sensors, manoeuvre, hinge_model]
    blocks = [m for m in modules if isinstance(getattr(m, "rollout", None), Entry)]
    others = {tape.__name__: tape.WALK, chunk.__name__: chunk.GATHER, block.__name__: block.SWEEP}
    return {**{m.__name__: m.rollout.native for m in blocks}, **others}


def prepare(scenario: Scenario, tell: Callable[[int, int], None] | None = None) -> int:
    """Compile what is not compiled yet for `scenario`, `tell(i, n)` before each of n; return how many there were.

    One function alone is left to its first use.
    """

    def progress(done, total):
        if tell and done < total:
            tell(done + 1, total)

    return compile_ahead(functions(scenario).values(), progress)
