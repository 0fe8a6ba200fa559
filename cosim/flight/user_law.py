"""A control law of one's own: gains of the shipped one, `[law] k_q = 0.9`, or `[law] file = "mine.py"`.

The file has a class `Law`, one object per flight:

    class Law:
        def __init__(self, dt, start): ...              # tick [s]; start.elevator, .throttle, ... of the trim
        def update(self, t, y, ask):                    # measurements [SI], NaN while invalid; the manoeuvre's demands
            return {"elevator": 0.01, "throttle": 0.6}  # commands [rad, 0..1]; what is left out keeps its last value

or a compiled block of the shipped law's records: rollout = entry(step, STATE, INPUTS, PARAMS), the three from
`cosim.flight.blocks.law`. Commands are cut at the aircraft's travels, and one that is not finite is held. `inventory`
lists every name (`cosim list law`); `cosim check mine.py` flies the law and says whether it keeps this contract.
"""

import math
import os
from collections.abc import Callable
from numbers import Real
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from actuators.exception_text import sentence
from actuators.python_block import PythonBlock
from cosim.errors import ScenarioError, among
from cosim.flight.blocks import law
from cosim.flight.loop.wiring import DEMANDS
from cosim.scenario import Scenario
from cosim.scenario.user_parts import load
from cosim.scenario.vocabulary import words

SENSORS = law.SENSORS
SURFACES = {  # command -> (field of the shipped law's state, its least and largest in the parameters, unit, meaning)
    "elevator": ("de_cmd", lambda p: (p.de_min, p.de_max), "rad", "trailing edge down +, pitches down"),
    "aileron": ("da_cmd", lambda p: (-p.da_max, p.da_max), "rad", "+ rolls right"),
    "rudder": ("dr_cmd", lambda p: (-p.dr_max, p.dr_max), "rad", "+ yaws left"),
    "stabiliser": ("stab_cmd", lambda p: (p.stab_min, p.stab_max), "rad", "trailing edge down +"),
    "throttle": ("throttle_cmd", lambda p: (0.0, 1.0), "-", "0 to 1"),
}
ASKED = {  # of DEMANDS: what the manoeuvre asks for
    "nz_dem": ("g", "load-factor increment over level flight"), "phi_dem": ("rad", "bank, right wing down +"),
    "psi_dem": ("rad", "change of heading, while hold_psi is 1"), "de_add": ("rad", "to be added to the elevator"),
    "hold_psi": ("-", "1: hold the heading"), "hold_h": ("-", "1: hold the altitude while nz_dem is 0"),
    "hold_v": ("-", "1: hold the speed"),
}  # fmt: skip
TRIM = {"elevator": "de_0", "stabiliser": "stab_0", "throttle": "throttle_0", "alpha": "alpha_0", "theta": "theta_0",
        "cas": "cas_0", "tas": "tas_0", "altitude": "h_0"}  # fmt: skip


def inventory() -> list[dict[str, str]]:
    """Return {name, unit, summary} of all that a law has and gives: y.alpha, ask.nz_dem, start.cas, "elevator"."""
    of = {name: (w.unit, w.meaning) for name, w in words().items()} | {"altitude": ("m", "altitude")}
    of |= {name: (unit, meaning) for name, (*_, unit, meaning) in SURFACES.items()}
    names = {f"y.{n}": of[n] for n in SENSORS} | {f"ask.{n}": ASKED[n] for n in DEMANDS}
    names |= {f"start.{n}": (of[n][0], f"at the trim: {of[n][1]}") for n in TRIM}
    names |= {f'"{n}"': (of[n][0], f"command: {of[n][1]}") for n in SURFACES}
    return [{"name": name, "unit": unit, "summary": meaning} for name, (unit, meaning) in names.items()]


def gains() -> tuple[str, ...]:
    """Return the parameters of the shipped law that a scenario may set: all but the values of the trim."""
    return tuple(name for name in law.PARAMS.names or () if not name.endswith("_0"))


def tuned(scenario: Scenario, p: np.ndarray) -> np.ndarray:
    """Return the law's PARAMS (1,) with the scenario's own gains; raises ScenarioError for an invalid one."""
    for name, value in (scenario.law.model_extra or {}).items():
        among(name, gains(), "no such gain", place=f"law.{name} = {value:g}")
        p[name] = value
    return p


def block(scenario: Scenario) -> ModuleType | Any:
    """Return the block of the scenario's law: the shipped one, or that of its file. Raises ScenarioError."""
    if scenario.law.file is None:
        return law
    path = Path(os.path.expanduser(scenario.law.file))
    made = load(path, lambda text: _wrong(path, text))[0]
    about = {"PARAMS": law.PARAMS, "INPUTS": law.INPUTS, "STATE": law.STATE, "OUTPUTS": law.OUTPUTS, "init": law.init}
    if hasattr(made, "rollout"):
        return SimpleNamespace(__name__=made.__name__, rollout=made.rollout, **about)
    if not hasattr(made, "Law"):
        raise _wrong(path, "has neither a class Law nor a rollout")
    return SimpleNamespace(__name__=made.__name__, rollout=_python(made.Law, path), **about)


def _wrong(path, text):
    return ScenarioError(f"{path.name}: {text}", place="law.file")


def _python(kind: Callable, path: Path) -> PythonBlock:
    """Return a class as the law's rollout: one object, made at the first tick."""

    def make(p, dt):
        own = kind(dt, SimpleNamespace(**{word: float(p[field]) for word, field in TRIM.items()}))

        def step(t, x, u):
            now, given = x.view(law.STATE)[0], u.view(law.INPUTS)[0]
            y = {n: float(given.y[i]) if given.valid[i] > 0.0 else math.nan for i, n in enumerate(SENSORS)}
            ask = {name: float(given[name]) for name in DEMANDS}
            said = own.update(t, SimpleNamespace(**y), SimpleNamespace(**ask))
            if not isinstance(said, dict):
                raise TypeError(f"update answers {type(said).__name__}; allowed: a dictionary of commands")
            for word, value in said.items():
                if word not in SURFACES or not isinstance(value, Real):
                    raise ValueError(f"commands {word} = {value!r:.40}; allowed: numbers of {', '.join(SURFACES)}")
                field, limits, *_ = SURFACES[word]
                if math.isfinite(value):
                    low, high = limits(p)
                    now[field] = min(max(value, low), high)
                elif not made.notes:
                    at = f"{word} = {value} at {t:.3f} s"
                    made.notes.append(f"{path.name}: {at}; a command that is not finite keeps its last value")

        return step

    def failed(_, t, error):
        names = "; `cosim list law` has every name" if isinstance(error, AttributeError) else ""
        raise _wrong(path, f"at {t:.3f} s {sentence(error, path)}{names}") from None

    made = PythonBlock(make, failed)
    return made
