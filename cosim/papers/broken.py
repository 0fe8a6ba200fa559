"""Proof that rows can fail: something is broken in one place, and the row must see it.

Four kinds count apart: an *equation* (its code is changed), the *method* (a parameter of it), what is *flown* (faults,
flights, draws), and an *option* that is swapped for another. No break scales a row's own result.

`PAPER/equations.toml` lists the first kind, each numbered equation that is code at least once:

    [[break]]
    of = "(30)"                                       # the equation
    at = "fdi.hydraulic.separate_bias.measure"        # the function that holds it
    was = "(1.0 - K_f * S)"                           # what stands there, once
    now = "(1.0 + K_f * S)"                           # what stands there instead
    rows = ["(15)-(36) as published"]                 # parts of the items that must differ
"""

import contextlib
import importlib
import inspect
import json
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from actuators.object_cache import PLAIN
from actuators.subprocess_env import command, surroundings
from cosim.papers.claims import load
from cosim.papers.row import Planned

KINDS = ("equation", "method", "flown", "option")


@dataclass(frozen=True)
class Break:
    """One thing that is broken, and the rows (parts of their items) that must leave their bands."""

    what: str
    patch: Callable[[], contextlib.AbstractContextManager]
    rows: tuple[str, ...]
    kind: str = "flown"  # one of KINDS

    def __post_init__(self):
        if self.kind not in KINDS:
            raise ValueError(f"{self.what}: kind {self.kind!r} is not one of {', '.join(KINDS)}")


@dataclass(frozen=True)
class Broken:
    """What a row shows with the method broken."""

    paper: str
    item: str
    what: str
    got: float
    band: str
    seen: bool  # outside the band, and outside what was found of a row that differs for a reason
    kind: str = "flown"


@contextlib.contextmanager
def swap(module: str, **values: Any) -> Iterator[None]:
    """Replace names of a module; a value that is a function of one argument under `wrap_NAME` gets the old one."""
    place = importlib.import_module(module)
    held = {}
    for key, value in values.items():
        name = key.removeprefix("wrap_")
        held[name] = getattr(place, name)
        setattr(place, name, value(held[name]) if key.startswith("wrap_") else value)
    try:
        yield
    finally:
        for name, value in held.items():
            setattr(place, name, value)


@contextlib.contextmanager
def edit(at: str, was: str, now: str) -> Iterator[None]:
    """Change the code of the function `at` ("module.function"): `now` stands where `was` stood, everywhere it is used.

    Only where nothing is compiled, NUMBA_DISABLE_JIT=1: a compiled caller has what it calls inside. Raises ValueError
    where `was` does not stand there exactly once, RuntimeError where kernels are compiled.
    """
    if not PLAIN:
        raise RuntimeError("the code of a kernel is changed in plain Python only: set NUMBA_DISABLE_JIT=1")
    module, _, name = at.rpartition(".")
    function = getattr(importlib.import_module(module), name)
    source = textwrap.dedent(inspect.getsource(function))
    if source.count(was) != 1:
        raise ValueError(f"{at} holds {was!r} {source.count(was)} times, not once")
    made: dict = {}
    text = source[source.index("def ") :].replace(was, now)
    exec(compile(text, inspect.getsourcefile(function) or at, "exec"), function.__globals__ | made, made)
    held, function.__code__ = function.__code__, made[name].__code__
    try:
        yield
    finally:
        function.__code__ = held


def equations(paper: str) -> tuple[Break, ...]:
    """Return the Breaks of kind "equation" of a paper, as its equations.toml has them."""
    held = tomllib.loads((Path(__file__).parent / paper / "equations.toml").read_text(encoding="utf-8"))
    return tuple(
        Break(f"{b['of']}: {b['was']} → {b['now']}", _edit(b), tuple(b["rows"]), "equation") for b in held["break"]
    )


def _edit(b):
    return lambda: edit(b["at"], b["was"], b["now"])


def forget(paper: str) -> None:
    """Empty every cache of a paper's modules."""
    for name, module in list(sys.modules.items()):
        if name.startswith(f"cosim.papers.{paper}"):
            for value in list(vars(module).values()):
                if callable(getattr(value, "cache_clear", None)):
                    value.cache_clear()


def breaks(paper: str) -> tuple[Break, ...]:
    """Return the Breaks of a paper."""
    return (*equations(paper), *importlib.import_module(f"cosim.papers.{paper}.breaks").BREAKS)


def chosen(rows: list[Planned], of: Break) -> list[Planned]:
    """Return the rows that a Break names; ValueError when a name stands for none."""
    out = []
    for part in of.rows:
        found = [p for p in rows if part in p.item]
        if not found:
            raise ValueError(f"{of.what}: no row has {part!r} in it")
        out += found
    return out


def proof(paper: str, only: Callable[[Break], bool] = lambda of: True) -> Iterator[Broken]:
    """Yield what each row of `paper` shows under each of its Breaks; equations are broken in a process of their own."""
    asked = list(filter(only, breaks(paper)))
    if not PLAIN and any(of.kind == "equation" for of in asked):
        of_equations = [of.what for of in asked if of.kind == "equation"]
        code = "import sys; from cosim.papers.broken import _tell; _tell(*sys.argv[1:])"
        run = subprocess.run([*command(code), paper, json.dumps(of_equations)], capture_output=True, text=True,
                             env=surroundings(NUMBA_DISABLE_JIT="1"))  # fmt: skip
        if run.returncode:
            raise RuntimeError(f"{paper}: {run.stderr.strip().splitlines()[-1] if run.stderr else 'no answer'}")
        yield from (Broken(**b) for b in json.loads(run.stdout))
        asked = [of for of in asked if of.kind != "equation"]
    for of in asked:
        forget(paper)
        try:
            with of.patch():
                for p in chosen(load(paper), of):
                    yield _seen(paper, p, of)
        finally:
            forget(paper)


def _seen(paper, p, of):
    """Return what a row shows under a Break; an error is no number, and is seen."""
    try:
        row = p.judge()
    except (ArithmeticError, ValueError, RuntimeError) as e:
        if of.kind != "equation":
            raise
        return Broken(paper, p.item, of.what, float("nan"), type(e).__name__, True, of.kind)
    return Broken(paper, p.item, of.what, row.got, row.tolerance, row.verdict == "differs", of.kind)


def _tell(paper, asked):
    found = proof(paper, lambda of: of.what in json.loads(asked))
    print(json.dumps([asdict(b) for b in found]))
