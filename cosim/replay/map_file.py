"""The map of `cosim replay --map`: which channels of a foreign recording are which of our signals, in which unit.

    rate_hz = 200                      # tick of the detectors
    time = "clock_ms"                  # time column of a table (default: found by its name)
    columns = ["T", "AXCG"]            # names of the columns of a file without a header
    aircraft = "Citation II"           # that was recorded

    [flight]                           # as in a scenario: the point at which the detectors are set
    [elevator]                         # technology of each segment, as in a scenario
    [detectors.iotsekf]                # parameters that differ, as in a scenario

    [signals]
    alpha = { channel = "AOA", unit = "deg" }
    "left_inner.rod" = { channel = "LIB_ROD", unit = "mm", sign = -1 }
    "left_inner.hm0" = { constant = -350.0 }

Signals are named by the words of cosim/scenario/vocabulary.py: sensors (`alpha`, `n_z`, ...), sensors of an actuator
(`left_inner.rod`), commands of the law (`de_cmd`), the command sent to an actuator
(`left_inner.valve_command`, `right_inner.current_command`), and the modelled hinge moment
(`left_inner.hm0`, `left_inner.hmd`). In SI,

    value = sign scale (unit -> SI) channel + offset

The pressure sensor reads a share of the supply pressure; bar, MPa, kPa and psi are divided by that of the segment's own
actuator (`[elevator.left_inner.hydraulic] P_s = 2.8e7`). A transducer's channel has a unit per volt or milliampere:
`unit = "mm/V", scale = 12.5`. A measured hinge moment, or one that is known to be none, is

    "left_inner.hinge_moment" = { channel = "LOAD_KN", unit = "kN" }        # N m, lbf ft, or a load on the rod
    "left_inner.hinge_moment" = { constant = 0.0 }                          # a bench without air

Interpolation halves white noise and a held command is late by half an interval: detectors of slow signals bear that,
a filter on a servo-valve command does not, and wants it at the rate at which it was sent.

A sample of a command to an actuator is what is sent at its time and held until the next one; a filter at a tick wants
what has acted until then, the sample before. `held = true` says that the samples are that already, as `u_held` of our
own logs is; mixed up, a filter is a tick off and alarms for it.

A unit may be written as people do: deg, [deg], °, (inch), M/S**2. A channel that only stands for the signal, as the
vane's angle does for the one over the ground, is called a proxy: `proxy = "angle of attack by the vane"`.

A detector of which a signal is missing does not run. `beta = { absent = true }` runs it as with a sensor that is lost
from the start to the end, which many bear.

A channel is a column of the table, or `/topic.field` of an MCAP file. `resample = "linear"` (default of sensors)
interpolates between samples, "hold" (default of commands) repeats the last one; both give a sample that lies on a
tick as it is. A value is valid where its samples are finite and no more than `max_gap_s` apart (default: three of the
channel's own intervals), and where the channel named by `valid` is above 0.5. An empty cell is a lost sample, unless
`sparse = true` says that the table holds several rates.
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
