"""A co-simulation FMU (FMI 2 or 3) in place of an elevator segment's actuator, stepped once a tick through fmpy.

What it gets and gives stands in words with units, a table of the scenario maps them to the FMU's variables:

    inputs    command (angle asked for) or, behind a shipped servo, valve_command; hinge_0, hinge_slope (the moment is
              hinge_0 + hinge_slope surface, + drives trailing edge down); hinge_moment (at the tick's beginning)
    outputs   surface; rod, pressure (share of supply) where there are such sensors
    start     surface, and the inputs, before the first tick: in load equilibrium

A fault that enters with the command acts before the FMU; inside it no fault of ours acts. An FMU runs code of its
author with the user's rights.
"""

import math
import tempfile
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from actuators.block import dtype
from actuators.constants import TO_SI

PARAMS = dtype([("lane", "f8", "-")])  # which instance
INPUTS = dtype([
    ("command", "f8", "rad"),  # angle asked for
    ("u", "f8", "-"),  # valve command of a servo
    ("hm0", "f8", "N m"),  # hinge moment at zero angle, + drives trailing edge down
    ("hmd", "f8", "N m/rad"),  # its slope
    ("f_cmd", "f8", "rad"),  # fault: added to the command
    ("s_cmd", "f8", "-"),  # fault: share of the command replaced
    ("f_u", "f8", "-"),  # fault: added to the valve command
    ("s_u", "f8", "-"),  # fault: share of the valve command replaced
])
STATE = dtype([
    ("delta", "f8", "rad"),  # surface angle, trailing edge down +
    ("q_rod", "f8", "m"),  # rod position, + extends; 0 where the FMU gives none
    ("x3", "f8", "-"),  # pressure difference over supply; 0 where the FMU gives none
    ("status", "f8", "-"),  # 0 good, 1 an output was not finite: the last one is held
])
OUTPUTS = ("delta", "q_rod", "x3", "status")
FATAL = 4  # status of a call, FMI 2 and 3
STATES = {"surface": "delta", "rod": "q_rod", "pressure": "x3"}  # output -> field


class Variable(NamedTuple):
    """A variable of an FMU: its name, the unit that the scenario gives it ("": none), the SI unit of the word."""

    name: str
    unit: str
    si: str


class Slaves:
    """The FMU's instances of one flight, a block: a lane is an instance."""

    PARAMS, INPUTS, STATE, OUTPUTS = PARAMS, INPUTS, STATE, OUTPUTS

    def __init__(self, path: Path, lanes: int, inputs: Mapping[str, Variable], outputs: Mapping[str, Variable],
                 parameters: Mapping[str, float], dt: float, error: Callable[[str], Exception]):  # fmt: skip
        """Unpack `path` and make `lanes` instances, to be stepped by `dt` [s]. Raises error(text), text with the FMU's
        own messages, also for what its model description asks and the loop cannot do."""
        self._error = error
        try:
            import fmpy
        except ImportError:
            raise error("FMUs need the library fmpy (pip install 'cosim-fdi[fmu]')") from None
        self.__name__ = f"fmu {path.name}"
        self._messages: deque[tuple[int, str]] = deque(maxlen=200)  # how bad, what
        self._tick = 0
        self._folder = tempfile.TemporaryDirectory(prefix="cosim-fmu-")
        self._fmus: list[Any] = []
        try:
            self._about = fmpy.read_model_description(str(path))
            self._check(lanes, dt)
            self._names = {v.name: v for v in self._about.modelVariables}
            for name in parameters:
                self._known(name)
            self._inputs = {word: self._scaled(v, "input") for word, v in inputs.items()}
            self._outputs = {word: self._scaled(v, "output") for word, v in outputs.items()}
            fmpy.extract(str(path), self._folder.name)
            for _ in range(lanes):
                self._fmus.append(self._instance())
                self._set(self._fmus[-1], parameters)
        except Exception as said:  # fmpy raises what the operating system, the XML parser and the FMU raise
            raise error(self._said(said)) from None
        self._end = weakref.finalize(self, _end, self._fmus, self._folder)

    def start(self, first: Mapping[str, np.ndarray], begin: Mapping[str, Variable]) -> np.ndarray:
        """Initialise every instance with SI values {word: (lanes,)} and return STATE (lanes,)."""
        x = np.zeros(len(self._fmus), STATE)
        try:
            for i, fmu in enumerate(self._fmus):
                if self._about.fmiVersion.startswith("2"):
                    fmu.setupExperiment(startTime=0.0)
                variables = {**self._inputs, **{word: self._scaled(v) for word, v in begin.items()}}
                self._set(fmu, {name: float(first[w][i]) / factor for w, (name, factor) in variables.items()})
                fmu.enterInitializationMode()
                fmu.exitInitializationMode()
                self._get(fmu, x[i])
        except Exception as said:
            raise self._error(self._said(said)) from None
        return x

    def rollout(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, dt: float) -> None:
        """Advance every lane by one tick."""
        for i, fmu in enumerate(self._fmus):
            now = u[i, 0]
            hm = now.hm0 + now.hmd * x[i].delta
            given = {
                "command": (1.0 - now.s_cmd) * now.command + now.f_cmd,
                "valve_command": (1.0 - now.s_u) * now.u + now.f_u,
                "hinge_0": now.hm0, "hinge_slope": now.hmd, "hinge_moment": hm,
            }  # fmt: skip
            try:
                self._set(fmu, {name: float(given[w]) / factor for w, (name, factor) in self._inputs.items()})
                self._step(fmu, self._tick * dt, dt)
                self._get(fmu, x[i])
            except Exception as said:
                raise self._error(self._said(said)) from None
        self._tick += 1

    def _check(self, lanes, dt):
        """Raise ValueError for what the model description asks and the loop cannot do."""
        about = self._about.coSimulation
        if about is None or not self._about.fmiVersion.startswith(("2", "3")):
            raise ValueError(f"is no co-simulation FMU of version 2 or 3, but of version {self._about.fmiVersion}")
        if about.needsExecutionTool:
            raise ValueError("needsExecutionTool: it runs only beside the tool that made it; export it without")
        if about.canBeInstantiatedOnlyOncePerProcess and lanes > 1:
            said = f"canBeInstantiatedOnlyOncePerProcess: it cannot be on {lanes} segments"
            raise ValueError(f"{said}; name a copy of the file for each of them")
        inner = float(about.fixedInternalStepSize or 0.0)
        if inner > 0.0 and abs(dt / inner - round(dt / inner)) > 1e-9 * dt / inner:
            raise ValueError(f"fixedInternalStepSize = {inner:g} s does not divide the tick of {dt:g} s; set rate_hz")

    def _step(self, fmu, t, dt):
        """Advance an instance from t to t + dt [s]; one that does not get there raises ValueError."""
        said = fmu.doStep(currentCommunicationPoint=t, communicationStepSize=dt)
        if said is None:  # FMI 2: the status, which fmpy checks, is all
            return
        _, ended, early, reached = said
        if ended:
            raise ValueError(f"ended the simulation at {t:.3f} s (terminateSimulation)")
        if early or abs(reached - (t + dt)) > 1e-6 * dt:
            raise ValueError(f"came to {reached:.6f} s in the step from {t:.3f} s to {t + dt:.3f} s (earlyReturn)")

    def _known(self, name):
        """Return the FMU's variable of this name, one number."""
        variable = self._names.get(name)
        if variable is None:
            raise ValueError(f"has no variable {name!r}; it has {', '.join(sorted(self._names))}")
        if variable.clocks:
            raise ValueError(f"its variable {name!r} has a clock; allowed: variables without")
        if variable.type not in ("Real", "Float64") or variable.dimensions:
            kind = "an array" if variable.dimensions else f"of type {variable.type}"
            raise ValueError(f"its variable {name!r} is {kind}; allowed: one floating-point number of 64 bits")
        return variable

    def _scaled(self, variable, causality=""):
        """Return (name, factor to SI) of a mapped variable."""
        about = self._known(variable.name)
        if causality == "input" and about.causality != "input":
            raise ValueError(f"its variable {variable.name!r} is no input but {about.causality or 'local'}")
        if causality == "output" and about.causality in ("input", "parameter", "independent"):
            raise ValueError(f"its variable {variable.name!r} is no output but {about.causality}")
        factors, declared = TO_SI[variable.si], about.unit or (about.declaredType and about.declaredType.unit)
        declared = str(declared or "").replace(".", " ").replace("*", " ")
        said = variable.unit or (declared if declared in factors else variable.si)
        if declared in factors and factors[declared] != factors[said]:
            raise ValueError(f"its variable {variable.name!r} is in {declared}, not in {said}")
        return variable.name, factors[said]

    def _instance(self):
        from fmpy.simulation import instantiate_fmu

        messages = self._messages  # alone: a logger that held the instances would keep them for good
        status, text = (1, 3) if self._about.fmiVersion.startswith("3") else (2, 4)  # places among its arguments

        def logger(*given):
            messages.append((given[status], given[text].decode("utf-8", "replace")))

        return instantiate_fmu(self._folder.name, self._about, "CoSimulation", logger=logger, debug_logging=True)

    def _said(self, error):
        """Return the FMU's own messages, the worst ones, and what fmpy says."""
        if getattr(error, "status", 0) == FATAL:
            self._fmus.clear()  # FMI: no function of any instance may be called any more
        worst = max((how for how, _ in self._messages), default=0)
        last = [text for how, text in self._messages if how == worst][-3:]
        return "; ".join([*dict.fromkeys(" ".join(text.split()) for text in last), " ".join(str(error).split())])

    def _set(self, fmu, values):
        if values:
            references, numbers = [self._names[n].valueReference for n in values], list(values.values())
            (fmu.setFloat64 if self._about.fmiVersion.startswith("3") else fmu.setReal)(references, numbers)

    def _get(self, fmu, x):
        references = [self._names[name].valueReference for name, _ in self._outputs.values()]
        found = (fmu.getFloat64 if self._about.fmiVersion.startswith("3") else fmu.getReal)(references)
        x.status = 0.0
        for (word, (_, factor)), value in zip(self._outputs.items(), found):
            if math.isfinite(value):
                x[STATES[word]] = value * factor
            else:
                x.status = 1.0


def _end(fmus, folder):
    for fmu in fmus:
        try:
            fmu.terminate()
            fmu.freeInstance()
        except Exception:  # an FMU in an error state may refuse to end; the flight is over
            continue
    folder.cleanup()


KIND = SimpleNamespace(PARAMS=PARAMS, INPUTS=INPUTS, STATE=STATE, OUTPUTS=OUTPUTS, __name__="fmu")
