"""Load a user-supplied actuator: a block from a file or an FMU, with a shipped servo or its own.

A file is a block (actuators/block.py), compiled or plain Python: INPUTS with hm0, hmd and, without a shipped servo,
command, f_cmd and s_cmd, or, with one, u, f_u and s_u; STATE with delta and what the sensors read (q_rod, x3); OUTPUTS;
params() -> PARAMS (1,); init_at(p, delta, hm0, hmd) -> STATE; rollout(x, u, p, dt), every lane by one tick in place.
"""

import dataclasses
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from actuators import fmu
from actuators.block import Entry
from actuators.exception_text import sentence
from actuators.python_block import PythonBlock
from actuators.registry import HYDRAULIC, SIMPLE
from actuators.technology import Technology


def technology(
    name: str, part: Any, units: Mapping[str, str], load: Callable, error: Callable[[str], Exception]
) -> Technology:
    """Return the technology of `part`: a block whose module `load(part.path, error)` gives, or an FMU, `part` and
    `units` as the first arguments of `fmu.Slaves`; with `part.servo` behind the shipped servo. `error(text)` makes what
    is raised where it is none."""
    block, start = _of_file(part, load, error) if part.file else _of_fmu(part, units, error)

    def build(own, truth, believed, trim, travel, dt, age):
        served, told = [], np.zeros_like(trim[0])
        if part.servo:
            section, *rest = HYDRAULIC.build(own, [{}] * len(believed), believed, trim, travel, dt, age)[0]
            served, told = [(f"{name}_{section}", *rest)], rest[2]["u"]
        return [*served, (name, *start(truth, trim, told, dt))]

    about: dict[str, Any] = {
        "name": name, "article": f"a {name}", "build": build, "design": HYDRAULIC.design, "effects": {}, "kinds": {},
        "fixed": (), "parameters": lambda own: {},
    }  # fmt: skip
    if part.servo:
        return dataclasses.replace(
            HYDRAULIC, servo=f"{name}_servo", modules=lambda: (HYDRAULIC.modules()[0], block()),
            sent=(f"{name}_command", "valve command to it", "-"), gain_of=part.servo, **about,
        )  # fmt: skip
    measured = [word for word in HYDRAULIC.sensors if word in ("surface", *part.outputs)]
    sensors = {word: dataclasses.replace(HYDRAULIC.sensors[word], servo=None) for word in measured}
    return dataclasses.replace(
        SIMPLE, modules=lambda: (None, block()), sensors=sensors, runaway="command", **about
    )  # fmt: skip


def _of_file(part, load, error):
    """Return (block(), start(truth, trim, told, dt) -> (block, PARAMS, STATE)) of a block in a file."""
    path = part.path

    def block():
        made = load(path, lambda text: error(f"{path.name}: {text}"))[0]
        needed = ("INPUTS", "STATE", "OUTPUTS", "params", "init_at", "rollout")
        inputs = ("hm0", "hmd", *(("u", "f_u", "s_u") if part.servo else ("command", "f_cmd", "s_cmd")))
        states = ("delta", *(("q_rod", "x3") if part.servo else ()))
        lacks = [word for word in needed if not hasattr(made, word)]
        lacks = lacks or [f"INPUTS.{i}" for i in inputs if i not in made.INPUTS.names]
        lacks = lacks or [f"STATE.{s}" for s in (*states, *made.OUTPUTS) if s not in made.STATE.names]
        if lacks:
            raise error(f"{path.name} has no {lacks[0]}")
        return made

    def start(truth, trim, told, dt):
        made = block()
        compiled = isinstance(made.rollout, Entry)
        try:
            rows = [made.params(**lane) for lane in truth]
            if np.shape(rows) != (len(truth), 1):
                wrong = np.shape(rows)[1:]
                raise ValueError(f"params() returns an array of shape {wrong}; allowed: PARAMS of shape (1,)")
            p = np.concatenate(rows)
            x = made.init_at(p, *trim)
            if np.shape(x) != p.shape:
                raise ValueError(f"init_at() returns an array of shape {np.shape(x)}; allowed: STATE of {p.shape}")
            if compiled:
                _ = made.rollout.native.address
        except (Exception, SystemExit) as said:
            raise error(f"{path.name}: {sentence(said, path)}") from None
        return made if compiled else _guarded(made, path, error), p, x

    return block, start


def _guarded(made, path, error):
    """Return a block in plain Python, called lane by lane, that raises error(text) for whatever it raises."""

    def make(p, dt):
        def step(t, x, u):
            now = x.view(made.STATE)
            made.rollout(now, u.copy().view(made.INPUTS).reshape(1, 1), np.atleast_1d(p), dt)
            if not np.isfinite(now["delta"]).all():
                raise ValueError(f"delta = {now['delta'].tolist()}")

        return step

    def failed(_, t, said):
        raise error(f"{path.name}: at {t:.3f} s {sentence(said, path)}") from None

    own = {word: getattr(made, word) for word in ("INPUTS", "STATE", "OUTPUTS")}
    return SimpleNamespace(__name__=made.__name__, rollout=PythonBlock(make, failed), **own)


def _of_fmu(part, units, error):
    """Return the same of an FMU."""

    def start(truth, trim, told, dt):
        delta, hm0, hmd = trim
        first = {"surface": delta, "command": delta, "valve_command": told, "hinge_0": hm0, "hinge_slope": hmd,
                 "hinge_moment": hm0 + hmd * delta}  # fmt: skip
        slaves = fmu.Slaves(part, units, first, dt, error)
        return slaves, np.arange(len(truth), dtype=float).view(fmu.PARAMS), slaves.x0

    return lambda: fmu.Slaves, start
