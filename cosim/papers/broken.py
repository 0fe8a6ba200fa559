"""Proof that rows can fail: something is broken in one place, and the row must see it.

Four kinds count apart: an *equation*, the *method* (a parameter of it), what is *flown* (faults, flights, draws), and
an *option* that is swapped for another. No break scales a row's own result.

`PAPER/breaks.toml` lists them, each numbered equation that is code at least once:

    [[break]]
    of = "(30)"                                       # the equation; of another kind `what` and `kind` instead
    at = "fdi.hydraulic.two_stage_ekf.measure"        # the function that holds it
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
import types
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel

from actuators.object_cache import PLAIN
from actuators.subprocess_env import command, surroundings
from cosim.papers.claims import load
from cosim.papers.row import Planned


class Break(BaseModel, frozen=True, extra="forbid"):
    """One thing that is broken, and the rows (parts of their items) that must leave their bands."""

    what: str
    at: str  # "module.function"
    was: str
    now: str
    rows: list[str]
    kind: Literal["equation", "method", "flown", "option"] = "equation"


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


def place(at: str) -> Callable:
    """Return the function "module.function", without its cache; a Kernel as it is."""
    module, _, name = at.rpartition(".")
    function = getattr(importlib.import_module(module), name)
    return getattr(function, "__wrapped__", function) if hasattr(function, "cache_clear") else function


@contextlib.contextmanager
def edit(at: str, was: str, now: str) -> Iterator[None]:
    """Change the code of the function `at` ("module.function"): `now` stands where `was` stood, everywhere it is used.

    Raises ValueError where `was` does not stand there exactly once, RuntimeError of a kernel that is compiled, whose
    callers have its code inside: with NUMBA_DISABLE_JIT=1 none is.
    """
    function = place(at)
    if not isinstance(function, types.FunctionType):
        raise RuntimeError("the code of a kernel is changed in plain Python only: set NUMBA_DISABLE_JIT=1")
    source = textwrap.dedent(inspect.getsource(function))
    if source.count(was) != 1:
        raise ValueError(f"{at} holds {was!r} {source.count(was)} times, not once")
    made: dict = {}
    text = source[source.index("def ") :].replace(was, now)
    exec(compile(text, inspect.getsourcefile(function) or "", "exec"), dict(function.__globals__), made)
    held, function.__code__ = function.__code__, made[function.__name__].__code__
    try:
        yield
    finally:
        function.__code__ = held


def breaks(paper: str) -> tuple[Break, ...]:
    """Return the Breaks of a paper, as its breaks.toml has them."""
    held = tomllib.loads((Path(__file__).parent / paper / "breaks.toml").read_text(encoding="utf-8"))
    return tuple(Break(**{"what": f"{b.pop('of', '')}: {b['was']} → {b['now']}"} | b) for b in held["break"])


def forget(paper: str) -> None:
    """Empty every cache of a paper's modules."""
    for name, module in list(sys.modules.items()):
        if name.startswith(f"cosim.papers.{paper}"):
            for value in list(vars(module).values()):
                if callable(getattr(value, "cache_clear", None)):
                    value.cache_clear()


def chosen(rows: list[Planned], of: Break) -> list[Planned]:
    """Return the rows that a Break names; ValueError when a name stands for none."""
    out = []
    for part in of.rows:
        found = [p for p in rows if part in p.item]
        if not found:
            raise ValueError(f"{of.what}: no row has {part!r} in it")
        out += found
    return out


def proof(paper: str, only: Callable[[Break], bool] = lambda of: True) -> list[Broken]:
    """Return what each row of `paper` shows under each of its Breaks; equations are broken in a process of their own.
    """
    asked, found = list(filter(only, breaks(paper))), []
    equations = [of.what for of in asked if of.kind == "equation"]
    if equations and not PLAIN:
        code = "import sys; from cosim.papers.broken import _tell; _tell(*sys.argv[1:])"
        run = subprocess.run([*command(code), paper, json.dumps(equations)], capture_output=True, text=True,
                             env=surroundings(NUMBA_DISABLE_JIT="1"))  # fmt: skip
        if run.returncode:
            raise RuntimeError(f"{paper}: {run.stderr.strip().splitlines()[-1] if run.stderr else 'no answer'}")
        found = [Broken(**b) for b in json.loads(run.stdout)]
        asked = [of for of in asked if of.kind != "equation"]
    for of in asked:
        forget(paper)
        try:
            with edit(of.at, of.was, of.now):
                found += [_seen(paper, p, of) for p in chosen(load(paper), of)]
        finally:
            forget(paper)
    return found


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
    print(json.dumps([asdict(b) for b in proof(paper, lambda of: of.what in json.loads(asked))]))
