"""Actuators that a scenario brings along: `[actuators.rig]`, a block in a file or an FMU (actuators/README.md)."""

import functools
import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo

from actuators.constants import TO_SI
from actuators.registry import SHIPPED
from cosim.errors import ScenarioError
from cosim.scenario import catalog as c
from cosim.scenario.problem import Problems, Table, choice
from cosim.scenario.user_parts import load

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
                if getattr(self, part):
                    wrong.add("is of an FMU", key=part, remedy="Those of a block stand in its file: params()")
            return
        own, other = ("valve_command", "command") if self.servo else ("command", "valve_command")
        inputs = {word: si for word, si in INPUTS.items() if word != other}
        measured = ("surface", "rod", "pressure") if self.servo else ("surface",)
        every = ("inputs", inputs, (own,)), ("outputs", OUTPUTS, measured), ("start", {"surface": "rad", **inputs}, ())
        for part, words, needed in every:
            given = getattr(self, part)
            wrong.unknown(given, words, f"{part}.", of=part)
            for word in (word for word in needed if word not in given):
                allowed = "{ variable = ..., unit = ... }"
                wrong.add("is missing", key=f"{part}.{word}", allowed=allowed, lacks=[word])
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

    shipped = [technology.name for technology in SHIPPED]
    for name, own in actuators.items():
        error = functools.partial(ScenarioError, place=f"actuators.{name}")
        if not name.isidentifier() or name in shipped:
            allowed = f"letters, digits and underscores, but {', '.join(shipped)}"
            raise error(f"{name!r} is no name of a user's actuator", allowed=allowed)
        c.register(user_actuator.technology(name, own, {**INPUTS, **OUTPUTS}, load, error))
