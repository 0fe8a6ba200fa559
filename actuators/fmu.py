"""A co-simulation FMU (FMI 2 or 3) in place of an elevator segment's actuator, stepped once a tick through fmpy.

What it gets and gives stands in words with units, a table of the scenario maps them to the FMU's variables:

    inputs    command (angle asked for) or, behind a shipped servo, valve_command; hinge_0, hinge_slope (the moment is
              hinge_0 + hinge_slope surface, + drives trailing edge down); hinge_moment (at the tick's beginning)
    outputs   surface; rod, pressure (share of supply) where there are such sensors
    start     surface, and the inputs, before the first tick: in load equilibrium

A fault that enters with the command acts before the FMU; inside it no fault of ours acts. An FMU runs code of its
author with the user's rights.
"""

import functools
import math
import tempfile
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from actuators.block import dtype
from actuators.constants import TO_SI
from actuators.python_block import PythonBlock

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
])
OUTPUTS = ("delta", "q_rod", "x3")
FATAL = 4  # status of a call, FMI 2 and 3
STATES = {"surface": "delta", "rod": "q_rod", "pressure": "x3"}  # output -> field


class Slaves:
    """The FMU's instances of one flight, a block: a lane is an instance."""

    PARAMS, INPUTS, STATE, OUTPUTS = PARAMS, INPUTS, STATE, OUTPUTS

    def __init__(
        self, own: Any, units: Mapping[str, str], first: Mapping[str, np.ndarray], dt: float,
        error: Callable[[str], Exception],
    ):  # fmt: skip
        """Unpack the file at `own.path` and make an instance per lane, to be stepped by `dt` [s], from the SI values
        `first` {word: (lane,)}; `x0` is its STATE then.

        `own` has inputs, outputs, start {word: a `variable` and its `unit`, "" for none} and parameters {name: value},
        `units` {word: SI unit}. Raises error(text), text with the FMU's own messages, also for what its model
        description asks and the loop cannot do.
        """
        try:
            import fmpy
        except ImportError:
            raise error("FMUs need the library fmpy (pip install 'cosim-fdi[fmu]')") from None
        self.__name__, self._units, self._error = f"fmu {own.path.name}", units, error
        self._messages: deque[tuple[int, str]] = deque(maxlen=200)  # how bad, what
        self._fmus: list[Any] = []
        self.x0 = np.zeros(len(first["surface"]), STATE)
        self._folder = tempfile.TemporaryDirectory(prefix="cosim-fmu-")
        self._end = weakref.finalize(self, _end, self._fmus, self._folder)
        self.rollout = PythonBlock(lambda p, dt: functools.partial(self._step, int(p["lane"]), dt), self._failed)
        try:
            self._about = fmpy.read_model_description(str(own.path))
            self._refuse(len(self.x0), dt)
            self._real = "Float64" if self._about.fmiVersion.startswith("3") else "Real"
            self._names = {v.name: v for v in self._about.modelVariables}
            parameters = {name: (self._reference(name), 1.0) for name in own.parameters}
            self._inputs = self._mapped(own.inputs, "input")
            self._outputs = self._mapped(own.outputs, "output", "local")
            begin = self._inputs | self._mapped(own.start)
            fmpy.extract(str(own.path), self._folder.name)
            for i, x in enumerate(self.x0):
                fmu = self._instance()
                self._fmus.append(fmu)
                self._set(fmu, parameters, own.parameters)
                if self._real == "Real":
                    fmu.setupExperiment(startTime=0.0)
                self._set(fmu, begin, {word: values[i] for word, values in first.items()})
                fmu.enterInitializationMode()
                fmu.exitInitializationMode()
                self._get(fmu, x)
        except Exception as said:  # fmpy raises what the operating system, the XML parser and the FMU raise
            self._failed(0, 0.0, said)

    def _step(self, lane, dt, t, x, u):
        """Advance an instance from t to t + dt [s]; one that does not get there raises ValueError."""
        fmu, x, u = self._fmus[lane], x.view(STATE)[0], u.copy().view(INPUTS)[0]
        given = {
            "command": (1.0 - u.s_cmd) * u.command + u.f_cmd,
            "valve_command": (1.0 - u.s_u) * u.u + u.f_u,
            "hinge_0": u.hm0, "hinge_slope": u.hmd, "hinge_moment": u.hm0 + u.hmd * x.delta,
        }  # fmt: skip
        self._set(fmu, self._inputs, given)
        said = fmu.doStep(currentCommunicationPoint=t, communicationStepSize=dt)
        if said is not None:  # FMI 3; in FMI 2 the status, which fmpy checks, is all
            _, ended, early, reached = said
            if ended:
                raise ValueError(f"ended the simulation at {t:.3f} s (terminateSimulation)")
            if early or abs(reached - (t + dt)) > 1e-6 * dt:
                raise ValueError(f"came to {reached:.6f} s in the step from {t:.3f} s to {t + dt:.3f} s (earlyReturn)")
        self._get(fmu, x)

    def _refuse(self, lanes, dt):
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

    def _reference(self, name):
        """Return the reference of the FMU's variable of this name, one number."""
        variable = self._names.get(name)
        if variable is None:
            raise ValueError(f"has no variable {name!r}; it has {', '.join(sorted(self._names))}")
        if variable.clocks:
            raise ValueError(f"its variable {name!r} has a clock; allowed: variables without")
        if variable.type not in ("Real", "Float64") or variable.dimensions:
            kind = "an array" if variable.dimensions else f"of type {variable.type}"
            raise ValueError(f"its variable {name!r} is {kind}; allowed: one floating-point number of 64 bits")
        return variable.valueReference

    def _mapped(self, variables, *causalities):
        """Return {word: (reference, factor to SI)} of mapped variables, whose causality must be one of these."""
        out = {}
        for word, own in variables.items():
            at, about, factors = self._reference(own.variable), self._names[own.variable], TO_SI[self._units[word]]
            causality = about.causality or "local"
            if causalities and causality not in causalities:
                raise ValueError(f"its variable {own.variable!r} is no {causalities[0]} but {causality}")
            declared = str(about.unit or (about.declaredType and about.declaredType.unit) or "")
            declared = declared.replace(".", " ").replace("*", " ")
            said = own.unit or (declared if declared in factors else self._units[word])
            if declared in factors and factors[declared] != factors[said]:
                raise ValueError(f"its variable {own.variable!r} is in {declared}, not in {said}")
            out[word] = at, factors[said]
        return out

    def _instance(self):
        from fmpy.simulation import instantiate_fmu

        messages = self._messages  # alone: a logger that held the instances would keep them for good
        status, text = (2, 4) if self._real == "Real" else (1, 3)  # places among its arguments

        def logger(*given):
            messages.append((given[status], given[text].decode("utf-8", "replace")))

        return instantiate_fmu(self._folder.name, self._about, "CoSimulation", logger=logger, debug_logging=True)

    def _failed(self, lane, t, error):
        """Raise an error with the FMU's own messages, the worst ones, and what fmpy says."""
        if getattr(error, "status", 0) == FATAL:
            self._fmus.clear()  # FMI: no function of any instance may be called any more
        worst = max((how for how, _ in self._messages), default=0)
        last = [" ".join(text.split()) for how, text in self._messages if how == worst][-3:]
        raise self._error("; ".join([*dict.fromkeys(last), " ".join(str(error).split())])) from None

    def _set(self, fmu, variables, values):
        numbers = [float(values[word]) / factor for word, (_, factor) in variables.items()]
        if numbers:  # an FMU may refuse to be told of none
            getattr(fmu, f"set{self._real}")([at for at, _ in variables.values()], numbers)

    def _get(self, fmu, x):
        found = getattr(fmu, f"get{self._real}")([at for at, _ in self._outputs.values()])
        for (word, (_, factor)), value in zip(self._outputs.items(), found):
            if not math.isfinite(value):
                raise ValueError(f"gives {word} = {value}")
            x[STATES[word]] = value * factor


def _end(fmus, folder):
    for fmu in fmus:
        with suppress(Exception):  # an FMU in an error state may refuse to end; the flight is over
            fmu.terminate()
            fmu.freeInstance()
    folder.cleanup()
