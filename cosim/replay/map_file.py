"""The map of `cosim replay --map`: which channels of a foreign recording are which of our signals, in which unit.

README.md has an example and what each key means. Signals are named by the words of cosim/scenario/vocabulary.py:
sensors (`alpha`), sensors of an actuator (`left_inner.rod`), commands of the law (`de_cmd`), the command sent to an
actuator (`left_inner.valve_command`), the modelled hinge moment (`left_inner.hm0`, `.hmd`), or in place of these two a
measured one (`left_inner.hinge_moment`). In SI,

    value = sign scale (unit -> SI) channel + offset

A channel is a column of the table, or `/topic.field` of an MCAP file.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, Field, ValidationError, model_validator

from cosim.replay.log_schema import ReplayError
from cosim.replay.units import bare, factors
from cosim.scenario.load import explained
from cosim.scenario.problem import Origin
from cosim.texts import read, toml


class Signal(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """One signal of the map: a channel and how its numbers become SI, a constant in SI, or what it is derived from."""

    channel: str | None = None
    constant: float | None = None
    derivative_of: str | None = None  # signal of the map whose rate of change it is (cosim/replay/map_signals.py)
    path_of: Literal["theta"] | None = None  # attitude less the angle of the path
    speed_of: Literal["cas", "mach"] | None = None  # true airspeed by it and h_baro
    absent: bool = False  # no channel of the recording holds it: the detectors read a sensor that is lost all along
    unit: str | None = None  # default: the signal's SI unit
    scale: float = 1.0
    sign: Literal[1, -1] = 1
    offset: float = 0.0  # [SI]
    resample: Literal["linear", "hold"] | None = None
    max_gap_s: Annotated[float, Field(gt=0.0)] | None = None
    valid: str | None = None
    held: bool = False  # of a command to an actuator: what acted until the sample's time; else what is sent at it
    proxy: str = ""  # what the channel is in truth, where it only stands for the signal
    missing: float | None = None  # a number of the channel that stands for a lost sample, -9999 say
    sparse: bool = False  # empty cells are no samples, as in a table of several rates; otherwise they are lost ones

    @model_validator(mode="after")
    def _one(self):
        given = (self.channel, self.constant, self.derivative_of, self.path_of, self.speed_of, self.absent or None)
        if sum(value is not None for value in given) != 1:
            raise ValueError("needs either a channel or a constant, or what it is derived from")
        return self

    @property
    def stands_on(self) -> str:
        """Return what it is in truth where it only stands for the signal, "" where it is the signal."""
        rate = f"the rate of change of {self.derivative_of}" if self.derivative_of else ""
        speed = f"{self.speed_of} and h_baro in the standard atmosphere" if self.speed_of else ""
        return self.proxy or rate or speed or ("attitude less the angle of the path" if self.path_of else "")

    @property
    def made(self) -> bool:
        """Tell whether it is made from other signals of the map, in SI."""
        return bool(self.derivative_of or self.path_of or self.speed_of)

    def factor(self, si: str, shares: Mapping[str, float] | None = None) -> float:
        """Return what a number of the channel is multiplied with for the SI unit `si`. Raises KeyError."""
        return self.sign * self.scale * factors(si, shares)[bare(self.unit or si)]


class Map(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """A map file; `flight`, `elevator` and `detectors` are a scenario's tables and checked as such."""

    title: str = ""
    rate_hz: Annotated[int, Field(ge=50, le=2000)] = 200
    time: str | None = None
    columns: tuple[str, ...] = ()  # names of the columns of a file without any
    aircraft: str = ""  # that was recorded: of a detector designed for another one the caveats say so
    flight: dict = Field(default_factory=dict)
    elevator: dict = Field(default_factory=dict)
    detectors: dict = Field(default_factory=dict)
    signals: dict[str, Signal]


def load_map(path: str | Path) -> tuple[Map, str]:
    """Return (Map, its text) of a TOML file. Raises ReplayError with file and key."""
    place = str(path)
    try:
        text = read(path, error=ReplayError, what="map")
    except FileNotFoundError:
        raise ReplayError("there is no such file", place=place) from None
    table = toml(text, place=place, error=ReplayError)
    try:
        return Map.model_validate(table), text
    except ValidationError as error:
        raise explained(error, table, Origin.of_toml(text, place), Map, ReplayError) from None
