"""[elevator]: technology, feedback and own parameters of every segment. [actuators]: technologies that a scenario
brings along, a block in a file or an FMU (actuators/README.md)."""

import functools
import os
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo

from actuators.constants import TO_SI
from actuators.technology import Key
from cosim.errors import ScenarioError
from cosim.scenario import catalog as c
from cosim.scenario.aircraft import of
from cosim.scenario.problem import MULTIPLIER, Problems, Table, choice
from cosim.scenario.user_parts import load

Feedback = Literal["measured", "iotsekf", "rtsekf", "rtsekf_flight"]


class Settings(Table):
    """Parameters of one segment's actuator [SI]: of what flies, and of what servo and filters believe it to be."""

    truth: dict[str, float] = Field(default_factory=dict)
    model: dict[str, float] = Field(default_factory=dict)

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Put what stands beside truth and model into both."""
        both = {name: value for name, value in raw.items() if name not in cls.model_fields}
        parts = {part: raw.get(part, {}) for part in cls.model_fields}
        return {part: {**both, **own} if isinstance(own, dict) else own for part, own in parts.items()}


class Elevator(Table, extra="allow"):
    """The elevator segments, by the aircraft's names: actuator technology and servo feedback."""

    __pydantic_extra__: dict[str, str]

    # what each segment's servo closes on; a word is for every hydraulic segment, iotsekf where nothing is said
    feedback: dict[str, Feedback]
    # on a sensor verdict the loop closes on the healthy estimate; "published": an EMA's on that of [Jay] as published
    reconfigure: bool | Literal["published"] = False
    compensate: bool = False  # while iotsekf alarms its estimate of the input fault is taken off the valve command
    # segment -> its own parameters; also written [elevator.<segment>.<technology>] name = value, or .truth and .model
    parameters: dict[str, Settings] = Field(default_factory=dict)

    @classmethod
    def filled(cls, raw: dict[str, Any], wrong: Problems, info: ValidationInfo) -> dict[str, Any]:
        """Add technology and feedback of every segment."""
        default, given = of(info).technology, raw.get("feedback", {})
        wrong.unknown(raw, (*default, *cls.model_fields))
        known = (*(t.name for t in c.SHIPPED), *(info.context or {}).get("actuators", ()))
        technology = {name: raw.get(name, own) for name, own in default.items()}
        parameters = raw.get("parameters", {})
        for name, word in technology.items():
            if isinstance(word, dict) and len(word) == 1 and isinstance(parameters, dict):
                ((technology[name], own),) = word.items()
                parameters = {**parameters, name: own}
            wrong.require(technology[name] in known, "is not one of the choices", key=name, allowed=", ".join(known))
        word = given if isinstance(given, str) else "iotsekf"
        if word not in c.FEEDBACKS:
            wrong.append(choice(word, c.FEEDBACKS, "feedback", key="feedback"))
        feedback = {name: word if tech == "hydraulic" else "measured" for name, tech in technology.items()}
        if isinstance(given, dict | str):
            given = {**feedback, **(given if isinstance(given, dict) else {})}
        return {**technology, **raw, **technology, "feedback": given, "parameters": parameters}

    @property
    def ema_estimate(self) -> str:
        """Return the detector on whose estimate a reconfigured EMA closes."""
        return "ema_kalman" if self.reconfigure == "published" else "ema_kalman_flight"

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that filters are of hydraulic actuators, and parameters of that one and near its nominal ones."""
        wrong.unknown(self.feedback, self.technology, "feedback.")
        wrong.unknown(self.parameters, self.technology, "parameters.")
        for name, tech in self.technology.items():
            said = f"{self.feedback[name]} is a filter of hydraulic actuators, {name} is {tech}"
            wrong.require(tech == "hydraulic" or self.feedback[name] == "measured", said, key=f"feedback.{name}",
                          allowed="measured")  # fmt: skip
            if name in self.parameters:
                own = c.TECHNOLOGIES[tech]
                nominal = own.parameters(of(info).own(tech)).items()
                keys = {k: _near(k, v) for k, v in nominal if k not in own.fixed}
                units = {key: unit for key, (_, unit) in c.meanings(tech).items()}
                parts = {f"parameters.{name}.{part}.": values for part, values in self.parameters[name]}
                if len({*map(str, parts.values())}) == 1:  # as of both, which is said once
                    parts = {f"{name}.{tech}.": self.parameters[name].truth}
                for place, values in parts.items():
                    wrong.numbers(values, keys, f"{own.article} actuator", place, units)

    @property
    def technology(self) -> dict[str, str]:
        """Return {segment: technology} in the order of the segments."""
        return dict(self.model_extra or {})


def _near(name, nominal):
    """Return the Key of a parameter that may differ from its nominal value as a multiplier may; a backlash is 0."""
    low, high = sorted((MULTIPLIER.low * nominal, MULTIPLIER.high * nominal))
    return Key(name, low, high) if nominal else Key(name, 0.0, 0.1)


INPUTS = {  # word -> its unit
    "command": "rad", "valve_command": "-", "hinge_0": "N m", "hinge_slope": "N m/rad", "hinge_moment": "N m",
}  # fmt: skip
OUTPUTS = {"surface": "rad", "rod": "m", "pressure": "-"}


class Variable(Table):
    """A variable of an FMU and its unit; left out: the one that the FMU declares, else SI."""

    variable: Annotated[str, Field(min_length=1)]
    unit: str = ""


class OwnActuator(Table):
    """A block in a file, or an FMU with its variables."""

    file: str | None = None
    fmu: str | None = None
    sha256: str | None = None
    servo: Literal["", "hydraulic"] = ""
    inputs: dict[str, Variable] = Field(default_factory=dict)
    outputs: dict[str, Variable] = Field(default_factory=dict)
    start: dict[str, Variable] = Field(default_factory=dict)
    parameters: dict[str, float] = Field(default_factory=dict)

    def mistakes(self, wrong: Problems, info: ValidationInfo) -> None:
        """Check that there is one of file and FMU, and an FMU's map."""
        wrong.one_of(("file", "fmu"), {key for key, value in self if value is not None}, who="an actuator")
        if self.fmu is None:
            for part in ("inputs", "outputs", "start", "parameters"):
                wrong.require(not getattr(self, part), "is of an FMU", key=part,
                              remedy="Those of a block stand in its file: params()")  # fmt: skip
            return
        own, other = ("valve_command", "command") if self.servo else ("command", "valve_command")
        inputs = {word: si for word, si in INPUTS.items() if word != other}
        measured = ("surface", "rod", "pressure") if self.servo else ("surface",)
        every = ("inputs", inputs, (own,)), ("outputs", OUTPUTS, measured), ("start", {"surface": "rad", **inputs}, ())
        for part, words, needed in every:
            given = getattr(self, part)
            wrong.unknown(given, words, f"{part}.", of=part)
            for word in needed:
                wrong.require(word in given, "is missing", key=f"{part}.{word}", lacks=[word],
                              allowed="{ variable = ..., unit = ... }")  # fmt: skip
            for word, unit in ((word, variable.unit) for word, variable in given.items() if word in words):
                if unit not in ("", *TO_SI[words[word]]):
                    wrong.append(choice(unit, TO_SI[words[word]], f"unit of {word}", key=f"{part}.{word}.unit"))

    @property
    def path(self) -> Path:
        """Return the file."""
        return Path(os.path.expanduser(self.file or self.fmu or ""))


class OwnActuators(Table, extra="ignore"):
    """Of the tables of a scenario that of the actuators that it brings along, which says what the others may name."""

    actuators: dict[str, OwnActuator] = Field(default_factory=dict)


def register(actuators: dict[str, OwnActuator]) -> None:
    """Let scenarios name these technologies; a shipped one keeps its name."""
    from actuators import user_actuator  # it needs NumPy, and an FMU's reader takes a while to import

    shipped = [technology.name for technology in c.SHIPPED]
    for name, own in actuators.items():
        error = functools.partial(ScenarioError, place=f"actuators.{name}")
        if not name.isidentifier() or name in shipped:
            allowed = f"letters, digits and underscores, but {', '.join(shipped)}"
            raise error(f"{name!r} is no name of a user's actuator", allowed=allowed)
        c.register(user_actuator.technology(name, own, {**INPUTS, **OUTPUTS}, load, error))
