"""Load a user-supplied actuator: a block from a file or an FMU, with a shipped servo or its own.

A file is a block (actuators/block.py), compiled or plain Python: INPUTS with hm0, hmd and, without a shipped servo,
command, f_cmd and s_cmd, or, with one, u, f_u and s_u; STATE with delta and what the sensors read (q_rod, x3); OUTPUTS;
params() -> PARAMS (1,); init_at(p, delta, hm0, hmd) -> STATE; rollout(x, u, p, dt), every lane by one tick in place.
A file with a `TECHNOLOGY` of its own (actuators/technology.py) is taken as it is.
"""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from actuators import fmu
from actuators.block import Entry
from actuators.exception_text import sentence
from actuators.python_block import of_rollout
from actuators.registry import HYDRAULIC, SIMPLE
from actuators.technology import Technology


def from_file(name: str, path: Path, servo: str, load: Callable, error: Callable[[str], Exception]) -> Technology:
    """Return the technology of a block in a file, whose module `load(path, error)` gives; `error(text)` makes what is
    raised where it is none."""

    def blocks():
        made = load(path, lambda text: error(f"{path.name}: {text}"))[0]
        needed = ("INPUTS", "STATE", "OUTPUTS", "params", "init_at", "rollout")
        inputs = ("hm0", "hmd", *(("u", "f_u", "s_u") if servo else ("command", "f_cmd", "s_cmd")))
        states = ("delta", *(("q_rod", "x3") if servo else ()))
        lacks = [word for word in needed if not hasattr(made, word)]
        lacks = lacks or [f"INPUTS.{i}" for i in inputs if i not in made.INPUTS.names]
        lacks = lacks or [f"STATE.{s}" for s in (*states, *made.OUTPUTS) if s not in made.STATE.names]
        if lacks:
            raise error(f"{path.name} has no {lacks[0]}")
        return _servo(servo), made

    def build(own, truth, believed, trim, travel, dt, age):
        made = blocks()[1]
        try:
            rows = [made.params(**lane) for lane in truth]
            wrong = next((np.shape(row) for row in rows if np.shape(row) != (1,)), None)
            if wrong is not None:
                raise ValueError(f"params() returns an array of shape {wrong}; allowed: PARAMS of shape (1,)")
            p = np.concatenate(rows)
            x = made.init_at(p, *trim)
            if np.shape(x) != p.shape:
                raise ValueError(f"init_at() returns an array of shape {np.shape(x)}; allowed: STATE of {p.shape}")
        except (Exception, SystemExit) as said:
            raise error(f"{path.name}: {sentence(said, path)}") from None
        return [*_served(name, servo, own, believed, trim, travel, dt, age), (name, _guarded(made, path, error), p, x)]

    return _technology(name, servo, blocks, build)


def _guarded(made, path, error):
    """Return the block whose plain `rollout` raises error(text) for whatever it raises; a compiled one as it is."""
    if isinstance(made.rollout, Entry):
        return made

    def rollout(x, u, p, dt):
        made.rollout(x, u, p, dt)
        if not np.isfinite(x["delta"]).all():
            raise ValueError(f"delta = {x['delta'].tolist()}")

    def failed(_, t, said):
        raise error(f"{path.name}: at {t:.3f} s {sentence(said, path)}") from None

    own = {word: getattr(made, word) for word in ("INPUTS", "STATE", "OUTPUTS")}
    stepped = of_rollout(rollout, made.STATE, made.INPUTS, failed)
    return SimpleNamespace(__name__=made.__name__, rollout=stepped, **own)


def from_fmu(name: str, part: Any, units: Mapping[str, str], error: Callable[[str], Exception]) -> Technology:
    """Return the technology of an FMU, `part` and `units` as the first arguments of `fmu.Slaves`; its servo is
    `part.servo`."""
    servo = part.servo

    def build(own, truth, believed, trim, travel, dt, age):
        slaves = fmu.Slaves(part, units, len(truth), dt, error)
        delta, hm0, hmd = trim
        served = _served(name, servo, own, believed, trim, travel, dt, age)
        told = served[0][3]["u"] if served else np.zeros_like(delta)
        first = {"surface": delta, "command": delta, "valve_command": told, "hinge_0": hm0, "hinge_slope": hmd,
                 "hinge_moment": hm0 + hmd * delta}  # fmt: skip
        p = np.zeros(len(truth), fmu.PARAMS)
        p["lane"] = np.arange(len(truth))
        return [*served, (name, slaves, p, slaves.start(first))]

    outputs = tuple(word for word in fmu.STATES if word in part.outputs)
    return _technology(name, servo, lambda: (_servo(servo), fmu.KIND), build, outputs)


def _servo(servo):
    return HYDRAULIC.modules()[0] if servo else None


def _served(name, servo, own, believed, trim, travel, dt, age):
    """Return [(section, block, PARAMS, STATE)] of the shipped servo in front of it, none where it has its own."""
    if not servo:
        return []
    assert HYDRAULIC.build
    section, block, p, x = HYDRAULIC.build(own, [{}] * len(believed), believed, trim, travel, dt, age)[0]
    return [(f"{name}_{section}", block, p, x)]


def _technology(name, servo, modules, build, outputs=("surface",)):
    like = HYDRAULIC if servo else SIMPLE
    sensors = {word: s for word, s in HYDRAULIC.sensors.items() if servo or word in outputs}
    sensors = {word: s if servo else dataclasses.replace(s, servo=None) for word, s in sensors.items()}
    return dataclasses.replace(
        like, name=name, article=f"a {name}", servo=f"{name}_servo" if servo else "", modules=modules, build=build,
        sensors=sensors, sent=(f"{name}_command", "valve command to it", "-") if servo else ("", "", ""),
        inlet="valve" if servo else "", runaway="valve" if servo else "command", effects={}, kinds={}, fixed=(),
        parameters=lambda own: {}, design=HYDRAULIC.design, loop_sensor="rod" if servo else "", gain_of=servo,
    )  # fmt: skip
