"""Actuators that a scenario brings along: `[actuators.rig]`, a block in a file or an FMU, named like a technology.

    [actuators.rig]
    fmu = "rig.fmu"                                      # or file = "rig.py"
    servo = "hydraulic"                                  # the shipped servo drives it; left out: it has its own
    inputs.valve_command = { variable = "u", unit = "-" }
    outputs.surface = { variable = "delta", unit = "deg" }
    start.surface = { variable = "delta_0", unit = "deg" }
    parameters = { P_s = 1.4e7 }                         # start values, in the FMU's own units
"""

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from actuators.constants import M_PER_IN, N_M_PER_LBF_FT, RAD_PER_DEG
from cosim.errors import ScenarioError
from cosim.scenario import catalog as c
from cosim.scenario.problem import choice, problem

UNITS = {  # unit of an FMU's variable -> SI
    "-": 1.0, "1": 1.0, "%": 0.01, "rad": 1.0, "deg": RAD_PER_DEG, "m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": M_PER_IN,
    "N m": 1.0, "kN m": 1e3, "lbf ft": N_M_PER_LBF_FT, "N m/rad": 1.0, "kN m/rad": 1e3,
    "N m/deg": 1.0 / RAD_PER_DEG,
}  # fmt: skip
INPUTS = {  # word -> its unit
    "command": "rad", "valve_command": "-", "hinge_0": "N m", "hinge_slope": "N m/rad", "hinge_moment": "N m",
}  # fmt: skip
OUTPUTS = {"surface": "rad", "rod": "m", "pressure": "-"}


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Variable(_Table):
    """A variable of an FMU and its unit."""

    variable: Annotated[str, Field(min_length=1)]
    unit: str = "-"

    @model_validator(mode="after")
    def _known(self):
        if self.unit not in UNITS:
            raise choice(self.unit, UNITS, "unit of an FMU's variable", key="unit")
        return self


class OwnActuator(_Table):
    """A block in a file, or an FMU with its variables."""

    file: str | None = None
    fmu: str | None = None
    servo: Literal["", "hydraulic"] = ""
    inputs: dict[str, Variable] = {}
    outputs: dict[str, Variable] = {}
    start: dict[str, Variable] = {}
    parameters: dict[str, float] = {}

    @model_validator(mode="after")
    def _whole(self):
        if (self.file is None) == (self.fmu is None):
            raise problem("needs one of file, fmu", key="file" if self.file else "fmu", allowed="one of the two")
        if self.file is not None:
            return self
        given, needs = {"inputs": INPUTS, "outputs": OUTPUTS}, ["surface"]
        for part, words in (*given.items(), ("start", {**INPUTS, **OUTPUTS})):
            for word in getattr(self, part):
                if word not in words:
                    raise choice(word, words, f"word of {part}", key=f"{part}.{word}")
        if self.servo:
            needs += ["rod", "pressure"]
        for word in needs:
            if word not in self.outputs:
                raise problem("is missing", key=f"outputs.{word}", allowed="{ variable = ..., unit = ... }")
        word = "valve_command" if self.servo else "command"
        if word not in self.inputs:
            raise problem("is missing", key=f"inputs.{word}", allowed="{ variable = ..., unit = ... }")
        return self

    @property
    def path(self) -> Path:
        """Return the file."""
        return Path(os.path.expanduser(self.file or self.fmu or ""))


def register(actuators: dict[str, OwnActuator]) -> None:
    """Let scenarios name these technologies; a shipped one keeps its name."""
    from actuators import fmu, guest

    for name, own in actuators.items():
        place = f"actuators.{name}"
        if name in c.TECHNOLOGIES and c.TECHNOLOGIES[name] in c.SHIPPED:
            raise ScenarioError(f"{name!r} is the name of a shipped technology", place=place, remedy="Choose another")
        if not name.isidentifier():
            raise ScenarioError(f"{name!r} is no name", place=place, allowed="letters, digits and underscores")

        def error(text: str, place: str = place) -> Exception:
            return ScenarioError(text, place=place)

        if own.file is not None:
            c.register(guest.from_file(name, own.path, own.servo, error))
            continue
        tables = {
            part: {w: fmu.Variable(v.variable, UNITS[v.unit]) for w, v in getattr(own, part).items()}
            for part in ("inputs", "outputs", "start")
        }
        c.register(guest.from_fmu(name, own.path, own.servo, {**tables, "parameters": own.parameters}, error))


def take(table: dict) -> None:
    """Register what the raw `table` of a scenario brings along; what is wrong with it is for the model to say."""
    own = table.get("actuators")
    if not isinstance(own, dict):
        return
    made = {}
    for name, raw in own.items():
        try:
            made[name] = OwnActuator.model_validate(raw)
        except ValueError:
            continue
    register(made)


def locate(table: dict, folder: Path | None, place: str) -> dict:
    """Return the tables with each file of an actuator or a law found, beside the scenario's own (`folder`) or from
    here; else ScenarioError.
    """
    own = table.get("actuators")
    if isinstance(own, dict):
        own = {name: _found(raw, folder, f"{place}: actuators.{name}") for name, raw in own.items()}
    found = {"actuators": own, "law": _found(table.get("law"), folder, f"{place}: law")}
    return {**table, **{name: value for name, value in found.items() if name in table}}


def _is(table):
    return isinstance(table, dict)


def _found(raw, folder, place):
    """Return the table `raw` with its file, if it names one, as a path from here."""
    for key in ("file", "fmu"):
        if _is(raw) and isinstance(raw.get(key), str):
            path = Path(os.path.expanduser(raw[key]))
            beside = folder / path if folder else path
            path = beside if os.path.isfile(beside) else path
            if not os.path.isfile(path):
                raise ScenarioError("no such file", place=f"{place}.{key} = {raw[key]}")
            raw = {**raw, key: str(path)}
    return raw
